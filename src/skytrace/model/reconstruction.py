"""Estimated things: where each camera stood, how its clock ran, and the target's path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

import numpy as np

from skytrace.geometry.arrays import BoolArray, FloatArray, IntArray, frozen_array
from skytrace.geometry.rigid import Rigid
from skytrace.model.camera import Clock, Intrinsics
from skytrace.model.georeference import Georeference
from skytrace.model.trajectory import Trajectory

Gauge = Literal["arbitrary", "metric"]
Frame = Literal["camera", "level", "given", "enu"]


@dataclass(frozen=True, eq=False, slots=True)
class TwoView:
    """Relative geometry and time of two cameras."""

    camera0: str
    camera1: str
    camera1_from_camera0: Rigid  # unit baseline
    offset_s: float  # camera time of camera 1 = offset_s + rate * camera time of camera 0
    rate: float
    inlier_s: float  # seconds of common view that obey the geometry
    score: float


@dataclass(frozen=True, slots=True)
class ClockDeviation:
    """Posterior standard deviations of a clock; 0 for what the gauge fixes."""

    offset_s: float
    period_s: float
    readout_s: float


@dataclass(frozen=True, eq=False, slots=True)
class Residuals:
    """What the estimate leaves unexplained of one camera's detections, those used in the adjustment."""

    frame: IntArray  # (n,)
    time_s: FloatArray  # (n,) on the reference clock
    measured_px: FloatArray  # (n, 2) raw pixels
    error_px: FloatArray  # (n, 2) projected minus measured
    inlier: BoolArray  # (n,) detections that agree with the estimate

    def __post_init__(self) -> None:
        object.__setattr__(self, "frame", frozen_array(self.frame, (None,), "frame", np.int64))
        n = len(self.frame)
        object.__setattr__(self, "time_s", frozen_array(self.time_s, (n,), "time_s"))
        object.__setattr__(self, "measured_px", frozen_array(self.measured_px, (n, 2), "measured_px"))
        object.__setattr__(self, "error_px", frozen_array(self.error_px, (n, 2), "error_px"))
        object.__setattr__(self, "inlier", frozen_array(self.inlier, (n,), "inlier", np.bool_))

    @property
    def median_px(self) -> float:
        """Median length of the reprojection errors of every detection used, outliers included."""
        return float(np.median(np.linalg.norm(self.error_px, axis=1))) if len(self.frame) else float("nan")


@dataclass(frozen=True, eq=False, slots=True)
class CameraEstimate:
    """A registered camera."""

    camera_from_world: Rigid
    clock: Clock
    calibrated: Intrinsics
    refined: Intrinsics
    residuals: Residuals
    sigma_px: float  # robust deviation of the residuals per axis
    clock_deviation: ClockDeviation
    centre_covariance: FloatArray  # (3, 3) in world units

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre_covariance", frozen_array(self.centre_covariance, (3, 3), "centre_covariance"))

    @property
    def centre_deviation(self) -> FloatArray:
        """Standard deviations (3,) of the centre along the world's axes."""
        return np.sqrt(np.maximum(np.diag(self.centre_covariance), 0.0))


@dataclass(frozen=True, eq=False, slots=True)
class Reconstruction:
    """Everything recovered. A camera that was not registered is absent from `cameras` and named in `unregistered`.

    The world's `frame` is the reference camera's ("camera"); the same with z up and y where it looks ("level"); that of
    given positions ("given"); or metres east, north and up of an origin on the earth ("enu", see `georeference`).
    """

    reference: str
    cameras: Mapping[str, CameraEstimate]
    trajectory: Trajectory
    gauge: Gauge = "arbitrary"
    unregistered: Mapping[str, str] = field(default_factory=dict)  # camera id -> reason
    frame: Frame = "camera"
    georeference: Georeference | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", MappingProxyType(dict(self.cameras)))
        object.__setattr__(self, "unregistered", MappingProxyType(dict(self.unregistered)))
        if self.reference not in self.cameras:
            raise ValueError(f"reference: {self.reference!r} is not a registered camera")

    @property
    def frame_in_words(self) -> str:
        """Axes and origin of the world."""
        if self.georeference is not None and self.frame == "enu":
            return f"{self.georeference.in_words}"
        if self.frame in ("given", "enu"):
            return "that of the given positions"
        if self.frame == "level":
            return f"z up, y where camera {self.reference} looks, its centre the origin"
        return f"that of camera {self.reference}: x to its right, y down, z forward, its centre the origin"
