"""A FLIGHT: the folder or flight.toml that says which cameras filmed, with which lens, and what they saw."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

import numpy as np

from skytrace.errors import InputError
from skytrace.geometry.arrays import FloatArray, frozen_array
from skytrace.io.calibration import read_calibration, split_camera_name
from skytrace.io.detections import RawDetections, parse_columns, read_detections
from skytrace.io.flight_schema import CameraKeys, TruthKeys, Vector3, read_flight_keys
from skytrace.io.timestamps import read_timestamps
from skytrace.io.toml import TomlFile
from skytrace.model.camera import Intrinsics

FLIGHT_FILE = "flight.toml"


@dataclass(frozen=True, eq=False, slots=True)
class FlightCamera:
    """What is given of one camera before anything is estimated."""

    camera_id: str
    intrinsics: Intrinsics
    frame_rate_hz: float  # nominal
    detections: RawDetections
    offset_s: float | None = None  # known start on a common clock
    offset_sigma_s: float | None = None
    position_m: FloatArray | None = None  # (3,) surveyed centre in a metric frame
    position_wgs84: FloatArray | None = None  # (3,) latitude and longitude in degrees, ellipsoidal height in metres
    readout_s: float | None = None  # known time from the first to the last row

    def __post_init__(self) -> None:
        for name in ("position_m", "position_wgs84"):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, frozen_array(value, (3,), name))


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
    cameras, files = [], [path]
    for k, camera in enumerate(keys.camera):
        reader = _CameraReader(toml, k, camera)
        cameras.append(reader.read())
        files += reader.files
    return Flight(
        name=keys.name or path.absolute().parent.name,
        path=path,
        cameras=tuple(cameras),
        truth=None if keys.truth is None else _truth(toml, keys.truth),
        input_files=tuple(dict.fromkeys(files)),
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


class _CameraReader:
    """Reads what one `[[camera]]` table names, and knows the table's lines."""

    def __init__(self, toml: TomlFile, index: int, keys: CameraKeys) -> None:
        self.toml, self.index, self.keys = toml, index, keys
        self.files: list[Path] = []

    def fail(self, key: str, message: str) -> NoReturn:
        line = self.toml.line("camera", self.index, key)
        raise InputError(self.toml.path, f"camera {self.keys.id!r}: {key}: {message}", line=line)

    def read(self) -> FlightCamera:
        keys = self.keys
        self._check_values()
        calibration = self._existing("calibration", keys.calibration, fragment=True)
        intrinsics, calibrated_rate_hz = read_calibration(calibration, keys.id)
        detections = self._detections()
        frame_rate_hz = keys.frame_rate_hz or calibrated_rate_hz or _stamped_rate_hz(detections)
        if frame_rate_hz is None:
            message = "no frame rate: give it here, or in the calibration, or give time stamps"
            self.fail("frame_rate_hz", message)
        if keys.readout_s is not None and keys.readout_s > 1.0 / frame_rate_hz:
            self.fail("readout_s", f"{keys.readout_s:g} s is longer than a frame ({1.0 / frame_rate_hz:.4g} s)")
        return FlightCamera(
            camera_id=keys.id,
            intrinsics=intrinsics,
            frame_rate_hz=frame_rate_hz,
            detections=detections,
            offset_s=keys.offset_s,
            offset_sigma_s=keys.offset_sigma_s,
            position_m=_vector(keys.position_m),
            position_wgs84=_vector(keys.position_wgs84),
            readout_s=keys.readout_s,
        )

    def _existing(self, key: str, value: str, fragment: bool = False) -> Path:
        path = self.toml.path.parent / value
        file = split_camera_name(path)[0] if fragment else path
        if not value or not file.is_file():
            self.fail(key, f"no such file: {file}" if value else "expected a path, got nothing")
        self.files.append(file)
        return path

    def _check_values(self) -> None:
        keys = self.keys
        if keys.video is not None and keys.detections is not None:
            self.fail("video", "give either video or detections, not both")
        if keys.video is not None:
            self.fail(
                "video", "videos are not read directly; run a detector on it first and give detections = its file"
            )
        if keys.detections is None:
            self.fail("detections", "missing: expected the path of this camera's detections")
        if keys.detections_columns is not None:
            try:
                parse_columns(keys.detections_columns)
            except ValueError as error:
                self.fail("detections_columns", str(error))
        for key in ("frame_rate_hz", "offset_s", "offset_sigma_s", "readout_s"):
            value = getattr(keys, key)
            if value is not None and not math.isfinite(value):
                self.fail(key, f"expected a finite number, got {value}")
        for key in ("frame_rate_hz", "offset_sigma_s"):
            if getattr(keys, key) is not None and getattr(keys, key) <= 0:
                self.fail(key, f"expected a positive number, got {getattr(keys, key):g}")
        if keys.readout_s is not None and keys.readout_s < 0:
            self.fail("readout_s", f"expected 0 or more, got {keys.readout_s:g}")
        if keys.offset_sigma_s is not None and keys.offset_s is None:
            self.fail("offset_sigma_s", "given without offset_s")
        self._check_positions()

    def _check_positions(self) -> None:
        for key in ("position_m", "position_wgs84"):
            if not all(map(math.isfinite, getattr(self.keys, key) or ())):
                self.fail(key, f"expected finite numbers, got {list(getattr(self.keys, key))}")
        if self.keys.position_wgs84 is not None:
            latitude_deg, longitude_deg, _ = self.keys.position_wgs84
            if abs(latitude_deg) > 90 or abs(longitude_deg) > 180:
                message = (
                    "expected latitude (-90 to 90) and longitude (-180 to 180) in degrees and the ellipsoidal "
                    f"height in metres, got {list(self.keys.position_wgs84)}"
                )
                self.fail("position_wgs84", message)

    def _detections(self) -> RawDetections:
        keys = self.keys
        path = self._existing("detections", keys.detections or "")
        detections = read_detections(path, keys.detections_columns)
        if keys.timestamps is None:
            return detections
        if detections.time_s is not None:
            self.fail("timestamps", f"{path} has time stamps of its own; give one or the other")
        stamps = read_timestamps(self._existing("timestamps", keys.timestamps))
        time_s, known = stamps.at(detections.frame)
        if not known.all():
            row = int(np.argmin(known))
            message = (
                f"frame {detections.frame[row]} has no time stamp in {stamps.path} "
                f"(frames {stamps.frame[0]} to {stamps.frame[-1]})"
            )
            raise InputError(path, message, line=int(detections.line[row]))
        return replace(detections, time_s=time_s)


def _vector(values: Vector3 | None) -> FloatArray | None:
    return None if values is None else np.array(values)


def _stamped_rate_hz(detections: RawDetections) -> float | None:
    """Median frame rate between neighbouring detections with time stamps."""
    if detections.time_s is None:
        return None
    frame, first = np.unique(detections.frame, return_index=True)
    if len(frame) < 2:
        return None
    return float(np.median(np.diff(frame) / np.diff(detections.time_s[first])))


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
