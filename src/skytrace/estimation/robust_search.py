"""The search over offsets made robust: false detections that survived cleaning no longer hide the right one.

`offset_search` fits one epipolar geometry to everything that overlaps; a second of false detections spoils such a least
squares fit. Here the same linear problem is solved by iteratively reweighted least squares at every offset of a grid.
"""

from __future__ import annotations

import numpy as np

from skytrace.estimation.offset_search import ShiftScores, homogeneous, whitening
from skytrace.geometry.arrays import BoolArray, FloatArray, IntArray

_SCALE = 3.0  # of the loss, in median absolute residuals
_FLOOR = 1e-4  # smallest residual that counts, in units of the whitened problem
_SHARE = 0.8  # of the samples that must fit


def paired_rows(
    seen0: BoolArray, seen1: BoolArray, motion0: FloatArray, motion1: FloatArray, shift: int, count: int
) -> tuple[IntArray, float]:
    """Rows (count,) of track 0 seen by both at a shift, evenly spread over the motion; the effective rows among them.

    `seen` (n,) are truth values and `motion` (n,) weights: rows in which a target hovers fit any geometry.
    """
    begin, end = max(0, -shift), min(len(seen0), len(seen1) - shift)
    rows = begin + np.flatnonzero(seen0[begin:end] & seen1[begin + shift : end + shift])
    reached = np.cumsum(np.sqrt(motion0[rows] * motion1[rows + shift]))
    at = (np.arange(count) + 0.5) / count * reached[-1]
    return rows[np.searchsorted(reached, at)], float(reached[-1])


def motion_weights(xy: FloatArray) -> FloatArray:
    """Weights (n,) between 0 and 1.5 of a track's samples (n, 2) by their speed against the track's usual one."""
    speed = np.linalg.norm(np.gradient(xy, axis=0), axis=1)
    known = np.isfinite(speed)
    if not known.any():
        return np.ones(len(xy))
    usual = max(float(np.quantile(speed[known], 0.6)), 1e-12)
    speed = np.where(known, speed, usual)  # beside gaps
    return np.clip(2 * speed / (speed + usual), 0.02, 1.5)


def robust_scores(
    xy0: FloatArray,
    xy1: FloatArray,
    shift: IntArray,
    rate_hz: float,
    free_parameters_s: float = 8.0,
    count: int = 120,
    iterations: int = 3,
) -> ShiftScores:
    """Score shifts (m,) of two tracks (n0, 2), (n1, 2) at one rate on the plane z = 1, NaN where not seen.

    As `offset_search.score_shifts`, but the geometry is fitted with Geman-McClure weights to at most `count` samples,
    spread evenly over the motion, and rho is the mean over the better `_SHARE` of the squared residuals. Every shift
    must leave some samples that both saw.
    """
    y0, y1 = homogeneous(xy0), homogeneous(xy1)
    seen0, seen1 = np.isfinite(xy0[:, 0]), np.isfinite(xy1[:, 0])
    motion0, motion1 = motion_weights(xy0), motion_weights(xy1)
    overlap = np.empty(len(shift))
    paired = np.empty((2, len(shift), count, 3))
    for k, s in enumerate(shift):
        rows, overlap[k] = paired_rows(seen0, seen1, motion0, motion1, int(s), count)
        paired[0, k], paired[1, k] = y0[rows], y1[rows + s]
    white0, white1 = _white(paired[0]), _white(paired[1])
    equations = (white0[:, :, :, None] * white1[:, :, None, :]).reshape(len(shift), count, 9)
    weight = np.ones((len(shift), count))
    residual = weight
    for _ in range(iterations + 1):
        normal = np.matmul((equations * weight[:, :, None]).transpose(0, 2, 1), equations)
        smallest = np.linalg.eigh(normal)[1][:, :, :1]
        residual = np.abs(np.matmul(equations, smallest)[:, :, 0])
        scale = _SCALE * np.median(residual, axis=1)[:, None] + _FLOOR
        weight = (1 + (residual / scale) ** 2) ** -2
    better = np.sort(residual**2, axis=1)[:, : round(_SHARE * count)]
    rho = np.clip(better.mean(axis=1), 1e-9, 1.0)
    score = -(overlap / rate_hz - free_parameters_s) * np.log(rho)
    return ShiftScores(np.asarray(shift), np.rint(overlap).astype(np.int64), rho, score)


def _white(y: FloatArray) -> FloatArray:
    """Coordinates (m, n, 3) with unit second moments in each of m sets."""
    return np.matmul(y, whitening(np.matmul(y.transpose(0, 2, 1), y) / y.shape[1]).transpose(0, 2, 1))
