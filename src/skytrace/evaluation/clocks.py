"""Error of the reconstructed synchronisation against known corresponding frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.model.camera import Clock

VIDEO_RATE_HZ = 30.0  # the unit "frame at 30 fps" makes cameras of different rates comparable


@dataclass(frozen=True, slots=True)
class ClockError:
    """Absolute error of one camera's time against the base camera's, over the covered time."""

    mean_s: float
    median_s: float
    max_s: float
    mean_base_frames: float  # in frames of the base camera
    mean_own_frames: float  # in frames of the camera itself

    @property
    def mean_frames_30fps(self) -> float:
        return self.mean_s * VIDEO_RATE_HZ


@dataclass(frozen=True, eq=False, slots=True)
class SynchronisationErrors:
    """Clock errors of every camera with a known synchronisation but the base, whose frames the others are tied to."""

    base: str
    error: Mapping[str, ClockError]

    def __post_init__(self) -> None:
        object.__setattr__(self, "error", MappingProxyType(dict(self.error)))

    @property
    def mean_s(self) -> float:
        return float(np.mean([e.mean_s for e in self.error.values()]))

    @property
    def median_s(self) -> float:
        return float(np.median([e.mean_s for e in self.error.values()]))

    @property
    def max_s(self) -> float:
        return max(e.max_s for e in self.error.values())

    @property
    def mean_base_frames(self) -> float:
        return float(np.mean([e.mean_base_frames for e in self.error.values()]))

    @property
    def mean_frames_30fps(self) -> float:
        return self.mean_s * VIDEO_RATE_HZ


def synchronisation_errors(
    clocks: Mapping[str, Clock],
    known: Mapping[str, tuple[float, float]],
    covered_time_s: FloatArray,
    row_fraction: float = 0.5,
) -> SynchronisationErrors:
    """Errors of clocks by camera id at times (n,) that sample the covered time evenly.

    `known` holds (slope, intercept) by camera id: frame = slope * reference_frame + intercept. The base is the
    reference itself (1, 0), or the first known camera that has a clock where the reference was not reconstructed.
    Frames correspond when their rows at `row_fraction` of the image height were exposed together. Raises ValueError
    when fewer than two known cameras have a clock, or no time is covered.
    """
    common = [camera for camera in known if camera in clocks]
    if len(common) < 2:
        raise ValueError(f"synchronisation: at least 2 cameras with known correspondence are needed, got {len(common)}")
    time_s = np.asarray(covered_time_s, float)
    if time_s.ndim != 1 or len(time_s) == 0:
        raise ValueError(f"covered_time_s: expected shape (n >= 1,), got {time_s.shape}")
    base = next((camera for camera in common if np.allclose(known[camera], (1.0, 0.0), 0, 1e-9)), common[0])
    base_clock = clocks[base]
    base_frame = base_clock.frame_at(time_s, np.array(row_fraction * base_clock.height_px))
    reference_frame = (base_frame - known[base][1]) / known[base][0]
    errors = {}
    for camera in common:
        if camera == base:
            continue
        clock, (slope, intercept) = clocks[camera], known[camera]
        frame = clock.frame_at(time_s, np.array(row_fraction * clock.height_px))
        error_s = np.abs(frame - (slope * reference_frame + intercept)) * clock.period_s
        mean_s = float(error_s.mean())
        errors[camera] = ClockError(
            mean_s=mean_s,
            median_s=float(np.median(error_s)),
            max_s=float(error_s.max()),
            mean_base_frames=mean_s / base_clock.period_s,
            mean_own_frames=mean_s / clock.period_s,
        )
    return SynchronisationErrors(base, errors)
