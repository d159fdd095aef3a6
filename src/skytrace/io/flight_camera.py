"""One `[[camera]]` of a FLIGHT: its lens, its frame times, what it saw, and what is known of it beforehand."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import NoReturn

import numpy as np

from skytrace.errors import InputError
from skytrace.geometry.arrays import FloatArray, frozen_array
from skytrace.io.calibration import read_calibration, split_camera_name
from skytrace.io.detections import RawDetections, parse_columns, read_detections
from skytrace.io.flight_schema import CameraKeys, Vector3
from skytrace.io.timestamps import Timestamps, read_timestamps, typical_rate_hz, wrong_unit
from skytrace.io.toml import TomlFile
from skytrace.model.camera import Intrinsics

_CONTRADICTION = 0.1  # of the nominal frame rate: time stamps that differ by more are another frame rate's


@dataclass(frozen=True, eq=False, slots=True)
class FlightCamera:
    """What is given of one camera before anything is estimated."""

    camera_id: str
    intrinsics: Intrinsics
    frame_rate_hz: float  # nominal; that of the time stamps where they contradict it
    detections: RawDetections
    offset_s: float | None = None  # known start on a common clock
    offset_sigma_s: float | None = None
    position_m: FloatArray | None = None  # (3,) surveyed centre in a metric frame
    position_wgs84: FloatArray | None = None  # (3,) latitude and longitude in degrees, ellipsoidal height in metres
    readout_s: float | None = None  # known time from the first to the last row
    timestamps: Timestamps | None = None  # its time base, where it has one
    start_time: datetime | None = None  # wall-clock time of frame 0, as the camera's or the container's clock had it

    def __post_init__(self) -> None:
        for name in ("position_m", "position_wgs84"):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, frozen_array(value, (3,), name))

    def camera_time_s(self, frame: float) -> float:
        """Time of a (fractional) frame on the camera's own clock, evenly spaced before and after the time stamps."""
        if self.timestamps is None:
            return frame / self.frame_rate_hz
        known, time_s = self.timestamps.frame, self.timestamps.time_s
        beyond = frame - float(np.clip(frame, known[0], known[-1]))
        return float(np.interp(frame, known, time_s)) + beyond / self.frame_rate_hz


class CameraReader:
    """Reads what one `[[camera]]` table names, and knows the table's lines."""

    def __init__(self, toml: TomlFile, index: int, keys: CameraKeys) -> None:
        self.toml, self.index, self.keys = toml, index, keys
        self.files: list[Path] = []
        self.warnings: list[str] = []

    def fail(self, key: str, message: str) -> NoReturn:
        line = self.toml.line("camera", self.index, key)
        raise InputError(self.toml.path, f"camera {self.keys.id!r}: {key}: {message}", line=line)

    def read(self) -> FlightCamera:
        keys = self.keys
        self._check_values()
        calibration = self._existing("calibration", keys.calibration, fragment=True)
        intrinsics, calibrated_rate_hz = read_calibration(calibration, keys.id)
        detections, timestamps = self._detections()
        frame_rate_hz = self._frame_rate_hz(keys.frame_rate_hz or calibrated_rate_hz, timestamps)
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
            timestamps=timestamps,
            start_time=keys.start_time,
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

    def _detections(self) -> tuple[RawDetections, Timestamps | None]:
        """The detections with their time stamps, where there are any."""
        keys = self.keys
        path = self._existing("detections", keys.detections or "")
        detections = read_detections(path, keys.detections_columns)
        if detections.time_s is not None:
            if keys.timestamps is not None:
                self.fail("timestamps", f"{path} has time stamps of its own; give one or the other")
            frame, first = np.unique(detections.frame, return_index=True)
            return detections, Timestamps(path, frame, detections.time_s[first]) if len(frame) else None
        if keys.timestamps is None:
            return detections, None
        stamps = read_timestamps(self._existing("timestamps", keys.timestamps))
        time_s, known = stamps.at(detections.frame)
        if not known.all():
            row = int(np.argmin(known))
            message = (
                f"frame {detections.frame[row]} has no time stamp in {stamps.path} "
                f"(frames {stamps.frame[0]} to {stamps.frame[-1]})"
            )
            if stamps.complete:
                message += "; frames count from 0 in the video that was listed, not in one converted from it"
            raise InputError(path, message, line=int(detections.line[row]))
        return replace(detections, time_s=time_s), stamps

    def _frame_rate_hz(self, nominal_hz: float | None, stamps: Timestamps | None) -> float:
        """The nominal frame rate, or where the time stamps tell another one theirs."""
        stamped_hz = None if stamps is None else typical_rate_hz(stamps.frame, stamps.time_s)
        if stamped_hz is None:
            if nominal_hz is None:
                self.fail("frame_rate_hz", "no frame rate: give it here, or in the calibration, or give time stamps")
            return nominal_hz
        assert stamps is not None  # they told a rate
        if mistake := wrong_unit(stamped_hz, nominal_hz):
            self.fail("timestamps" if self.keys.timestamps else "detections", f"{stamps.path}: {mistake}")
        if nominal_hz is None or abs(nominal_hz / stamped_hz - 1) <= _CONTRADICTION:
            return nominal_hz or stamped_hz
        given = "frame_rate_hz" if self.keys.frame_rate_hz else "its calibration"
        self.warnings.append(
            f"Camera {self.keys.id}: its time stamps tell {stamped_hz:.4g} frames a second, {given} {nominal_hz:.4g}. "
            "The time stamps are used; if they are those of a slowed-down or converted video, leave them out."
        )
        return stamped_hz


def _vector(values: Vector3 | None) -> FloatArray | None:
    return None if values is None else np.array(values)
