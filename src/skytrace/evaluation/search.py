"""Where on the reconstruction's clock the truth may begin: every offset is tried, by cross-correlation.

The best similarity at an offset follows from the moments of the two point sets in their overlap (Umeyama, 1991). Each
moment is a masked cross-correlation, so a few Fourier transforms give the residual at all offsets together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skytrace.evaluation.path import SampledPath
from skytrace.geometry.arrays import BoolArray, FloatArray, IntArray

CHANCE_LEVEL = 0.1  # fraction of the variance left unexplained at which a match is no evidence either way
_RESIDUAL_FLOOR = 1e-6  # a residual below a thousandth of the extent makes a match no more certain
_PHASE_ERROR_S = 0.6  # clock error at the ends of the overlap that the refinement is sure to correct


@dataclass(frozen=True, slots=True)
class Candidate:
    """A start for the refinement: the truth's sample k may have been taken at offset_s + scale * k / rate."""

    offset_s: float
    scale: float
    score: float


def match_score(unexplained: FloatArray, overlap_s: FloatArray, minimum_overlap_s: float) -> FloatArray:
    """Evidence (n,) for a match that leaves a fraction `unexplained` (n,) of the variance over `overlap_s` (n,).

    A straight leg fits any other straight leg, so a small residual counts by how long it holds. Residuals above the
    chance level score negative, by their size alone.
    """
    logarithm = np.log(CHANCE_LEVEL / np.maximum(unexplained, _RESIDUAL_FLOOR))
    weight_s = np.maximum(overlap_s - 0.5 * minimum_overlap_s, 0.0)
    return np.where(logarithm > 0, weight_s * logarithm, logarithm)


def scales_to_try(overlap_s: float, max_scale_error: float) -> FloatArray:
    """Clock scales around 1, dense enough that one keeps the ends of the overlap in phase; an odd number."""
    half_width = 2 * _PHASE_ERROR_S / overlap_s
    half = int(np.ceil(max(max_scale_error / half_width - 1, 0) / 2))
    return 1 + max_scale_error * 2 * np.arange(-half, half + 1) / (2 * half + 1)


def unexplained_at_every_lag(
    a: FloatArray, covered_a: BoolArray, b: FloatArray, covered_b: BoolArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Residual of the best similarity between a[j + lag] and b[j] at every lag, as a fraction of the variance.

    `a` (n, 3) and `b` (m, 3) are samples on one time grid, used where covered (n,), (m,). Returns lags
    -(m - 1) .. n - 1, the number of common samples and the unexplained fraction (1 where nothing is determined).
    """
    from scipy.fft import irfft, next_fast_len, rfft

    n, m = len(a), len(b)
    size = next_fast_len(n + m - 1, real=True)
    spectrum_a = np.asarray(rfft(_moments(a, covered_a), size))
    spectrum_b = np.asarray(rfft(_moments(b, covered_b), size)).conj()
    lag = np.arange(1 - m, n)

    def correlate(product: NDArray[np.complex128]) -> FloatArray:
        return np.asarray(irfft(product, size))[..., lag]

    # Rows and columns 1..3 hold the coordinates, row and column 0 the coverage.
    mixed = correlate(spectrum_a[:4, None] * spectrum_b[None, :4])
    count = np.rint(mixed[0, 0]).astype(np.int64)
    weight = 1 / np.maximum(count, 1)
    sum_a, sum_b = mixed[1:, 0], mixed[0, 1:]
    square_a = correlate(spectrum_a[4] * spectrum_b[0]) - weight * (sum_a**2).sum(0)
    square_b = correlate(spectrum_a[0] * spectrum_b[4]) - weight * (sum_b**2).sum(0)
    cross = np.moveaxis(mixed[1:, 1:] - weight * sum_a[:, None] * sum_b[None, :], 2, 0)
    # Below this the moments are what is left of the transforms' rounding.
    spread = (square_a > 1e-9 * max(square_a.max(), 1e-300)) & (square_b > 1e-9 * max(square_b.max(), 1e-300))
    usable = spread & (count >= 3)
    unexplained = np.ones(len(lag))
    explained = _proper_trace(cross[usable]) ** 2 / (square_a[usable] * square_b[usable])
    unexplained[usable] = np.clip(1 - explained, 0, 1)
    return lag, count, unexplained


def _moments(points: FloatArray, covered: BoolArray) -> FloatArray:
    """Coverage, centred and scaled coordinates and their squared length, (5, n); zero where not covered."""
    if not covered.any():
        return np.zeros((5, len(points)))
    centred = np.where(covered[:, None], points - points[covered].mean(0), 0.0)
    centred = centred / max(float(np.abs(centred).max()), 1e-300)
    return np.vstack([covered.astype(float), centred.T, (centred**2).sum(1)])


def _proper_trace(cross: FloatArray) -> FloatArray:
    """Largest trace (n,) of R @ cross over proper rotations R, for matrices (n, 3, 3)."""
    singular = np.sqrt(np.maximum(np.linalg.eigvalsh(np.swapaxes(cross, 1, 2) @ cross), 0.0))
    handed = np.where(np.linalg.det(cross) < 0, -1.0, 1.0)
    return np.maximum(singular[:, 2] + singular[:, 1] + handed * singular[:, 0], 0.0)


def search_clock(
    path: SampledPath,
    truth: FloatArray,
    elapsed_s: FloatArray,
    minimum_overlap_s: float,
    max_scale_error: float,
    n_candidates: int = 12,
) -> list[Candidate]:
    """The most likely clocks of a truth (m, 3) whose samples lie elapsed_s (m,) after its first one, best first.

    Rows of NaN in the truth are samples without a position. The list is empty when no offset gives the wanted overlap.
    """
    extent_s = min(path.time_s[-1] - path.time_s[0], elapsed_s[-1] - elapsed_s[0])
    step_s = float(np.clip(extent_s / 3000, 0.2, 0.5)) if extent_s > 20 else extent_s / 100
    n = int((path.time_s[-1] - path.time_s[0]) / step_s) + 1
    points = path.evaluate(path.time_s[0] + step_s * np.arange(n))[0]
    covered = np.isfinite(points[:, 0])
    found = []
    for scale in scales_to_try(extent_s, max_scale_error):
        grid_s = np.arange(int(scale * elapsed_s[-1] / step_s) + 1) * step_s / scale
        samples = np.column_stack([np.interp(grid_s, elapsed_s, truth[:, axis]) for axis in range(3)])
        lag, count, unexplained = unexplained_at_every_lag(points, covered, samples, np.isfinite(samples[:, 0]))
        overlap_s = count.astype(np.float64) * step_s
        enough = overlap_s >= minimum_overlap_s
        score = match_score(unexplained[enough], overlap_s[enough], minimum_overlap_s)
        for peak in _peaks(score, lag[enough], round(2.0 / step_s), n_candidates):
            offset_s = path.time_s[0] + lag[enough][peak] * step_s
            found.append(Candidate(float(offset_s), float(scale), float(score[peak])))
    return sorted(found, key=lambda c: -c.score)[:n_candidates]


def _peaks(score: FloatArray, lag: IntArray, reach: int, n_peaks: int) -> list[int]:
    """Indices of the highest scores, each more than `reach` lags from the ones before."""
    peaks: list[int] = []
    rest = score.copy()
    while len(peaks) < n_peaks and len(rest) and np.isfinite(rest.max()):
        peaks.append(int(np.argmax(rest)))
        rest[np.abs(lag - lag[peaks[-1]]) <= reach] = -np.inf
    return peaks
