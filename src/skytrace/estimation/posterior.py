"""How sure the adjustment is: deviations of the trajectory, the camera centres and the clocks.

The normal matrix at the solution, eliminated as for a step, gives the covariance without a dense inversion: the band of
the spline's inverse (given the cameras) plus what the cameras' covariance adds through the coupling. All deviations
are inflated by the residuals' correlation in time. Positions are free up to a similarity, so deviations are those that
remain after the best alignment of the whole trajectory: the choice of the reference camera does not enter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.estimation.adjust import banded, normal, solve
from skytrace.estimation.adjust.driver import Adjusted
from skytrace.estimation.adjust.problem import CENTRE, CLOCK, LENS, OFFSET, RATE, columns_of
from skytrace.geometry.arrays import BoolArray, FloatArray, IntArray
from skytrace.geometry.rigid import hat

_WILD = 25.0  # knots of more than this many times the median variance do not take part in the alignment


@dataclass(frozen=True, eq=False, slots=True)
class Posterior:
    """Standard deviations; 0 for what is held fixed."""

    knot_sigma: FloatArray  # (knots,) of the position at each knot of each run, runs one after another
    centre: FloatArray  # (c, 3) in world units
    clock: FloatArray  # (c, 3) time at mean camera time (s), rate, readout (s)
    clock_offset: FloatArray  # (c,) of the offset at camera time 0 (s)
    lens: FloatArray  # (c, 7)


def knot_weights(run_lengths: tuple[int, ...]) -> tuple[IntArray, FloatArray]:
    """First control point (k,) of each knot of each run, and the three weights (3,) that give the position there."""
    first, start = [], 0
    for n in run_lengths:
        first.append(start + np.arange(n + 1))
        start += n + 3
    return np.concatenate(first), np.array([1.0, 4.0, 1.0]) / 6


def posterior(adjusted: Adjusted, mean_camera_time_s: FloatArray, supported: BoolArray) -> Posterior:
    """Deviations at the adjusted state.

    `mean_camera_time_s` (c,) refers the clock offsets to camera time 0; `supported` (knots,) are the knots that the
    alignment goes by, since the spline may run wild where nobody saw the target.
    """
    problem, state = adjusted.problem, adjusted.state
    equations = solve.assemble(problem, state, adjusted.priors, adjusted.weights, adjusted.motion)
    factor = normal.eliminate(equations, 0.0)
    p = len(factor.reduced)
    covariance = normal.constrained_solve(factor.reduced, np.eye(p), equations.scale_constraint)

    first, weights = knot_weights(adjusted.motion.run_lengths)
    local = _knot_variances(banded.inverse_band(factor.band), first, weights)
    follows = factor.solved_coupling().reshape(len(state.control), 3, p)
    response = -_at_knots(follows, first, weights)  # (knots, 3, p) of positions to cameras
    positions = _at_knots(state.control, first, weights)

    column = columns_of(adjusted.priors.free)
    # The row of the last unknown's successor is zero: that of whatever is held fixed.
    centres = np.vstack([np.eye(p), np.zeros((1, p))])[column[:, CENTRE]]  # (c, 3, p)
    variance = (local + _quadratic(response, covariance)).sum(axis=1)
    known = supported & (variance <= _WILD * np.median(variance[supported])) if supported.any() else supported
    alignment = _alignment_response(positions[known], response[known])  # (7, p)
    response = response - _generators(positions) @ alignment
    centres = centres - _generators(state.centre) @ alignment

    camera_variance = _quadratic(response, covariance)
    inflation = adjusted.inflation
    deviation = np.append(np.sqrt(np.maximum(np.diag(covariance), 0) * inflation), 0.0)[column]
    return Posterior(
        np.sqrt(np.maximum((local + camera_variance).sum(axis=1), 0) * inflation),
        np.sqrt(np.maximum(_quadratic(centres, covariance), 0) * inflation),
        deviation[:, CLOCK],
        _offset_deviation(covariance, column, mean_camera_time_s) * np.sqrt(inflation),
        deviation[:, LENS],
    )


def _quadratic(response: FloatArray, covariance: FloatArray) -> FloatArray:
    """Variances (n, 3) of linear functions (n, 3, p) of parameters with a covariance (p, p)."""
    return ((response @ covariance) * response).sum(axis=-1)


def _at_knots(control: FloatArray, first: IntArray, weights: FloatArray) -> FloatArray:
    """Values (k, ...) at knots of a spline with control points (m, ...)."""
    return sum((w * control[first + i] for i, w in enumerate(weights)), np.zeros(()))


def _knot_variances(inverse_band: FloatArray, first: IntArray, weights: FloatArray) -> FloatArray:
    """Variances (k, 3) of the positions at knots from the band (3 m, 12) of the inverse."""
    out = np.zeros((len(first), 3))
    for axis in range(3):
        for i, wi in enumerate(weights):
            for j, wj in enumerate(weights):
                low, high = min(i, j), max(i, j)
                out[:, axis] += wi * wj * inverse_band[3 * (first + low) + axis, 3 * (high - low)]
    return out


def _generators(points: FloatArray) -> FloatArray:
    """Displacements (n, 3, 7) of points (n, 3) under unit translations, rotations and scaling."""
    out = np.zeros((len(points), 3, 7))
    out[:, :, :3] = np.eye(3)
    out[:, :, 3:6] = -hat(points)
    out[:, :, 6] = points
    return out


def _alignment_response(positions: FloatArray, response: FloatArray) -> FloatArray:
    """The similarity (7, p) that least squares would fit to the displacement of all positions by each parameter."""
    G = _generators(positions).reshape(-1, 7)
    scale = np.linalg.norm(G, axis=0)
    Q, R = np.linalg.qr(G / scale)
    return np.linalg.lstsq(R, Q.T @ response.reshape(len(G), -1), rcond=None)[0] / scale[:, None]


def _offset_deviation(covariance: FloatArray, column: IntArray, mean_s: FloatArray) -> FloatArray:
    """Deviation (c,) of offset = (time at mean) - rate * mean, before inflation."""
    out = np.zeros(len(column))
    for c, (i, j) in enumerate(column[:, [OFFSET, RATE]]):
        if i >= 0 and j >= 0:
            variance = covariance[i, i] - 2 * mean_s[c] * covariance[i, j] + mean_s[c] ** 2 * covariance[j, j]
            out[c] = np.sqrt(max(variance, 0.0))
    return out
