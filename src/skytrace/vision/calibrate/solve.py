"""Levenberg-Marquardt for a calibration, each view's block eliminated before the lens is solved for."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from skytrace.geometry.arrays import BoolArray, FloatArray
from skytrace.vision.calibrate.problem import (
    ASPECT,
    BENDING,
    DECENTRING,
    FOCAL,
    N_VIEW,
    PRINCIPAL,
    SHAPE,
    TURN,
    Beliefs,
    Corners,
    State,
    n_shared,
)
from skytrace.vision.calibrate.residuals import linearise, predict

# What lenses and boards are like.
_PRINCIPAL_SIGMA = 0.008  # image widths from the image's middle
_TANGENTIAL_SIGMA = 0.002
_RADIAL_SIGMA = 1.0
_SAG_SIGMA = 1e-3  # per square: three thousandths of the length of a board of twelve
_STRETCH_SIGMA = 1e-3
_UNPREDICTED = 100.0  # deviations that a corner behind the camera counts as


@dataclass(frozen=True, eq=False, slots=True)
class Equations:
    """Gauss-Newton normal equations, with the priors in."""

    views: FloatArray  # (v, 11, 11)
    coupling: FloatArray  # (v, 11, s)
    shared: FloatArray  # (s, s)
    view_gradient: FloatArray  # (v, 11)
    shared_gradient: FloatArray  # (s,)


@dataclass(frozen=True, eq=False, slots=True)
class Solution:
    """A minimum, and the equations there."""

    state: State
    cost: float
    equations: Equations = field(repr=False)
    iterations: int
    converged: bool


def minimise(
    corners: Corners, state: State, beliefs: Beliefs, *, max_iterations: int = 100, tolerance: float = 1e-9
) -> Solution:
    """The most probable state near a given one."""
    equations, cost = assemble(corners, state, beliefs)
    damping, converged, k = 1e-4, False, 0
    while k < max_iterations and not converged:
        k += 1
        new = _moved(state, *_solve(equations, damping))
        new_cost = np.inf if new is None else objective(corners, new, beliefs)
        if new is None or not new_cost < cost:
            # At a minimum the smallest steps fail to help, too.
            converged = damping > 1e8
            damping *= 10
            continue
        converged = cost - new_cost < tolerance * cost
        damping = max(damping / 5, 1e-9)
        state = new
        equations, cost = assemble(corners, state, beliefs)
    return Solution(state, cost, equations, k, converged)


def objective(corners: Corners, state: State, beliefs: Beliefs) -> float:
    """The robust cost of a state, priors included."""
    c2 = beliefs.loss_scale**2
    loss = 0.5 * c2 * np.log1p(_squared(corners, predict(corners, state) - corners.xy_px, beliefs) / c2).sum()
    view_value, view_weight, shared_value, shared_weight = _priors(state, beliefs)
    prior = 0.5 * ((view_weight * view_value**2).sum() + (shared_weight * shared_value**2).sum())
    return float(loss / beliefs.inflation + prior)


def assemble(corners: Corners, state: State, beliefs: Beliefs) -> tuple[Equations, float]:
    """The normal equations and the cost at a state."""
    xy_px, by_view, by_shared = linearise(corners, state)
    residual = xy_px - corners.xy_px
    squared = _squared(corners, residual, beliefs)
    seen = np.isfinite(residual).all(1)
    residual, by_view, by_shared = (
        np.where(np.expand_dims(seen, tuple(range(1, a.ndim))), a, 0.0) for a in (residual, by_view, by_shared)
    )
    noise = beliefs.noise_px[corners.view]
    weight = 1 / (beliefs.inflation * noise**2 * (1 + squared / beliefs.loss_scale**2))
    weighted = by_view * weight[:, None, None]
    flat = (by_shared * weight[:, None, None]).reshape(-1, by_shared.shape[2])
    view_value, view_weight, shared_value, shared_weight = _priors(state, beliefs)

    views = corners.per_view(weighted.transpose(0, 2, 1) @ by_view)
    views[:, np.arange(N_VIEW), np.arange(N_VIEW)] += view_weight
    equations = Equations(
        views,
        corners.per_view(weighted.transpose(0, 2, 1) @ by_shared),
        flat.T @ by_shared.reshape(flat.shape) + np.diag(shared_weight),
        corners.per_view((weighted * residual[:, :, None]).sum(1)) + view_weight * view_value,
        flat.T @ residual.reshape(-1) + shared_weight * shared_value,
    )
    _hold(equations, *_free(state, beliefs))
    return equations, objective(corners, state, beliefs)


def shared_covariance(equations: Equations) -> FloatArray:
    """Covariance (s, s) of the shared parameters, all views free; held parameters have variance 1."""
    return np.asarray(np.linalg.inv(_reduced(equations, 0.0)[0]), np.float64)


def view_covariance(equations: Equations) -> FloatArray:
    """Covariance (v, 11, 11) of each view's block; held parameters have variance 1."""
    inverse = np.linalg.inv(equations.views)
    influence = inverse @ equations.coupling
    return inverse + influence @ shared_covariance(equations) @ influence.transpose(0, 2, 1)


def _squared(corners: Corners, residual: FloatArray, beliefs: Beliefs) -> FloatArray:
    """Squared residuals (n,) in deviations of the noise."""
    squared = (residual**2).sum(1) / beliefs.noise_px[corners.view] ** 2
    return np.where(np.isfinite(squared), squared, _UNPREDICTED**2)


def _hold(equations: Equations, views_free: BoolArray, shared_free: BoolArray) -> None:
    """Give every parameter that is held an equation of its own, with no other in it."""
    for held in np.flatnonzero(~views_free):
        equations.views[:, held, :] = equations.views[:, :, held] = 0
        equations.views[:, held, held] = 1
        equations.coupling[:, held, :] = equations.view_gradient[:, held] = 0
    for held in np.flatnonzero(~shared_free):
        equations.shared[held, :] = equations.shared[:, held] = 0
        equations.shared[held, held] = 1
        equations.coupling[:, :, held] = equations.shared_gradient[held] = 0


def _reduced(equations: Equations, damping: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The shared equations with the views eliminated, their gradient, and the inverses of the views' blocks."""
    views = equations.views.copy()
    views[:, np.arange(N_VIEW), np.arange(N_VIEW)] *= 1 + damping
    shared = equations.shared + damping * np.diag(np.diag(equations.shared))
    inverse = np.asarray(np.linalg.inv(views), np.float64)
    through = equations.coupling.transpose(0, 2, 1) @ inverse
    matrix = shared - (through @ equations.coupling).sum(0)
    gradient = equations.shared_gradient - (through @ equations.view_gradient[:, :, None])[:, :, 0].sum(0)
    return matrix, gradient, inverse


def _solve(equations: Equations, damping: float) -> tuple[FloatArray, FloatArray]:
    """A step (v, 11) of the views and (s,) of what they share; NaN where the equations have no solution."""
    try:
        matrix, gradient, inverse = _reduced(equations, damping)
        shared_step = np.asarray(-np.linalg.solve(matrix, gradient), np.float64)
    except np.linalg.LinAlgError:
        v, _, s = equations.coupling.shape
        return np.full((v, N_VIEW), np.nan), np.full(s, np.nan)
    right = equations.view_gradient + equations.coupling @ shared_step
    return -(inverse @ right[:, :, None])[:, :, 0], shared_step


def _moved(state: State, view_step: FloatArray, shared_step: FloatArray) -> State | None:
    """The state after a step, None where it leaves what a camera can be."""
    if not (np.isfinite(view_step).all() and np.isfinite(shared_step).all()):
        return None
    if max(np.abs(shared_step[[FOCAL, ASPECT]]).max(), np.abs(view_step[:, :3]).max()) > 1.0:
        return None
    return state.moved(view_step, shared_step)


def _priors(state: State, beliefs: Beliefs) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Distances from the priors' means, and their weights: of the views (v, 11) and of what they share (s,)."""
    n, lens = len(state.rotation), state.lens
    view_value, view_weight = np.zeros((n, N_VIEW)), np.zeros((n, N_VIEW))
    view_value[:, TURN], view_value[:, DECENTRING] = state.turn_rad, state.decentring
    sigma = np.array([*(beliefs.turn_sigma_rad,) * 3, *(beliefs.decentring_sigma,) * 2])
    view_weight[:, TURN.start :] = np.where(sigma > 0, np.maximum(sigma, 1e-12) ** -2.0, 0)
    value, sigma = np.zeros(n_shared(lens.model)), np.full(n_shared(lens.model), np.inf)
    value[PRINCIPAL] = (lens.principal_px - 0.5 * (np.array(lens.size_px) - 1)) / lens.size_px[0]
    value[SHAPE], value[BENDING] = state.shape, lens.distortion
    sigma[PRINCIPAL], sigma[SHAPE] = _PRINCIPAL_SIGMA, (*(_SAG_SIGMA,) * 3, _STRETCH_SIGMA)
    sigma[BENDING] = _RADIAL_SIGMA
    if lens.model == "pinhole":
        sigma[BENDING.start + 2 : BENDING.start + 4] = _TANGENTIAL_SIGMA
    return view_value, view_weight, value, sigma**-2


def _free(state: State, beliefs: Beliefs) -> tuple[BoolArray, BoolArray]:
    """Which parameters of a view (11,) and of what views share (s,) may move."""
    views = np.ones(N_VIEW, bool)
    views[TURN] = beliefs.turn_sigma_rad > 0
    views[DECENTRING] = beliefs.decentring_sigma > 0
    shared = np.full(n_shared(state.lens.model), beliefs.lens_free)
    if not beliefs.lens_free:
        return views, shared
    shared[ASPECT], shared[SHAPE] = beliefs.aspect_free, beliefs.shape_free
    shared[BENDING.start + beliefs.coefficients_free :] = False
    return views, shared
