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
from skytrace.io.detections import RawDetections, no_detections, parse_columns, read_detections
from skytrace.io.flight_schema import CameraKeys, Vector3
from skytrace.io.timestamps import Timestamps, read_timestamps, typical_rate_hz, wrong_unit
from skytrace.io.toml import TomlFile
from skytrace.io.tracks import read_about
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
    position_sigma_m: FloatArray | None = None  # (3,) deviations of the position along the axes, or east, north, up
    up_in_camera: FloatArray | None = None  # (3,) what points up, x to the right, y down, z forward
    up_sigma_deg: float | None = None
    readout_s: float | None = None  # known time from the first to the last row
    readout_sigma_s: float | None = None
    timestamps: Timestamps | None = None  # its time base, where it has one
    video: Path | None = None  # what the detections were found in
    start_time: datetime | None = None  # wall-clock time of frame 0, as the camera's or the container's clock had it
    device: str | None = None  # the same in all flights that it filmed

    def __post_init__(self) -> None:
        for name in ("position_m", "position_wgs84", "position_sigma_m", "up_in_camera"):
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

    def __init__(self, toml: TomlFile, index: int, keys: CameraKeys, tracks: Path | None = None) -> None:
        self.toml, self.index, self.keys = toml, index, keys
        self.tracks = tracks  # what was found in its video
        self.files: list[Path] = []
        self.warnings: list[str] = []
        self.created: datetime | None = None  # when its video says it was recorded

    def fail(self, key: str, message: str) -> NoReturn:
        line = self.toml.line("camera", self.index, key)
        raise InputError(self.toml.path, f"camera {self.keys.id!r}: {key}: {message}", line=line)

    def read(self) -> FlightCamera:
        keys = self.keys
        self._check_values()
        calibration = self._existing("calibration", keys.calibration, fragment=True)
        intrinsics, calibrated_rate_hz = read_calibration(calibration, keys.id)
        video = self.video(intrinsics)
        detections, timestamps = self._detections() if video is None else self._found(video)
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
            position_sigma_m=_along_axes(keys.position_sigma_m),
            up_in_camera=_vector(keys.up_in_camera),
            up_sigma_deg=keys.up_sigma_deg,
            readout_s=keys.readout_s,
            readout_sigma_s=keys.readout_sigma_s,
            timestamps=timestamps,
            video=video,
            start_time=keys.start_time,
            device=keys.device,
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
        if keys.video is None and keys.detections is None:
            self.fail("detections", "missing: expected the path of this camera's detections, or video = its path")
        if keys.video is not None and keys.detections_columns is not None:
            self.fail("detections_columns", "is for detections in a file; this camera has a video")
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
        self._check_deviations()

    def _check_deviations(self) -> None:
        """What is known beforehand, and how well."""
        keys = self.keys
        positioned = keys.position_m is not None or keys.position_wgs84 is not None
        for key, given, of in (
            ("position_sigma_m", positioned, "position_m or position_wgs84"),
            ("up_sigma_deg", keys.up_in_camera is not None, "up_in_camera"),
            ("readout_sigma_s", keys.readout_s is not None, "readout_s"),
        ):
            value = getattr(keys, key)
            if value is None:
                continue
            if not given:
                self.fail(key, f"given without {of}")
            if not all(math.isfinite(v) and v > 0 for v in (value if isinstance(value, tuple) else (value,))):
                shown = list(value) if isinstance(value, tuple) else f"{value:g}"
                self.fail(
                    key,
                    f"expected {'positive numbers' if isinstance(value, tuple) else 'a positive number'}, got {shown}",
                )
        if keys.up_in_camera is not None and not any(keys.up_in_camera):
            self.fail("up_in_camera", "expected a direction, such as [0, -1, 0] for a camera held level, got zeros")

    def _check_positions(self) -> None:
        for key in ("position_m", "position_wgs84", "up_in_camera"):
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

    def find_video(self) -> Path | None:
        """The path of its video, where it names one; everything that detection needs not wait for is checked."""
        if self.keys.video is None:
            return None
        self._check_values()
        calibration = self._existing("calibration", self.keys.calibration, fragment=True)
        return self.video(read_calibration(calibration, self.keys.id)[0])

    def video(self, intrinsics: Intrinsics) -> Path | None:
        """The path of its video, where it names one, which must have the size that the calibration is for."""
        if self.keys.video is None:
            return None
        # FFmpeg's libraries are slow to load.
        from skytrace.io.video_info import open_video

        path = self._existing("video", self.keys.video)
        info = open_video(path)
        self.created = info.created
        if info.size_px != intrinsics.size_px:
            sizes = [f"{w} x {h}" for w, h in (intrinsics.size_px, info.size_px)]
            hint = "calibrate with pictures of the video's size, as the sensor records them before any rotation"
            self.fail("calibration", f"is for pictures of {sizes[0]} px, the video's are {sizes[1]}; {hint}")
        return path

    def _found(self, video: Path) -> tuple[RawDetections, Timestamps | None]:
        """What was found in its video, with the container's time stamps unless a file of them is given."""
        if self.tracks is None:
            return no_detections(video), None
        self.files.append(self.tracks)
        about = read_about(self.tracks)
        self.warnings += [f"Camera {self.keys.id}: {video.name}: {message}" for message in about["warnings"]]
        if not about["tracks"]:
            return no_detections(video), None
        detections = read_detections(self.tracks)
        if self.keys.timestamps is not None:
            return self._stamped(replace(detections, time_s=None))
        assert detections.time_s is not None  # TRACKS have them
        return detections, Timestamps(self.tracks, detections.frame, detections.time_s)

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
        return self._stamped(detections)

    def _stamped(self, detections: RawDetections) -> tuple[RawDetections, Timestamps | None]:
        """Detections with the time stamps of the file of them, where one is given."""
        keys = self.keys
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
            raise InputError(detections.path, message, line=int(detections.line[row]))
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


def _along_axes(value: float | Vector3 | None) -> FloatArray | None:
    return None if value is None else np.broadcast_to(np.asarray(value, float), (3,))


def _vector(values: Vector3 | None) -> FloatArray | None:
    return None if values is None else np.array(values)
