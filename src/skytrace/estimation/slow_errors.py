"""What errors that last for seconds do to the estimate, given how it answers to each block of detections.

A slow error is a process of unit variance with autocorrelation exp(-lag / T) along either image axis. Its exponential
memory turns sums over all pairs of blocks into recursions along them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skytrace.estimation.influence import Influence
from skytrace.geometry.arrays import FloatArray


def slow_gradient(influence: Influence, slow_px2: FloatArray, correlation_s: float) -> FloatArray:
    """Covariance (p, p) of the cameras' gradient under slow errors of variances (c,), the spline eliminated."""
    total = np.zeros((influence.n_unknowns, influence.n_unknowns))
    for blocks, score, variance in zip(influence.blocks, influence.scores(), slow_px2, strict=True):
        if variance > 0:
            total += variance * _summed_products(blocks.time_s, score, correlation_s)
    return total


def gradient_and_positions(
    influence: Influence,
    slow_px2: FloatArray,
    correlation_s: float,
    at_s: FloatArray,
    displacements: Sequence[FloatArray],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Joint covariance of the cameras' gradient and of positions at times (k,) that move with the errors there.

    `displacements` are those (k, 3, 2) of the positions by a pixel of error in each camera, the cameras held. Returns
    the covariance (p, p) of the gradient, the variances (k, 3) of the positions, and their covariance (k, 3, p).
    """
    p = influence.n_unknowns
    gradient, positions, both = np.zeros((p, p)), np.zeros((len(at_s), 3)), np.zeros((len(at_s), 3, p))
    cameras = zip(influence.blocks, influence.scores(), displacements, slow_px2, strict=True)
    for blocks, score, displacement, variance in cameras:
        if variance > 0 and len(blocks.time_s):
            gradient += variance * _summed_products(blocks.time_s, score, correlation_s)
            positions += variance * (displacement**2).sum(axis=-1)
            smoothed = _smoothed(blocks.time_s, score, correlation_s, at_s)
            both += variance * displacement @ smoothed.transpose(0, 2, 1)
    return gradient, positions, both


def absorbed_at(
    influence: Influence, slow_px2: FloatArray, correlation_s: float, gradient: FloatArray, longest_s: float
) -> tuple[FloatArray, FloatArray]:
    """What fitting the cameras' unknowns takes out of sums of products of residuals: lags (l,) and sums (l,) at these.

    `gradient` (p, p) is the covariance of `slow_gradient`. Residuals are those the spline has left; each product of two
    is weighted like the first. With K the response, G the gradient and A the derivatives of the residuals, fitting adds
    A K G to the residuals: that takes out twice the covariance of A K G with them, and puts in that of A K G itself.
    """
    spacing_s = influence.adjusted.problem.grid.spacing_s
    lags = np.unique(np.geomspace(1, max(longest_s / spacing_s, 1) + 1, 12).astype(np.int64)) - 1
    unknowns = influence.response @ gradient @ influence.response
    out = np.zeros(len(lags))
    cameras = zip(influence.blocks, influence.scores(), slow_px2, strict=True)
    for blocks, score, variance in cameras:
        if not len(blocks.time_s):
            continue
        along = score.transpose(0, 2, 1)  # (b, 2, p)
        followed = variance * _smoothed(blocks.time_s, score, correlation_s, blocks.time_s).transpose(0, 2, 1)
        answer, spread = followed @ influence.response, along @ unknowns
        interval = np.floor(blocks.time_s / spacing_s).astype(np.int64)
        row = np.full(interval[-1] - interval[0] + lags[-1] + 1, -1)
        row[interval - interval[0]] = np.arange(len(interval))
        for k, lag in enumerate(lags):
            one = np.flatnonzero(row[interval - interval[0] + lag] >= 0)
            other = row[interval[one] - interval[0] + lag]
            taken = (answer[one] * along[other]).sum()
            put = (spread[one] * along[other]).sum(axis=(1, 2)) @ (1 / np.maximum(blocks.weight[other], 1e-300))
            # Blocks without a partner so much later count as those with one.
            out[k] += (2 * taken - put) * len(interval) / max(len(one), 1)
    return np.asarray(spacing_s * lags, np.float64), out


def _decayed(time_s: FloatArray, score: FloatArray, correlation_s: float) -> FloatArray:
    """Sums (b, ...) over the blocks up to each of exp(-lag / T) score, at ascending times (b,)."""
    from scipy.linalg import solve_banded

    band = np.ones((2, len(time_s)))
    band[1, :-1] = -np.exp(-np.diff(time_s) / correlation_s)
    return solve_banded((1, 0), band, score.reshape(len(time_s), -1), check_finite=False).reshape(score.shape)


def _summed_products(time_s: FloatArray, score: FloatArray, correlation_s: float) -> FloatArray:
    """Sum (p, p) over pairs of blocks of exp(-lag / T) score score^T, for scores (b, p, 2) at times (b,)."""
    p = score.shape[1]
    past = (_decayed(time_s, score, correlation_s) - 0.5 * score).transpose(0, 2, 1).reshape(-1, p)
    half = past.T @ score.transpose(0, 2, 1).reshape(-1, p)
    return half + half.T


def _smoothed(time_s: FloatArray, score: FloatArray, correlation_s: float, at_s: FloatArray) -> FloatArray:
    """Sums (k, p, 2) over all blocks of exp(-lag / T) score, at times (k,)."""
    padded = np.concatenate([np.zeros((1, *score.shape[1:])), _decayed(time_s, score, correlation_s)])
    before = np.searchsorted(time_s, at_s, side="right")
    lag_s = np.where(before > 0, at_s - time_s[before - 1], 0.0)
    out = padded[before] * np.exp(-lag_s / correlation_s)[:, None, None]
    future = _decayed(-time_s[::-1], score[::-1], correlation_s)[::-1]
    padded = np.concatenate([future, np.zeros((1, *score.shape[1:]))])
    lag_s = np.where(before < len(time_s), time_s[np.minimum(before, len(time_s) - 1)] - at_s, 0.0)
    return out + padded[before] * np.exp(-lag_s / correlation_s)[:, None, None]
