"""What is known of a camera before (Intrinsics) and what is estimated of its time base (Clock)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from skytrace.geometry import projection
from skytrace.geometry.arrays import BoolArray, FloatArray, frozen_array
from skytrace.geometry.projection import COEFFICIENTS, LensModel


@dataclass(frozen=True, eq=False, slots=True)
class LensDeviation:
    """Standard deviations of a calibration."""

    focal: float  # of the focal length, relative
    aspect: float  # of fy / fx, relative
    principal_px: FloatArray  # (2,)
    distortion: FloatArray  # as many as there are coefficients

    def __post_init__(self) -> None:
        object.__setattr__(self, "principal_px", frozen_array(self.principal_px, (2,), "principal_px"))
        object.__setattr__(self, "distortion", frozen_array(self.distortion, (None,), "distortion"))
        values = np.concatenate([[self.focal, self.aspect], self.principal_px, self.distortion])
        if not (np.isfinite(values) & (values >= 0)).all():
            raise ValueError(f"deviations: expected numbers from 0, got {values.tolist()}")


@dataclass(frozen=True, eq=False, slots=True)
class Intrinsics:
    """A camera's lens: "pinhole" with radial and tangential distortion, or "fisheye" (Kannala-Brandt).

    Frame: x right, y down, z forward; the centre of the top-left pixel is (0, 0).
    """

    focal_px: FloatArray  # (2,) fx, fy
    principal_px: FloatArray  # (2,) cx, cy
    distortion: FloatArray  # (5,) k1 k2 p1 p2 k3, of a fisheye (4,) k1 k2 k3 k4
    size_px: tuple[int, int]  # width, height
    model: LensModel = "pinhole"
    deviation: LensDeviation | None = None  # where the calibration tells it
    radial_doubted: bool = False  # a flight contradicts the radial distortion

    def __post_init__(self) -> None:
        object.__setattr__(self, "focal_px", frozen_array(self.focal_px, (2,), "focal_px"))
        object.__setattr__(self, "principal_px", frozen_array(self.principal_px, (2,), "principal_px"))
        if self.model not in COEFFICIENTS:
            raise ValueError(f"model: expected one of {', '.join(COEFFICIENTS)}, got {self.model!r}")
        coefficients = (len(COEFFICIENTS[self.model]),)
        object.__setattr__(self, "distortion", frozen_array(self.distortion, coefficients, "distortion"))
        if self.deviation is not None and self.deviation.distortion.shape != coefficients:
            raise ValueError(
                f"deviation: expected {coefficients[0]} of the distortion, got {self.deviation.distortion}"
            )
        object.__setattr__(self, "size_px", (int(self.size_px[0]), int(self.size_px[1])))
        if (self.focal_px <= 0).any():
            raise ValueError(f"focal_px: expected positive values, got {self.focal_px.tolist()}")
        if min(self.size_px) <= 0:
            raise ValueError(f"size_px: expected positive width and height, got {self.size_px}")

    @property
    def height_px(self) -> int:
        return self.size_px[1]

    def project(self, point_in_camera: FloatArray) -> FloatArray:
        """Raw pixels (n, 2) of points (n, 3) in the camera frame; NaN behind the camera."""
        return projection.project(point_in_camera, self.focal_px, self.principal_px, self.distortion, self.model)

    def undistort(self, xy_px: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Coordinates (n, 2) on the plane z = 1 of raw pixels (n, 2), and where the lens model could be inverted."""
        xy_distorted = (np.asarray(xy_px) - self.principal_px) / self.focal_px
        return projection.undistort(xy_distorted, self.distortion, self.model)

    @property
    def one_to_one_radius(self) -> float:
        """Radius on the plane z = 1 beyond which the lens model folds back on itself or ends; inf if nowhere."""
        return projection.one_to_one_radius(self.distortion, self.model)

    def rays(self, xy_px: FloatArray) -> FloatArray:
        """Unit rays (n, 3) in the camera frame of raw pixels (n, 2)."""
        return projection.to_rays(self.undistort(xy_px)[0])


@dataclass(frozen=True, slots=True)
class Clock:
    """When a camera exposed a row: t = offset_s + period_s * frame + readout_s * row / height.

    t is in seconds on the reference camera's clock, the row is counted in the raw image. offset and period are the
    paper's beta and alpha; `readout_s` is the time from the first to the last row.
    """

    offset_s: float
    period_s: float
    readout_s: float = 0.0
    height_px: int = field(default=1, repr=False)

    def __post_init__(self) -> None:
        if not self.period_s > 0:
            raise ValueError(f"period_s: expected a positive number, got {self.period_s}")

    def world_time(self, frame: FloatArray, row_px: FloatArray) -> FloatArray:
        """Time in seconds on the reference clock of rows of frames, arrays that broadcast together."""
        row_fraction = np.asarray(row_px) / self.height_px
        return self.offset_s + self.period_s * np.asarray(frame) + self.readout_s * row_fraction

    def frame_at(self, time_s: FloatArray, row_px: FloatArray) -> FloatArray:
        """The fractional frame whose given row was exposed at a time: the inverse of `world_time`."""
        row_fraction = np.asarray(row_px) / self.height_px
        return (np.asarray(time_s) - self.offset_s - self.readout_s * row_fraction) / self.period_s
