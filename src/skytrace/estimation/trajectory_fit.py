"""The first spline through triangulated points, and where the trajectory has support at all."""

from __future__ import annotations

import numpy as np

from skytrace.estimation.adjust.problem import KnotGrid
from skytrace.estimation.priors import automatic_weight, energy_trace, motion_prior
from skytrace.geometry.arrays import FloatArray
from skytrace.solvers import bspline

_FEWEST_TIMES = 5  # least jerk leaves a parabola free, which a run needs more than three points to fix


def knot_grid(time_s: FloatArray, spacing_s: float, margin_s: float, bridge_s: float) -> KnotGrid | None:
    """Runs of knot intervals that cover supported times (n,) with a margin, bridging silences up to `bridge_s`.

    Runs of fewer than five times are left out; None where nothing remains.
    """
    margin, bridge = max(1, round(margin_s / spacing_s)), round(bridge_s / spacing_s)
    intervals, counts = np.unique(np.floor(np.asarray(time_s) / spacing_s).astype(np.int64), return_counts=True)
    if not len(intervals):
        return None
    breaks = np.flatnonzero(np.diff(intervals) > max(bridge, 2 * margin + 1))
    starts, ends = np.r_[0, breaks + 1], np.r_[breaks, len(intervals) - 1]
    runs = tuple(
        (int(intervals[a]) - margin, int(intervals[b]) + margin + 1)
        for a, b in zip(starts, ends, strict=True)
        if counts[a : b + 1].sum() >= _FEWEST_TIMES
    )
    return KnotGrid(spacing_s, runs) if runs else None


def fit_spline(grid: KnotGrid, time_s: FloatArray, point_in_world: FloatArray, sigma: FloatArray) -> FloatArray:
    """Control points (m, 3) of a least-jerk spline through points (n, 3) of deviation (n,) at times (n,), robustly."""
    from scipy.linalg import cho_solve_banded, cholesky_banded

    from skytrace.estimation.adjust.banded import inverse_band

    first, u = grid.locate(time_s)
    inside = first >= 0
    first, u, points, sigma = first[inside], u[inside], point_in_world[inside], sigma[inside]
    B = bspline.basis(u)
    m = grid.n_control
    prior = motion_prior("jerk", grid.spacing_s, grid.runs, 1.0)
    prior = prior.weighted(1e-6 * len(points) / float(np.median(sigma)) ** 2)
    weight = sigma**-2.0
    control = np.zeros((m, 3))
    for _ in range(8):
        band = prior.weight * prior._band
        rhs = np.zeros((m, 3))
        for i in range(4):
            np.add.at(rhs, first + i, (weight * B[:, i])[:, None] * points)
            for j in range(i + 1):
                np.add.at(band[i - j], first + j, weight * B[:, i] * B[:, j])
        factor = cholesky_banded(band, lower=True)
        control = cho_solve_banded((factor, True), rhs)
        residual = np.linalg.norm(bspline.evaluate(control, first, u, grid.spacing_s) - points, axis=1)
        scale = max(float(np.median(residual / sigma)), 1e-9)
        weight = 1 / (sigma * scale) ** 2 / (1 + (residual / (2 * sigma * scale)) ** 2)
        inverse = np.repeat(inverse_band(np.ascontiguousarray(factor.T)).T, 3, axis=1)
        full = np.zeros((12, 3 * m))
        full[[0, 3, 6, 9]] = inverse
        prior = prior.weighted(automatic_weight(prior, control, energy_trace(prior, full)))
    return control
