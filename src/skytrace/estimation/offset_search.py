"""Every time offset of two cameras at once: how well does some epipolar geometry explain the shifted tracks?

For a shift s the epipolar constraint x1(t + s)^T E x0(t) = 0 is linear in the nine entries of E. Each entry of its
9 x 9 normal matrix is a sum over time of a quadratic monomial of one track times one of the other: a masked
cross-correlation, so a few dozen FFTs give the exact least-squares matrix at every shift.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.geometry.arrays import FloatArray, IntArray
from skytrace.solvers.correlation import cross_correlations

_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_PAIR_OF = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
_ONE = _PAIRS.index((2, 2))  # the third homogeneous coordinate is 1, so its square counts samples


@dataclass(frozen=True, eq=False, slots=True)
class ShiftScores:
    """Evidence for each shift: sample k of track 0 pairs with sample k + shift of track 1."""

    shift: IntArray  # (m,)
    overlap: IntArray  # (m,) paired samples
    rho: FloatArray  # (m,) smallest eigenvalue of the whitened normal matrix, 0 for a perfect fit, about 1 for chance
    score: FloatArray  # (m,) higher is better


def score_shifts(
    xy0: FloatArray, xy1: FloatArray, rate_hz: float, min_overlap_s: float, free_parameters_s: float = 8.0
) -> ShiftScores:
    """Score every shift of two tracks (n0, 2), (n1, 2) on the plane z = 1, sampled at one rate, NaN where not seen.

    The normal matrix is whitened by the Kronecker product of the two tracks' second moments inside the overlap, which
    makes its smallest eigenvalue rho invariant to where the cameras look. Short overlaps fit by chance, so the score is
    -(overlap - free_parameters) ln rho.
    """
    y0, y1 = homogeneous(xy0), homogeneous(xy1)
    n0, n1 = len(y0), len(y1)
    correlation = cross_correlations(_monomials(y0), _monomials(y1))  # (6, 6, lags)
    shift = np.arange(-(n0 - 1), n1)
    overlap = np.rint(correlation[_ONE, _ONE]).astype(np.int64)
    enough = overlap >= max(min_overlap_s * rate_hz, 16)
    shift, overlap, correlation = shift[enough], overlap[enough], correlation[:, :, enough]
    rho = _smallest_whitened_eigenvalue(correlation, overlap)
    score = -(overlap / rate_hz - free_parameters_s) * np.log(rho)
    return ShiftScores(shift, overlap, rho, score)


def peaks(score: FloatArray, shift: IntArray, count: int, separation: int) -> IntArray:
    """Indices of the best local maxima of scores (m,) at ascending shifts (m,), at least `separation` shifts apart."""
    around = np.r_[-np.inf, score, -np.inf]
    summits = np.flatnonzero((score >= around[:-2]) & (score >= around[2:]))
    chosen: list[int] = []
    for i in summits[np.argsort(score[summits])[::-1]]:
        if all(abs(shift[i] - shift[j]) >= separation for j in chosen):
            chosen.append(int(i))
            if len(chosen) == count:
                break
    return np.array(chosen, np.int64)


def turn_rate_correlation(xy0: FloatArray, xy1: FloatArray, rate_hz: float, min_overlap_s: float) -> ShiftScores:
    """Score every shift by the correlation of how fast the two image paths change their velocity.

    A sharp turn or a stop shows in every camera whatever its position, so this needs no geometry at all; it finds
    modes that outliers hide from the least-squares score.
    """
    a0, a1 = (_acceleration_log(xy, rate_hz) for xy in (xy0, xy1))
    m0, m1 = np.isfinite(a0).astype(float), np.isfinite(a1).astype(float)
    a0, a1 = np.nan_to_num(a0), np.nan_to_num(a1)
    left, right = np.stack([m0, a0, a0**2]), np.stack([m1, a1, a1**2])
    c = cross_correlations(left, right)
    n = np.maximum(c[0, 0], 1e-9)
    mean0, mean1 = c[1, 0] / n, c[0, 1] / n
    variance0, variance1 = c[2, 0] / n - mean0**2, c[0, 2] / n - mean1**2
    r = (c[1, 1] / n - mean0 * mean1) / np.sqrt(np.maximum(variance0 * variance1, 1e-12))
    shift = np.arange(-(len(xy0) - 1), len(xy1))
    overlap = np.rint(c[0, 0]).astype(np.int64)
    enough = overlap >= max(min_overlap_s * rate_hz, 16)
    r = np.clip(r[enough], -0.999, 0.999)
    fisher = np.arctanh(r) * np.sqrt(overlap[enough] / rate_hz)
    return ShiftScores(shift[enough], overlap[enough], 1 - r, fisher)


def homogeneous(xy: FloatArray) -> FloatArray:
    """Coordinates (n, 3) centred and scaled to unit spread over the whole track; NaN rows stay NaN."""
    seen = np.isfinite(xy[:, 0])
    if not seen.any():
        raise ValueError("track: expected at least one sample that is not NaN")
    centre, spread = xy[seen].mean(axis=0), max(float(xy[seen].std()), 1e-12)
    return np.column_stack([(xy - centre) / spread, np.where(seen, 1.0, np.nan)])


def _monomials(y: FloatArray) -> FloatArray:
    """The six distinct products (6, n) of homogeneous coordinates (n, 3), 0 where not seen."""
    return np.stack([np.nan_to_num(y[:, i] * y[:, j]) for i, j in _PAIRS])


def _smallest_whitened_eigenvalue(correlation: FloatArray, overlap: IntArray) -> FloatArray:
    moments0 = np.moveaxis(correlation[_PAIR_OF, _ONE], -1, 0) / overlap[:, None, None]
    moments1 = np.moveaxis(correlation[_ONE, _PAIR_OF], -1, 0) / overlap[:, None, None]
    W0, W1 = whitening(moments0), whitening(moments1)
    normal = correlation[_PAIR_OF[:, :, None, None], _PAIR_OF[None, None]] / overlap  # (p, q, r, s, m)
    normal = np.moveaxis(normal, -1, 0)
    white = np.einsum("map,mpqrs,mbq->mabrs", W0, normal, W0, optimize=True)
    white = np.einsum("mcr,mabrs,mds->macbd", W1, white, W1, optimize=True)
    size = len(overlap)
    eigenvalues = np.linalg.eigvalsh(white.reshape(size, 9, 9)) if size else np.zeros((0, 9))
    return np.clip(eigenvalues[:, 0].astype(np.float64), 1e-9, 1.0)


def whitening(moments: FloatArray) -> FloatArray:
    """Inverse Cholesky factors (m, 3, 3) of second moments (m, 3, 3), kept regular for tracks that stand still."""
    ridge = 1e-6 * np.trace(moments, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    return np.linalg.inv(np.linalg.cholesky(moments + ridge)).astype(np.float64)


def _acceleration_log(xy: FloatArray, rate_hz: float) -> FloatArray:
    """Logarithm (n,) of the magnitude of the second difference over +-0.2 s, NaN beside gaps."""
    k = max(1, round(0.2 * rate_hz))
    second = np.full(len(xy), np.nan)
    if len(xy) > 2 * k:
        second[k:-k] = np.linalg.norm(xy[2 * k :] - 2 * xy[k:-k] + xy[: -2 * k], axis=1)
    seen = np.isfinite(second)
    floor = 0.1 * np.median(second[seen]) + 1e-12 if seen.any() else 1.0
    return np.log(second + floor)
