"""What an adjustment assumes before it sees the data, and what it may move."""

from __future__ import annotations

from dataclasses import dataclass

from skytrace.estimation.adjust.losses import LossKind
from skytrace.estimation.priors import PriorKind


@dataclass(frozen=True, slots=True)
class AdjustSettings:
    """Prior deviations are those of real consumer cameras and their calibrations, not tuned to a recording."""

    motion_prior: PriorKind = "jerk"
    motion_prior_weight: float | None = None  # as `MotionPrior.relative_weight`, in s, s^3 or s^5; none: automatic
    loss: LossKind = "cauchy"
    loss_scale: float = 2.0
    rate_sigma: float = 1e-3
    readout_fraction: float = 0.6  # of a frame period
    readout_sigma: float = 0.1
    focal_sigma: float = 0.02
    aspect_sigma: float = 0.0035  # of a calibration's fy / fx
    standard_aspect_sigma: float = 0.001  # of standard pixels: scaling rounds pictures to multiples of a few rows
    principal_sigma: float = 0.007  # of the focal length
    centring_sigma: float = 0.008  # of the image's larger side: between principal point and the image's middle
    radial_sigma: tuple[float, float, float] = (0.07, 0.2, 0.2)
    fisheye_radial_sigma: tuple[float, float, float] = (0.02, 0.04, 0.04)  # in the angle, which reaches 1 and beyond
    focusing_sigma: float = 0.01  # of the focal length, between the board and the flight
    principal_focusing_sigma: float = 0.002  # of the focal length
    smallest_sigma_ratio: float = 1.0  # of the median camera's: the trajectory follows what counts more
    tolerance: float = 1e-6


@dataclass(frozen=True, slots=True)
class Freedom:
    """Which groups of parameters an adjustment may move."""

    rolling_shutter: bool = True
    focal: bool = True
    lens: bool = True  # aspect, principal point, radial distortion
    clocks: bool = True  # offset and rate
