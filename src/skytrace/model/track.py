"""Measured things: where a camera saw the target, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.geometry.arrays import FloatArray, IntArray, frozen_array
from skytrace.model.camera import Intrinsics


@dataclass(frozen=True, eq=False, slots=True)
class Track:
    """Image positions of one target in one camera, frames strictly increasing."""

    frame: IntArray  # (n,)
    xy_px: FloatArray  # (n, 2) raw (distorted) pixels
    sigma_px: FloatArray | None = None  # (n,) standard deviation per axis, where the detector gives one
    time_s: FloatArray | None = None  # (n,) the frames' time stamps on the camera's own clock, where known

    def __post_init__(self) -> None:
        object.__setattr__(self, "frame", frozen_array(self.frame, (None,), "frame", np.int64))
        n = len(self.frame)
        object.__setattr__(self, "xy_px", frozen_array(self.xy_px, (n, 2), "xy_px"))
        if n and (np.diff(self.frame) <= 0).any():
            raise ValueError("frame: expected strictly increasing frame numbers")
        if self.sigma_px is not None:
            object.__setattr__(self, "sigma_px", frozen_array(self.sigma_px, (n,), "sigma_px"))
            if (self.sigma_px <= 0).any():
                raise ValueError("sigma_px: expected positive deviations")
        if self.time_s is not None:
            object.__setattr__(self, "time_s", frozen_array(self.time_s, (n,), "time_s"))
            if n and (np.diff(self.time_s) <= 0).any():
                raise ValueError("time_s: expected strictly increasing time stamps")

    def __len__(self) -> int:
        return len(self.frame)

    def select(self, index: object) -> Track:
        """The detections chosen by a slice, mask or increasing index array."""
        return Track(
            self.frame[index],  # type: ignore[index]
            self.xy_px[index],  # type: ignore[index]
            None if self.sigma_px is None else self.sigma_px[index],  # type: ignore[index]
            None if self.time_s is None else self.time_s[index],  # type: ignore[index]
        )


@dataclass(frozen=True, eq=False, slots=True)
class Recording:
    """One camera's measurements of the target: its lens, nominal frame rate and tracks in order of time."""

    camera_id: str
    intrinsics: Intrinsics
    frame_rate_hz: float
    tracks: tuple[Track, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "tracks", tuple(self.tracks))
        if not (np.isfinite(self.frame_rate_hz) and self.frame_rate_hz > 0):
            raise ValueError(f"frame_rate_hz: expected a positive number, got {self.frame_rate_hz}")

    def camera_time_s(self, track: Track) -> FloatArray:
        """Time (n,) of a track's frames on the camera's own clock: its time stamps, else frame / nominal rate."""
        return track.frame / self.frame_rate_hz if track.time_s is None else track.time_s

    @property
    def stamped(self) -> bool:
        """Whether every track carries its frames' time stamps."""
        return bool(self.tracks) and all(track.time_s is not None for track in self.tracks)

    def frame_line(self) -> tuple[float, float]:
        """(time of frame 0, seconds a frame): the straight line through the camera times of the detections' frames.

        Without time stamps that is (0, 1 / frame_rate_hz); with them the least-squares line.
        """
        period_s = 1 / self.frame_rate_hz
        if not self.stamped or self.n_detections < 2:
            return 0.0, period_s
        frame = np.concatenate([track.frame for track in self.tracks]).astype(np.float64)
        time_s = np.concatenate([self.camera_time_s(track) for track in self.tracks])
        from_mean = frame - frame.mean()
        if from_mean.any():
            period_s = float(from_mean @ (time_s - time_s.mean()) / (from_mean @ from_mean))
        return float(time_s.mean() - period_s * frame.mean()), period_s

    @property
    def n_detections(self) -> int:
        return sum(len(track) for track in self.tracks)
