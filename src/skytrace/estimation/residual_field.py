"""Whether what a camera's detections leave unexplained depends on where in the image they lie.

A wrong lens errs alike wherever the target comes back to the same part of the image; detections that drift, and a
trajectory that is off for a while, do not. So residuals that lie close together in the image are multiplied with each
other only where they are far apart in time. What such products would be without any pattern is told by the residuals
themselves, shifted in time against their places: that keeps how they hang together in time and how the target moved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.geometry.arrays import FloatArray, IntArray

_BLOCK_S = 0.5  # residuals are averaged over this long, longer where the recording would give too many blocks
_MOST_BLOCKS = 1200
_APART_S = 15.0  # longer than detections drift
_WIDTH = 1 / 24  # of the image, over which a pattern holds
_SHIFTS = 199
_LEAST_SHIFTS = 39


@dataclass(frozen=True, slots=True)
class ResidualPattern:
    """How large the part of the residuals is that depends on the place in the image, and how sure that it exists."""

    rms_px: float  # root mean square along each axis; 0 where nothing repeats
    deviations: float  # above what residuals shifted in time show, in standard deviations of these
    chance: float  # share of the shifts, with none at all as one of them, that show as much
    shifts: int


def residual_pattern(
    time_s: FloatArray, xy_px: FloatArray, error_px: FloatArray, size_px: tuple[int, int]
) -> ResidualPattern | None:
    """The pattern of errors (n, 2) at places (n, 2) and times (n,) of detections that agree with the estimate.

    None where the target did not come back to the same places later often enough to tell.
    """
    if len(time_s) < 2:
        return None
    time, place, error = _blocks(time_s, xy_px / size_px[0], error_px)
    n = len(time)
    apart = np.abs(time[:, None] - time) > _APART_S
    near = np.where(apart, _nearness(place), 0.0)
    weight = near.sum()
    shifts = _shifts(time)
    if len(shifts) < _LEAST_SHIFTS or weight < n:
        return None
    error = error - error.mean(axis=0)
    shifted = error[(np.arange(n)[:, None] + np.r_[0, shifts]) % n]  # (n, 1 + s, 2)
    flat = shifted.reshape(n, -1)
    products = (flat * (near @ flat)).sum(axis=0).reshape(-1, 2).sum(axis=1) / (2 * weight)
    found, others = products[0], products[1:]
    excess = found - others.mean()
    return ResidualPattern(
        float(np.sqrt(max(excess, 0.0))),
        float(excess / max(others.std(), 1e-300)),
        float((1 + (others >= found).sum()) / (1 + len(others))),
        len(others),
    )


def _nearness(place: FloatArray) -> FloatArray:
    """From 1 for the same place to 0 beyond the width of a pattern: (n, n) for places (n, 2) in image widths."""
    squared = ((place[:, None] - place) ** 2).sum(axis=2)
    return np.exp(-0.5 * squared / _WIDTH**2)


def _shifts(time: FloatArray) -> IntArray:
    """Numbers of blocks to shift by, evenly spread over all that put residuals far from their own time."""
    n = len(time)
    rest = int(np.ceil(_APART_S * n / max(time[-1] - time[0], 1e-9))) if n else 0
    possible = np.arange(rest, n - rest, dtype=np.int64)
    if len(possible) <= _SHIFTS:
        return possible
    return possible[np.round(np.linspace(0, len(possible) - 1, _SHIFTS)).astype(np.int64)]


def _blocks(time_s: FloatArray, place: FloatArray, error_px: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means over blocks of time: times (b,), places (b, 2), errors (b, 2)."""
    span_s = float(np.ptp(time_s))
    block_s = max(_BLOCK_S, span_s / _MOST_BLOCKS)
    _, block, count = np.unique(
        np.floor((time_s - time_s.min()) / block_s).astype(np.int64), return_inverse=True, return_counts=True
    )

    def mean(values: FloatArray) -> FloatArray:
        return np.bincount(block, values) / count

    columns = [mean(v) for v in (time_s, *place.T, *error_px.T)]
    return columns[0], np.column_stack(columns[1:3]), np.column_stack(columns[3:5])
