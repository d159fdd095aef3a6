"""How errors of the detections move the estimate: the adjustment at its solution as a linear function of them.

Near the solution a robust estimate answers to errors like weighted least squares (Huber, "The behavior of maximum
likelihood estimates under nonstandard conditions", 1967): with w the weight of a residual under the loss, its pull is
w r, which grows on average by the loss's curvature times the error. Detections of a camera within one knot interval
see nearly the same and are taken together as a block.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from skytrace.estimation.adjust import banded, normal, reference, solve
from skytrace.estimation.adjust.driver import Adjusted
from skytrace.estimation.adjust.losses import LOSSES
from skytrace.estimation.adjust.problem import Observations, Weights, columns_of
from skytrace.geometry.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False, slots=True)
class Blocks:
    """Detections of one camera by knot interval, in order of time: b blocks, each taken as so many in its middle."""

    time_s: FloatArray  # (b,) mean, on the reference clock
    weight: FloatArray  # (b,) summed least-squares weights, per squared pixel
    first: IntArray  # (b,) first of the four active control points
    basis: FloatArray  # (b, 4) their weights
    by_camera: FloatArray  # (b, 2, 16) derivatives of the projection
    by_point: FloatArray  # (b, 2, 3)


@dataclass(frozen=True, eq=False)
class Influence:
    """The linearised estimate. Errors, biases and variances are in pixels, alike along both axes."""

    adjusted: Adjusted
    weights: Weights  # `information` times the loss's curvature: what least squares weighs by
    effective_px: FloatArray  # (n, 2) errors with which least squares would pull as the residuals do; NaN if unused
    curvature: FloatArray  # (c,) mean of the weights' squares over the mean of the weights
    detections: FloatArray  # (c,) coordinates that count, outliers hardly
    blocks: tuple[Blocks, ...]
    equations: normal.NormalEquations
    factor: normal.Factor
    follows: FloatArray  # (m, 3, p) minus how the control points follow the unknowns of the cameras

    @property
    def n_unknowns(self) -> int:
        return self.follows.shape[2]

    @cached_property
    def column(self) -> IntArray:
        """The unknown (c, 16) that each camera parameter is, -1 where it is held fixed."""
        return columns_of(self.adjusted.priors.free)

    @cached_property
    def unknown_rows(self) -> FloatArray:
        """Rows (c, 16, p) of the identity: each camera parameter by the unknowns, zero where it is held fixed."""
        p = self.n_unknowns
        return np.vstack([np.eye(p), np.zeros((1, p))])[self.column]

    @cached_property
    def response(self) -> FloatArray:
        """Change (p, p) of the cameras' unknowns by a unit of gradient, the unit of length held."""
        identity = np.eye(self.n_unknowns)
        return normal.constrained_solve(self.factor.reduced, identity, self.equations.scale_constraint)

    @cached_property
    def bias_response(self) -> FloatArray:
        """Displacement (c, m, 3, 2) of the control points by a lasting bias of a pixel along either axis of a camera.

        The cameras are held; what a bias does reaches no further than the spline is stiff.
        """
        m = len(self.follows)
        pull = np.zeros((m, 3, len(self.blocks), 2))
        for c, b in enumerate(self.blocks):
            weighted = b.weight[:, None, None] * b.by_point.transpose(0, 2, 1)
            for k in range(4):
                np.add.at(pull[:, :, c], b.first + k, b.basis[:, k, None, None] * weighted)
        return np.moveaxis(self.spline_solve(pull.reshape(3 * m, -1)).reshape(pull.shape), 2, 0)

    def spline_solve(self, rhs: FloatArray) -> FloatArray:
        """The spline's answer (3 m, k) to gradients (3 m, k), the cameras held."""
        columns = rhs.shape[1]
        half = banded.half_solve(
            self.factor.band, np.ascontiguousarray(rhs), np.arange(columns), columns, np.zeros(len(rhs))
        )
        solved = np.array(half[:, :columns], order="C")
        banded.back_solve(self.factor.band, solved)
        return solved

    def scores(self) -> Iterator[FloatArray]:
        """For each camera the change (b, p, 2) of the cameras' gradient by a bias of a pixel in each of its blocks.

        What the spline takes up is eliminated.
        """
        for c, b in enumerate(self.blocks):
            score = np.zeros((len(b.time_s), self.n_unknowns, 2))
            free = np.flatnonzero(self.column[c] >= 0)
            score[:, self.column[c][free]] = b.by_camera[:, :, free].transpose(0, 2, 1)
            for k in range(4):
                followed = self.follows[b.first + k].transpose(0, 2, 1) @ b.by_point.transpose(0, 2, 1)
                score -= b.basis[:, k, None, None] * followed
            yield score * b.weight[:, None, None]

    def left_in_residuals(self) -> FloatArray:
        """Squared residual (c, c) per axis that a slow error of unit variance in camera j leaves in camera i.

        The trajectory follows slow errors, those of heavily weighted cameras most: [i, j] with the cameras held.
        """
        n = len(self.blocks)
        out = np.zeros((n, n))
        for i, b in enumerate(self.blocks):
            for j in range(n):
                moved = sum(b.basis[:, k, None, None] * self.bias_response[j][b.first + k] for k in range(4))
                left = b.by_point @ moved - (i == j) * np.eye(2)
                out[i, j] = 0.5 * b.weight @ (left**2).sum(axis=(1, 2)) / max(b.weight.sum(), 1e-300)
        return out

    def white_left(self) -> FloatArray:
        """Share (c,) of the variance of white errors that stays in the residuals of each camera.

        One less the degrees of freedom that its detections spend, the spline's at its own blocks, those of the
        cameras' unknowns spread evenly, over their number.
        """
        inverse = banded.inverse_band(self.factor.band)
        spline = np.array([_spent(inverse, b) for b in self.blocks])
        cameras = float((self.response * self.data).sum())
        number = np.maximum(self.detections, 1e-300)
        return np.clip(1 - spline / number - cameras / number.sum(), 0.0, 1.0)

    @cached_property
    def data(self) -> FloatArray:
        """The cameras' reduced normal matrix (p, p) without their priors."""
        return self.factor.reduced - self.known

    @cached_property
    def known(self) -> FloatArray:
        """What the priors add to it."""
        _, matrix = self.adjusted.priors.linearised(self.adjusted.state)
        return solve.by_unknown(matrix, self.column)


def influence(adjusted: Adjusted) -> Influence:
    """Linearise an adjustment at its solution."""
    camera, used = adjusted.problem.observations.camera, np.isfinite(adjusted.residual_px[:, 0])
    sigma_px, n = adjusted.weights.sigma_px, adjusted.problem.n_cameras
    squared = np.where(used, (adjusted.residual_px**2).sum(axis=1), 0.0) / sigma_px[camera] ** 2
    loss, c2 = LOSSES[adjusted.weights.loss].weight, adjusted.weights.loss_scale**2
    w = np.where(used, loss(squared, c2), 0.0)
    # Averaged over directions, the derivative of the pull w(s) r by r is that of s w(s) by s.
    s = np.maximum(squared, 1e-6)
    slope = np.where(used, (1.001 * loss(1.001 * s, c2) - 0.999 * loss(0.999 * s, c2)) / 0.002, 0.0)
    mean_w, mean_slope, mean_squared = (np.bincount(camera, v, n) / _counts(camera[used], n) for v in (w, slope, w**2))
    bend = mean_slope / mean_w
    weights = replace(adjusted.weights, information=adjusted.weights.information * bend)
    effective_px = w[:, None] * adjusted.residual_px / mean_slope[camera, None]
    least_squares = w * (weights.information / sigma_px**2)[camera]
    equations = solve.assemble(adjusted.problem, adjusted.state, adjusted.priors, weights, adjusted.motion)
    factor = normal.eliminate(equations, 0.0)
    return Influence(
        adjusted,
        weights,
        effective_px,
        mean_squared / mean_w,
        2 * _counts(camera[used], n) * mean_w**2 / mean_squared,
        tuple(_blocks(adjusted, least_squares, used & (camera == c)) for c in range(n)),
        equations,
        factor,
        factor.solved_coupling().reshape(len(adjusted.state.control), 3, -1),
    )


def _spent(inverse: FloatArray, b: Blocks) -> float:
    """Trace of the spline's inverse, kept as its band (3 m, 12), times the normal matrix of a camera's blocks."""
    total = 0.0
    axis = np.arange(3)
    for j in range(4):
        for k in range(j, 4):
            offset = 3 * (k - j) + axis - axis[:, None]  # [x, y]: from coordinate x of point j to y of point k
            low = np.where(offset < 0, axis, axis[:, None])
            entry = inverse[3 * (b.first + j)[:, None, None] + low, np.abs(offset)]
            square = b.by_point.transpose(0, 2, 1) @ b.by_point
            share = (1 if j == k else 2) * b.weight * b.basis[:, j] * b.basis[:, k]
            total += float(share @ (entry * square).sum(axis=(1, 2)))
    return total


def _counts(camera: IntArray, n: int) -> FloatArray:
    return np.maximum(np.bincount(camera, minlength=n), 1).astype(np.float64)


def _blocks(adjusted: Adjusted, weight: FloatArray, chosen: BoolArray) -> Blocks:
    """The blocks of the chosen detections, all of one camera."""
    problem, state, o = adjusted.problem, adjusted.state, adjusted.problem.observations
    rows = np.flatnonzero(chosen)
    time_s = reference.exposure_s(problem, state, rows)
    control, _ = problem.grid.locate(time_s)
    inside = control >= 0
    rows, time_s = rows[inside], time_s[inside]
    first, block = np.unique(control[inside], return_inverse=True)

    def mean(values: FloatArray) -> FloatArray:
        return np.bincount(block, values, len(first)) / _counts(block, len(first))

    # The median detection of each block, rather than the one closest to its mean time: that is often a tie.
    counts = np.bincount(block, minlength=len(first))
    one = rows[np.lexsort((time_s, block))[np.cumsum(counts) - 1 - counts // 2]]
    observed = Observations(o.camera[one], o.tau_s[one], o.row[one], o.xy_px[one])
    at = reference.linearise(replace(problem, observations=observed), state)
    total = np.asarray(np.bincount(block, weight[rows], len(first)), np.float64)
    return Blocks(mean(time_s), total, first, at.basis, at.by_camera, at.by_point)
