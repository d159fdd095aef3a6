"""A FLIGHT: the folder or flight.toml that says which cameras filmed, with which lens, and what they saw."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

from skytrace.errors import InputError
from skytrace.io.flight_camera import CameraReader, FlightCamera
from skytrace.io.flight_schema import CameraKeys, DistanceKeys, FlightKeys, MomentKeys, TruthKeys, read_flight_keys
from skytrace.io.text import did_you_mean
from skytrace.io.toml import TomlFile

__all__ = [
    "FLIGHT_FILE",
    "Flight",
    "FlightCamera",
    "FlightDistance",
    "FlightMoment",
    "FlightTruth",
    "read_flight",
    "read_videos",
]

FLIGHT_FILE = "flight.toml"


@dataclass(frozen=True, slots=True)
class FlightMoment:
    """One moment seen by several cameras: the (fractional) frame of each, and how well its time is known."""

    name: str
    frames: Mapping[str, float]
    sigma_s: float | None


@dataclass(frozen=True, slots=True)
class FlightDistance:
    """A distance between two cameras that was measured."""

    camera_ids: tuple[str, str]
    metres: float
    sigma_m: float | None


@dataclass(frozen=True, slots=True)
class FlightTruth:
    """Where the truth is kept. Only evaluation opens these files; see `skytrace.io.truth`."""

    trajectory: Path
    rate_hz: float | None  # none where the trajectory has time stamps of its own
    positions: Path | None = None
    synchronisation: Path | None = None
    orientations: Path | None = None


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
    distances: tuple[FlightDistance, ...] = ()
    vertical_datum: str | None = None  # what the heights of positions on the earth are counted from, where it is said


def read_flight(path: Path | str, tracks: Mapping[str, Path] | None = None) -> Flight:
    """Read a FLIGHT folder or file, with all calibrations, detections and time stamps it names.

    Paths in the file are relative to its folder. `tracks` holds, by camera id, the TRACKS files of those cameras that
    name a video; without one, such a camera has no detections. Raises InputError for everything unknown, missing or
    contradictory.
    """
    path = _description(path)
    keys, toml = read_flight_keys(path)
    _check_cameras(toml, keys.camera)
    # Containers tell the time with its zone: it cannot be compared with a time given without.
    zoned = all(camera.start_time is None or camera.start_time.tzinfo for camera in keys.camera)
    cameras, files, warnings = [], [path], []
    for k, keys_of_camera in enumerate(keys.camera):
        reader = CameraReader(toml, k, keys_of_camera, (tracks or {}).get(keys_of_camera.id))
        camera = reader.read()
        if camera.start_time is None and zoned:
            camera = replace(camera, start_time=reader.created)
        cameras.append(camera)
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
        distances=_distances(toml, keys.known_distance, [c.camera_id for c in cameras]),
        vertical_datum=_vertical_datum(toml, keys),
    )


def read_videos(path: Path | str) -> dict[str, Path]:
    """The videos a FLIGHT names, by camera id.

    Raises InputError where the description is wrong, or a video is not there or not of its calibration's size: it is
    said before the videos are looked at, which takes long.
    """
    keys, toml = read_flight_keys(_description(path))
    _check_cameras(toml, keys.camera)
    readers = [CameraReader(toml, k, camera) for k, camera in enumerate(keys.camera)]
    return {r.keys.id: video for r in readers if (video := r.find_video()) is not None}


def _description(path: Path | str) -> Path:
    """The flight.toml of a flight."""
    path = Path(path)
    if not path.exists():
        raise InputError(path, f"no such flight: expected a folder with {FLIGHT_FILE}, or that file")
    return path / FLIGHT_FILE if path.is_dir() else path


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
    _check_devices(toml, cameras)
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


def _check_devices(toml: TomlFile, cameras: list[CameraKeys]) -> None:
    first: dict[str, str] = {}
    for k, camera in enumerate(cameras):
        if camera.device is None:
            continue
        if not camera.device.strip() or not camera.device.isprintable():
            message = f"camera {camera.id!r}: device: expected a name, got {camera.device!r}"
            raise InputError(toml.path, message, line=toml.line("camera", k, "device"))
        if camera.device in first:
            message = (
                f"camera {camera.id!r}: device: {camera.device!r} is camera {first[camera.device]!r} already; "
                "expected another name, since one device films a flight once"
            )
            raise InputError(toml.path, message, line=toml.line("camera", k, "device"))
        first[camera.device] = camera.id


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


def _distances(toml: TomlFile, tables: list[DistanceKeys], known: Sequence[str]) -> tuple[FlightDistance, ...]:
    found: dict[frozenset[str], FlightDistance] = {}
    for index, keys in enumerate(tables):

        def fail(key: str, message: str, index: int = index) -> NoReturn:
            line = toml.line("known_distance", index, key)
            raise InputError(toml.path, f"[[known_distance]] {index + 1}: {key}: {message}", line=line)

        for camera_id in keys.cameras:
            if camera_id not in known:
                suggestion = did_you_mean(camera_id, known)
                fail("cameras", f"unknown camera {camera_id!r}{suggestion}; known: {', '.join(known)}")
        if len(keys.cameras) != 2 or len(set(keys.cameras)) != 2:
            fail("cameras", f"expected the ids of two cameras, got {keys.cameras}")
        for key in ("metres", "sigma_m"):
            value = getattr(keys, key)
            if value is not None and not (math.isfinite(value) and value > 0):
                fail(key, f"expected a positive number, got {value:g}")
        one, other = keys.cameras
        if frozenset(keys.cameras) in found:
            fail("cameras", f"the distance from {one} to {other} is given twice")
        found[frozenset(keys.cameras)] = FlightDistance((one, other), keys.metres, keys.sigma_m)
    return tuple(found.values())


def _vertical_datum(toml: TomlFile, keys: FlightKeys) -> str | None:
    if keys.vertical_datum is None:
        return None
    line = toml.line("", 0, "vertical_datum")
    if all(camera.position_wgs84 is None for camera in keys.camera):
        raise InputError(toml.path, "vertical_datum: given without any position_wgs84", line=line)
    if not keys.vertical_datum.strip() or not keys.vertical_datum.isprintable():
        message = f"vertical_datum: expected a name such as 'EGM96', got {keys.vertical_datum!r}"
        raise InputError(toml.path, message, line=line)
    return keys.vertical_datum


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
    others = (existing(key) for key in ("positions", "synchronisation", "orientations"))
    return FlightTruth(trajectory, keys.rate_hz, *others)
