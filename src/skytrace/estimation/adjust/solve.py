"""Levenberg-Marquardt on the adjustment's objective: its cost, its linearisation, and the iteration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from skytrace.estimation.adjust import kernel
from skytrace.estimation.adjust.camera_priors import Priors
from skytrace.estimation.adjust.losses import LOSSES
from skytrace.estimation.adjust.normal import RIDGE, NormalEquations, eliminate, step
from skytrace.estimation.adjust.problem import CENTRE, N_PARAMETERS, Problem, State, Weights, columns_of
from skytrace.estimation.priors import MotionPrior
from skytrace.geometry.arrays import FloatArray, IntArray

_LARGEST_DAMPING = 1e8
# The cost is in units of half a squared deviation: a step that gains less is no step.
_NOTHING = 1e-6

Ending = Literal["converged", "iterations", "no acceptable step", "singular", "not finite"]


@dataclass(frozen=True, eq=False, slots=True)
class Solution:
    """Where the iteration ended, and why.

    "converged": the cost no longer falls; "iterations": they ran out before that; "no acceptable step": the
    linearisation promises a lower cost but no step, however short, reaches one; "singular": the normal equations have
    no solution; "not finite": the cost at the start is no number. The last three are divergence.
    """

    state: State
    cost: float
    iterations: int
    ending: Ending

    @property
    def converged(self) -> bool:
        return self.ending == "converged"


def _model(problem: Problem, state: State) -> tuple[Any, ...]:
    """The kernel's arguments that determine the projections."""
    o, g = problem.observations, problem.grid
    constants = kernel.camera_constants(state.rotation, state.centre, state.clock, state.lens, problem.calibration)
    return (
        *(_plain(o.camera, np.int64), _plain(o.tau_s), _plain(o.row)),
        *(constants, _plain(state.control), g.control_of_interval(), g.first_interval, float(g.spacing_s)),
    )


def _loss(problem: Problem, weights: Weights) -> tuple[Any, ...]:
    """The kernel's arguments that determine what a residual costs."""
    return (
        *(_plain(problem.observations.xy_px), _plain(weights.sigma_px), _plain(weights.information)),
        *(LOSSES[weights.loss].code, float(weights.loss_scale)),
    )


def _plain(values: FloatArray | IntArray, dtype: type = np.float64) -> Any:
    """The one layout of an array that the loops are compiled for: copied only where it has another."""
    return np.require(values, dtype, ["C", "W"])


def predict(problem: Problem, state: State) -> FloatArray:
    """Projections (n, 2) in raw pixels of all observations; NaN where the state predicts none."""
    return kernel.predict(*_model(problem, state))


def cost(problem: Problem, state: State, priors: Priors, weights: Weights, motion: MotionPrior) -> float:
    """The objective: robust reprojection errors, camera priors and motion prior (half sums of squares)."""
    data = kernel.cost(*_model(problem, state), *_loss(problem, weights))
    return data + priors.cost(state) + motion.cost(state.control)


def assemble(problem: Problem, state: State, priors: Priors, weights: Weights, motion: MotionPrior) -> NormalEquations:
    """Linearise the objective at a state."""
    blocks, gradient, coupling, band, spline_gradient = kernel.normal_equations(
        *_model(problem, state), *_loss(problem, weights)
    )
    column = columns_of(priors.free)
    known_gradient, known = priors.linearised(state)
    band += motion.weight * motion.band().T
    band[:, 0] += RIDGE * band[:, 0].max()
    spline_gradient += motion.cost_gradient(state.control).ravel()
    return NormalEquations(
        _joined(blocks, column) + by_unknown(known, column),
        _summed(gradient + known_gradient.reshape(gradient.shape), column),
        coupling.reshape(len(coupling), -1),
        column.ravel(),
        band,
        spline_gradient,
        _scale_direction(problem, state, column),
    )


def _summed(values: FloatArray, column: IntArray) -> FloatArray:
    """Values (c, 16) by unknown (p,)."""
    out = np.zeros(column.max(initial=-1) + 1)
    np.add.at(out, column[column >= 0], values[column >= 0])
    return out


def _joined(blocks: FloatArray, column: IntArray) -> FloatArray:
    """The matrix (p, p) of the unknowns from the cameras' blocks (c, 16, 16)."""
    p = column.max(initial=-1) + 1
    out = np.zeros((p, p))
    for block, own in zip(blocks, column, strict=True):
        free = own >= 0
        np.add.at(out, (own[free, None], own[free]), block[np.ix_(free, free)])
    return out


def by_unknown(matrix: FloatArray, column: IntArray) -> FloatArray:
    """The matrix (p, p) of the unknowns from that (16 c, 16 c) of all camera parameters."""
    own = column.ravel()
    free = own >= 0
    out = np.zeros((column.max(initial=-1) + 1,) * 2)
    np.add.at(out, (own[free, None], own[free]), matrix[np.ix_(free, free)])
    return out


def _scale_direction(problem: Problem, state: State, column: IntArray) -> FloatArray | None:
    """Gradient (p,) of the spread of the camera centres about the reference: the unit of length is held fixed."""
    if problem.n_cameras < 2 or not problem.unit_held:
        return None
    direction = np.zeros((problem.n_cameras, N_PARAMETERS))
    direction[:, CENTRE] = state.centre - state.centre[problem.reference]
    direction[problem.reference] = -direction.sum(axis=0)  # where it is free
    direction = _summed(direction, column)
    norm = np.linalg.norm(direction)
    return direction / norm if norm > 0 else None


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

    A step is accepted only where it is finite and lowers the cost.
    """
    with np.errstate(all="ignore"):
        current = cost(problem, state, priors, weights, motion)
    if not np.isfinite(current):
        return Solution(state, current, 0, "not finite")
    spread, iterations = _spread(problem, state) if problem.unit_held else 0.0, 0
    while iterations < max_iterations:
        equations = assemble(problem, state, priors, weights, motion)
        promised, improved = None, False
        while not improved and iterations < max_iterations and damping < _LARGEST_DAMPING:
            iterations += 1
            try:
                camera_step, spline_step = step(equations, eliminate(equations, damping))
            except np.linalg.LinAlgError:
                damping = max(damping * 10, 1e-6)
                continue
            if promised is None:
                promised = _promised(equations, camera_step, spline_step)
            with np.errstate(all="ignore"):  # a wild step may overflow; it is not accepted
                candidate = _stepped(problem, state, equations.column, camera_step, spline_step, spread)
                new = cost(problem, candidate, priors, weights, motion)
            improved = candidate.finite and new < current
            if improved:
                gain, state, current = (current - new) / max(abs(current), 1e-300), candidate, new
                damping = max(damping / 10, 1e-12)
                if gain < tolerance:
                    return Solution(state, current, iterations, "converged")
            else:
                damping = max(damping * 10, 1e-6)
        if not improved and damping >= _LARGEST_DAMPING:
            return Solution(state, current, iterations, _stalled(promised, tolerance * abs(current)))
    return Solution(state, current, iterations, "iterations")


def _promised(equations: NormalEquations, camera_step: FloatArray, spline_step: FloatArray) -> float:
    """By how much the cost would fall were it as its linearisation says."""
    return -0.5 * float(equations.camera_gradient @ camera_step + equations.spline_gradient @ spline_step)


def _stalled(promised: float | None, worth: float) -> Ending:
    """Why no damping, however strong, led to a lower cost."""
    if promised is None:
        return "singular"
    return "converged" if promised <= max(worth, _NOTHING) else "no acceptable step"


def _stepped(
    problem: Problem, state: State, column: IntArray, camera_step: FloatArray, spline_step: FloatArray, spread: float
) -> State:
    """The state after a step of the unknowns, its spread of camera centres kept."""
    by_parameter = np.where(column >= 0, np.append(camera_step, 0.0)[column], 0.0)
    moved = state.moved(by_parameter.reshape(-1, N_PARAMETERS), spline_step.reshape(-1, 3))
    if spread > 0:  # the linear constraint holds the unit to first order; this holds it exactly
        moved = moved.scaled(spread / _spread(problem, moved), state.centre[problem.reference])
    return moved


def _spread(problem: Problem, state: State) -> float:
    return float(np.linalg.norm(state.centre - state.centre[problem.reference]))
