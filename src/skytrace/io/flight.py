"""A FLIGHT: the folder or flight.toml that says which cameras filmed, with which lens, and what they saw."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from skytrace.errors import InputError
from skytrace.io.flight_camera import CameraReader, FlightCamera
from skytrace.io.flight_schema import CameraKeys, MomentKeys, TruthKeys, read_flight_keys
from skytrace.io.text import did_you_mean
from skytrace.io.toml import TomlFile

__all__ = ["FLIGHT_FILE", "Flight", "FlightCamera", "FlightMoment", "FlightTruth", "read_flight"]

FLIGHT_FILE = "flight.toml"


@dataclass(frozen=True, slots=True)
class FlightMoment:
    """One moment seen by several cameras: the (fractional) frame of each, and how well its time is known."""

    name: str
    frames: Mapping[str, float]
    sigma_s: float | None


@dataclass(frozen=True, slots=True)
class FlightTruth:
    """Where the truth is kept. Only evaluation opens these files; see `skytrace.io.truth`."""

    trajectory: Path
    rate_hz: float | None  # none where the trajectory has time stamps of its own
    positions: Path | None = None
    synchronisation: Path | None = None


@dataclass(frozen=True, slots=True)
class Flight:
    """Everything a reconstruction is given."""

    name: str
    path: Path  # the flight.toml
    cameras: tuple[FlightCamera, ...]
    truth: FlightTruth | None
    input_files: tuple[Path, ...]  # every file read, flight.toml first; the truth, which is not read, is not among them
    simultaneous: tuple[FlightMoment, ...] = ()
    warnings: tuple[str, ...] = ()  # what is odd about the files, in words


def read_flight(path: Path | str) -> Flight:
    """Read a FLIGHT folder or file, with all calibrations, detections and time stamps it names.

    Paths in the file are relative to its folder. Raises InputError for everything unknown, missing or contradictory.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(path, f"no such flight: expected a folder with {FLIGHT_FILE}, or that file")
    if path.is_dir():
        path = path / FLIGHT_FILE
    keys, toml = read_flight_keys(path)
    _check_cameras(toml, keys.camera)
    cameras, files, warnings = [], [path], []
    for k, camera in enumerate(keys.camera):
        reader = CameraReader(toml, k, camera)
        cameras.append(reader.read())
        files += reader.files
        warnings += reader.warnings
    return Flight(
        name=keys.name or path.absolute().parent.name,
        path=path,
        cameras=tuple(cameras),
        truth=None if keys.truth is None else _truth(toml, keys.truth),
        input_files=tuple(dict.fromkeys(files)),
        simultaneous=tuple(_moment(toml, k, moment, cameras) for k, moment in enumerate(keys.simultaneous)),
        warnings=tuple(warnings),
    )


def _check_cameras(toml: TomlFile, cameras: list[CameraKeys]) -> None:
    if len(cameras) < 2:
        message = f"expected at least two [[camera]] tables, got {len(cameras)}"
        raise InputError(toml.path, message, line=toml.line("camera", 0))
    first: dict[str, int] = {}
    for k, camera in enumerate(cameras):
        if not camera.id.strip() or not camera.id.isprintable() or set(camera.id) & set(',;"'):
            message = f"camera {k + 1}: expected an id without commas, quotes or control characters, got {camera.id!r}"
            raise InputError(toml.path, message, line=toml.line("camera", k, "id"))
        if camera.id in first:
            message = f"camera {k + 1}: id {camera.id!r} already belongs to camera {first[camera.id] + 1}"
            raise InputError(toml.path, message, line=toml.line("camera", k, "id"))
        first[camera.id] = k
    frames = {name: k for name in ("position_m", "position_wgs84") for k, c in enumerate(cameras) if getattr(c, name)}
    if len(frames) == 2:
        k = frames["position_wgs84"]
        message = f"camera {cameras[k].id!r}: give every position as position_m, or every one as position_wgs84"
        raise InputError(toml.path, message, line=toml.line("camera", k, "position_wgs84"))
    zoned = {c.start_time.tzinfo is not None: k for k, c in enumerate(cameras) if c.start_time is not None}
    if len(zoned) == 2:
        k = zoned[False]
        message = f"camera {cameras[k].id!r}: start_time: give every one with its time zone (such as Z), or none"
        raise InputError(toml.path, message, line=toml.line("camera", k, "start_time"))


def _moment(toml: TomlFile, index: int, keys: MomentKeys, cameras: Sequence[FlightCamera]) -> FlightMoment:
    def fail(key: str, message: str) -> NoReturn:
        line = toml.line("simultaneous", index, key)
        raise InputError(toml.path, f"[[simultaneous]] {index + 1}: {key}: {message}", line=line)

    known = {c.camera_id: c for c in cameras}
    if len(keys.frames) < 2:
        fail("frames", f"expected the frames of at least two cameras, got {len(keys.frames)}")
    for camera_id, frame in keys.frames.items():
        if camera_id not in known:
            suggestion = did_you_mean(camera_id, known)
            fail("frames", f"unknown camera {camera_id!r}{suggestion}; known: {', '.join(known)}")
        if not (math.isfinite(frame) and frame >= 0):
            fail("frames", f"{camera_id}: expected a frame number from 0, got {frame:g}")
        stamps = known[camera_id].timestamps
        if stamps is not None and stamps.complete and frame > stamps.frame[-1]:
            fail("frames", f"{camera_id}: frame {frame:g} is beyond the last one of {stamps.path}, {stamps.frame[-1]}")
    if keys.sigma_s is not None and not (math.isfinite(keys.sigma_s) and keys.sigma_s > 0):
        fail("sigma_s", f"expected a positive number, got {keys.sigma_s:g}")
    return FlightMoment(f"[[simultaneous]] {index + 1}", dict(keys.frames), keys.sigma_s)


def _truth(toml: TomlFile, keys: TruthKeys) -> FlightTruth:
    def existing(key: str) -> Path | None:
        value = getattr(keys, key)
        if value is None:
            return None
        path = toml.path.parent / value
        if not path.is_file():
            raise InputError(toml.path, f"[truth]: {key}: no such file: {path}", line=toml.line("truth", 0, key))
        return path

    if keys.rate_hz is not None and not (math.isfinite(keys.rate_hz) and keys.rate_hz > 0):
        message = f"[truth]: rate_hz: expected a positive number, got {keys.rate_hz:g}"
        raise InputError(toml.path, message, line=toml.line("truth", 0, "rate_hz"))
    trajectory = existing("trajectory")
    assert trajectory is not None  # the schema requires it
    return FlightTruth(trajectory, keys.rate_hz, existing("positions"), existing("synchronisation"))
