"""Levenberg-Marquardt on the normal equations: banded Cholesky of the spline, Schur complement on the cameras."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.estimation.adjust import kernel
from skytrace.estimation.adjust.problem import CENTRE, N_PARAMETERS, Priors, Problem, State, Weights
from skytrace.estimation.priors import MotionPrior
from skytrace.geometry.arrays import BoolArray, FloatArray

_LARGEST_DAMPING = 1e8
# Where clocks have moved all detections off a stretch of spline, the motion prior alone leaves a parabola free. This
# much of the largest entry keeps the matrix definite; it damps the steps and does not move the minimum.
_RIDGE = 1e-12
_WIDTH = 12  # four control points of three coordinates interact


@dataclass(frozen=True, eq=False, slots=True)
class NormalEquations:
    """H step = -gradient, with H = [[camera, coupling^T], [coupling, spline]]; only free camera parameters appear."""

    camera: FloatArray  # (p, p)
    camera_gradient: FloatArray  # (p,)
    coupling: FloatArray  # (3 m, p)
    band: FloatArray  # (12, 3 m) lower band of the spline block
    spline_gradient: FloatArray  # (3 m,)
    scale_constraint: FloatArray | None  # (p,) direction of the camera step that would change the unit of length


@dataclass(frozen=True, eq=False, slots=True)
class Solution:
    """Where the iteration ended."""

    state: State
    cost: float
    iterations: int
    converged: bool


def predict(problem: Problem, state: State) -> FloatArray:
    """Projections (n, 2) in raw pixels of all observations; NaN where the state predicts none."""
    o, g = problem.observations, problem.grid
    return kernel.predict(
        o.camera, o.tau_s, o.row, state.rotation, state.centre, state.clock, state.lens, problem.calibration,
        state.control, g.control_of_interval(), g.first_interval, g.spacing_s,
    )  # fmt: skip


def cost(problem: Problem, state: State, priors: Priors, weights: Weights, motion: MotionPrior) -> float:
    """The objective: robust reprojection errors, camera priors and motion prior (half sums of squares)."""
    o = problem.observations
    data = kernel.robust_cost(
        o.xy_px, predict(problem, state), o.camera, weights.sigma_px, weights.information, weights.loss_scale
    )
    pull = _prior_pull(state, priors)
    return data + 0.5 * float((pull**2).sum()) + motion.cost(state.control)


def _prior_precision(priors: Priors) -> FloatArray:
    with np.errstate(divide="ignore"):
        return np.where(priors.free & np.isfinite(priors.deviation), 1 / priors.deviation, 0.0)


def _prior_pull(state: State, priors: Priors) -> FloatArray:
    """Deviations (c, 16) of the parameters from their prior means in prior deviations."""
    values = np.zeros_like(priors.mean)
    values[:, 6:9], values[:, 9:] = state.clock, state.lens
    return (values - priors.mean) * _prior_precision(priors)


def assemble(problem: Problem, state: State, priors: Priors, weights: Weights, motion: MotionPrior) -> NormalEquations:
    """Linearise the objective at a state."""
    o, g = problem.observations, problem.grid
    H, gradient, coupling, blocks, spline_gradient = kernel.normal_equations(
        o.camera, o.tau_s, o.row, o.xy_px, state.rotation, state.centre, state.clock, state.lens,
        problem.calibration, state.control, g.control_of_interval(), g.first_interval, g.spacing_s,
        weights.sigma_px, weights.information, weights.loss_scale,
    )  # fmt: skip
    precision = _prior_precision(priors)
    pull = _prior_pull(state, priors)
    n = problem.n_cameras
    free = priors.free.ravel()
    camera = np.zeros((n, N_PARAMETERS, n, N_PARAMETERS))
    camera[np.arange(n), :, np.arange(n), :] = H
    camera = camera.reshape(n * N_PARAMETERS, -1)
    camera[np.diag_indices_from(camera)] += precision.ravel() ** 2
    gradient = gradient + pull * precision
    spline_gradient = spline_gradient + motion.cost_gradient(state.control)
    # (c, m, 3, 16) -> (3 m, 16 c)
    coupling = np.moveaxis(coupling, 0, 2).reshape(3 * len(state.control), -1)
    band = spline_band(blocks) + motion.weight * motion.band()
    band[0] += _RIDGE * band[0].max()
    return NormalEquations(
        camera[np.ix_(free, free)],
        gradient.ravel()[free],
        coupling[:, free],
        band,
        spline_gradient.ravel(),
        _scale_direction(problem, state, free),
    )


def _scale_direction(problem: Problem, state: State, free: BoolArray) -> FloatArray | None:
    """Gradient (p,) of the spread of the camera centres about the reference: the unit of length is held fixed."""
    if problem.n_cameras < 2:
        return None
    direction = np.zeros((problem.n_cameras, N_PARAMETERS))
    direction[:, CENTRE] = state.centre - state.centre[problem.reference]
    direction = direction.ravel()[free]
    norm = np.linalg.norm(direction)
    return direction / norm if norm > 0 else None


def spline_band(blocks: FloatArray) -> FloatArray:
    """Lower band (12, 3 m) in LAPACK's storage of symmetric blocks (m, 4, 3, 3); [i, d] couples points i and i + d."""
    m = len(blocks)
    band = np.zeros((_WIDTH, m, 3))
    for d in range(4):
        for a in range(3):
            for b in range(3):
                if 3 * d + b - a >= 0:
                    band[3 * d + b - a, :, a] = blocks[:, d, a, b]
    return band.reshape(_WIDTH, 3 * m)


@dataclass(frozen=True, eq=False, slots=True)
class Factor:
    """The damped system, eliminated: spline factor, its solve of the coupling, and the reduced camera matrix."""

    band: FloatArray  # (12, 3 m) Cholesky factor
    solved_coupling: FloatArray  # (3 m, p)
    reduced: FloatArray  # (p, p)


def eliminate(equations: NormalEquations, damping: float) -> Factor:
    """Eliminate the spline. Raises numpy.linalg.LinAlgError where the matrix is not positive definite."""
    from scipy.linalg import cho_solve_banded, cholesky_banded

    band = equations.band.copy()
    band[0] *= 1 + damping
    factor = cholesky_banded(band, lower=True, overwrite_ab=True, check_finite=False)
    solved = cho_solve_banded((factor, True), equations.coupling, check_finite=False)
    reduced = equations.camera - equations.coupling.T @ solved
    reduced[np.diag_indices_from(reduced)] += damping * np.diag(equations.camera)
    return Factor(factor, solved, reduced)


def step(equations: NormalEquations, factor: Factor) -> tuple[FloatArray, FloatArray]:
    """Camera step (p,) and spline step (3 m,) of the eliminated system, the unit of length held."""
    from scipy.linalg import cho_solve_banded

    rhs = -(equations.camera_gradient - factor.solved_coupling.T @ equations.spline_gradient)
    camera_step = constrained_solve(factor.reduced, rhs, equations.scale_constraint)
    residual = -(equations.spline_gradient + equations.coupling @ camera_step)
    return camera_step, cho_solve_banded((factor.band, True), residual, check_finite=False)


def constrained_solve(A: FloatArray, b: FloatArray, direction: FloatArray | None) -> FloatArray:
    """Solve A x = b, for b (p,) or (p, k), subject to direction . x = 0; A need only be definite on that plane."""
    from scipy.linalg import cho_factor, cho_solve

    scale = 1 / np.sqrt(np.maximum(np.diag(A), 1e-300))
    B = A * scale[:, None] * scale
    rhs = (b.T * scale).T
    if direction is None:
        return (cho_solve(cho_factor(B), rhs).T * scale).T
    d = direction * scale
    d = d / np.linalg.norm(d)
    # Stiffening the forbidden direction leaves the constrained solution unchanged and makes the matrix definite.
    factor = cho_factor(B + np.outer(d, d))
    x, toward = cho_solve(factor, rhs), cho_solve(factor, d)
    x = x - np.multiply.outer(toward, d @ x) / (d @ toward) if x.ndim > 1 else x - toward * (d @ x) / (d @ toward)
    return (x.T * scale).T


def minimise(
    problem: Problem,
    state: State,
    priors: Priors,
    weights: Weights,
    motion: MotionPrior,
    *,
    max_iterations: int = 20,
    tolerance: float = 1e-7,
    damping: float = 1e-4,
) -> Solution:
    """Levenberg-Marquardt (Marquardt's diagonal scaling) until the cost falls by less than `tolerance` relatively.

    A step is accepted only where it lowers the cost, so a step that turns NaN never is.
    """
    free, gain = priors.free, np.inf
    current = cost(problem, state, priors, weights, motion)
    spread = _spread(problem, state)
    iterations = 0
    while iterations < max_iterations:
        equations = assemble(problem, state, priors, weights, motion)
        improved = solvable = False
        while iterations < max_iterations and damping < _LARGEST_DAMPING:
            iterations += 1
            try:
                factor = eliminate(equations, damping)
                camera_free, spline_step = step(equations, factor)
            except np.linalg.LinAlgError:
                damping = max(damping * 10, 1e-6)
                continue
            solvable = True
            camera_step = np.zeros(free.shape)
            camera_step[free] = camera_free
            candidate = state.moved(camera_step, spline_step.reshape(-1, 3))
            if spread > 0:  # the linear constraint holds the unit to first order; this holds it exactly
                candidate = candidate.scaled(spread / _spread(problem, candidate), state.centre[problem.reference])
            new = cost(problem, candidate, priors, weights, motion)
            if new < current:
                improved = True
                gain = (current - new) / max(current, 1e-300)
                state, current = candidate, new
                damping = max(damping / 10, 1e-12)
                break
            damping = max(damping * 10, 1e-6)
        if improved and gain < tolerance:
            return Solution(state, current, iterations, converged=True)
        if not improved and damping >= _LARGEST_DAMPING:
            # However short the step, the cost does not fall: the minimum, as far as the arithmetic can tell.
            return Solution(state, current, iterations, converged=solvable)
    return Solution(state, current, iterations, converged=False)


def _spread(problem: Problem, state: State) -> float:
    return float(np.linalg.norm(state.centre - state.centre[problem.reference]))
