"""What an adjustment assumes before it sees the data, and what it may move."""

from __future__ import annotations

from dataclasses import dataclass

from skytrace.estimation.adjust.losses import LossKind
from skytrace.estimation.priors import PriorKind


@dataclass(frozen=True, slots=True)
class AdjustSettings:
    """Prior deviations are those of real consumer cameras and their calibrations, not tuned to a recording."""

    motion_prior: PriorKind = "jerk"
    loss: LossKind = "cauchy"
    loss_scale: float = 2.0
    rate_sigma: float = 1e-3
    readout_fraction: float = 0.6  # of a frame period
    readout_sigma: float = 0.1
    focal_sigma: float = 0.02
    aspect_sigma: float = 0.0035
    principal_sigma: float = 0.007  # of the focal length
    radial_sigma: tuple[float, float, float] = (0.07, 0.2, 0.2)
    smallest_sigma_ratio: float = 0.5  # of the median camera's
    tolerance: float = 1e-6


@dataclass(frozen=True, slots=True)
class Freedom:
    """Which groups of parameters an adjustment may move."""

    rolling_shutter: bool = True
    focal: bool = True
    lens: bool = True  # aspect, principal point, radial distortion
    clocks: bool = True  # offset and rate
