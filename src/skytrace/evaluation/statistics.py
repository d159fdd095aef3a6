"""The figures that describe a set of errors, and groups of errors side by side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.geometry.arrays import BoolArray, FloatArray, IntArray

OUTLIER_FACTOR = 3.0  # an outlier errs by more than this many RMSE


@dataclass(frozen=True, slots=True)
class ErrorStatistics:
    """Figures of n distances, in their unit."""

    n: int
    mean: float
    rmse: float
    median: float
    outlier_percent: float  # share of errors above 3 RMSE
    max: float

    @classmethod
    def of(cls, error: FloatArray) -> ErrorStatistics:
        """Statistics of errors (n,). Raises ValueError when there are none."""
        error = np.asarray(error, float)
        if error.ndim != 1 or len(error) == 0:
            raise ValueError(f"error: expected shape (n >= 1,), got {error.shape}")
        rmse = float(np.sqrt(np.mean(error**2)))
        outliers = 100 * float(np.mean(error > OUTLIER_FACTOR * rmse))
        return cls(len(error), float(error.mean()), rmse, float(np.median(error)), outliers, float(error.max()))


@dataclass(frozen=True, slots=True)
class ErrorGroup:
    """Statistics of the samples whose number of cameras, or posterior deviation, lies in [low, high]."""

    low: float
    high: float
    statistics: ErrorStatistics


def keep_within(error: FloatArray, factor: float) -> BoolArray:
    """Which errors (n,) are at most `factor` times their mean."""
    return np.asarray(error) <= factor * np.mean(error)


def by_count(error: FloatArray, count: IntArray) -> tuple[ErrorGroup, ...]:
    """Statistics of errors (n,) by the number of cameras (n,) that saw the target."""
    return tuple(ErrorGroup(int(c), int(c), ErrorStatistics.of(error[count == c])) for c in np.unique(count))


def by_quantile(error: FloatArray, deviation: FloatArray, n_groups: int = 4) -> tuple[ErrorGroup, ...]:
    """Statistics of errors (n,) by posterior deviation (n,), in groups of (nearly) equal size, most certain first.

    Samples without a finite deviation are left out.
    """
    known = np.isfinite(deviation)
    order = np.flatnonzero(known)[np.argsort(deviation[known], kind="stable")]
    if len(order) and deviation[order[0]] == deviation[order[-1]]:
        n_groups = 1  # nothing to tell groups apart by
    parts = [part for part in np.array_split(order, n_groups) if len(part)]
    return tuple(
        ErrorGroup(float(deviation[part[0]]), float(deviation[part[-1]]), ErrorStatistics.of(error[part]))
        for part in parts
    )
