"""The adjustment as the mathematics reads, in plain numpy: what the compiled loops must agree with.

One camera after the other, detections as rows. Unknowns are the cameras' 16 parameters each, then the coordinates of
the control points: (16 c + 3 m,).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skytrace.estimation.adjust.camera_priors import Priors
from skytrace.estimation.adjust.losses import LOSSES
from skytrace.estimation.adjust.normal import RIDGE
from skytrace.estimation.adjust.problem import (
    ASPECT,
    CENTRE,
    FOCAL,
    N_PARAMETERS,
    OFFSET,
    PRINCIPAL,
    RADIAL,
    RATE,
    READOUT,
    ROTATION,
    Problem,
    State,
    Weights,
)
from skytrace.estimation.priors import MotionPrior
from skytrace.geometry import projection
from skytrace.geometry.arrays import FloatArray, IntArray
from skytrace.geometry.projection import LensModel, distort, distort_by_coefficients, distort_jacobian
from skytrace.geometry.rigid import hat
from skytrace.solvers import bspline

if TYPE_CHECKING:
    from scipy.sparse import csr_array

_UNPREDICTED = 100.0  # squared loss scales


@dataclass(frozen=True, eq=False, slots=True)
class Linearisation:
    """Projections and their derivatives; NaN where the state predicts none."""

    xy_px: FloatArray  # (n, 2) raw pixels
    by_camera: FloatArray  # (n, 2, 16)
    by_point: FloatArray  # (n, 2, 3) by the point of the trajectory
    first: IntArray  # (n,) first of the four control points that determine the point
    basis: FloatArray  # (n, 4) their weights


def linearise(problem: Problem, state: State) -> Linearisation:
    """All projections, camera by camera."""
    n = len(problem.observations)
    xy, by_camera = np.full((n, 2), np.nan), np.full((n, 2, N_PARAMETERS), np.nan)
    by_point = np.full((n, 2, 3), np.nan)
    for c in range(problem.n_cameras):
        view = _look(problem, state, c)
        xy[view.own] = view.image + _lens(problem, state, c).principal_px
        by_camera[view.own], by_point[view.own] = _by_camera(problem, state, c, view), view.by_point
    first, u = problem.grid.locate(exposure_s(problem, state, np.arange(n)))
    return Linearisation(xy, by_camera, by_point, first, bspline.basis(u))


def image_velocity(problem: Problem, state: State) -> FloatArray:
    """Pixels a second (n, 2) at which the images run along the trajectory; NaN where the state predicts none."""
    velocity = np.full((len(problem.observations), 2), np.nan)
    for c in range(problem.n_cameras):
        view = _look(problem, state, c)
        velocity[view.own] = view.velocity
    return velocity


def exposure_s(problem: Problem, state: State, which: IntArray) -> FloatArray:
    """Times (k,) on the reference camera's clock at which detections `which` (k,) were exposed.

    t = alpha j + beta + gamma y / h (Li et al. 2020).
    """
    o = problem.observations
    beta, alpha, gamma = state.clock[o.camera[which]].T
    return alpha * o.tau_s[which] + beta + gamma * o.row[which]


@dataclass(frozen=True, eq=False, slots=True)
class _View:
    """What one camera sees of the trajectory: k of its detections that the state predicts."""

    own: IntArray  # (k,) which detections
    in_camera: FloatArray  # (k, 3) the point in the camera's frame
    image: FloatArray  # (k, 2) pixels from the principal point
    by_point_in_camera: FloatArray  # (k, 2, 3)
    by_point: FloatArray  # (k, 2, 3) by the point in the world
    velocity: FloatArray  # (k, 2)


def _look(problem: Problem, state: State, c: int) -> _View:
    """Project the trajectory into camera c at the exposures of its detections."""
    own = np.flatnonzero(problem.observations.camera == c)
    time_s = exposure_s(problem, state, own)
    in_camera = (problem.grid.evaluate(state.control, time_s) - state.centre[c]) @ state.rotation[c].T
    with np.errstate(invalid="ignore"):
        seen = in_camera[:, 2] > 1e-9 * np.abs(in_camera[:, :2]).sum(axis=1)
    own, in_camera = own[seen], in_camera[seen]
    lens = _lens(problem, state, c)
    x, y, z = in_camera.T
    ideal = in_camera[:, :2] / z[:, None]
    by_ideal = lens.focal_px[:, None] * distort_jacobian(ideal, lens.distortion, lens.model)
    one, nought = np.ones_like(z), np.zeros_like(z)
    ideal_by_point = np.array([[one, nought, -x / z], [nought, one, -y / z]]) / z
    by_point_in_camera = by_ideal @ np.moveaxis(ideal_by_point, -1, 0)
    by_point = by_point_in_camera @ state.rotation[c]
    speed = problem.grid.evaluate(state.control, time_s[seen], 1)
    velocity = (by_point @ speed[:, :, None])[:, :, 0]
    image = lens.focal_px * distort(ideal, lens.distortion, lens.model)
    return _View(own, in_camera, image, by_point_in_camera, by_point, velocity)


def _by_camera(problem: Problem, state: State, c: int, view: _View) -> FloatArray:
    """Derivatives (k, 2, 16) of camera c's projections by its parameters."""
    lens = _lens(problem, state, c)
    J = np.zeros((len(view.own), 2, N_PARAMETERS))
    J[:, :, ROTATION] = -view.by_point_in_camera @ hat(view.in_camera)  # exp(omega) p = p + omega x p
    J[:, :, CENTRE] = -view.by_point
    J[:, :, OFFSET] = view.velocity
    J[:, :, RATE] = view.velocity * problem.observations.tau_s[view.own, None]
    J[:, :, READOUT] = view.velocity * problem.observations.row[view.own, None]
    J[:, :, FOCAL] = view.image
    J[:, 1, ASPECT] = view.image[:, 1]
    J[:, :, PRINCIPAL] = np.diag(problem.calibration[c, :2])
    ideal = view.in_camera[:, :2] / view.in_camera[:, 2:]
    by_radial = distort_by_coefficients(ideal, lens.model)[:, :, projection.RADIAL[lens.model]]
    J[:, :, RADIAL] = lens.focal_px[:, None] * by_radial
    return J


@dataclass(frozen=True, eq=False, slots=True)
class _Lens:
    """A camera's lens as refined."""

    focal_px: FloatArray  # (2,)
    principal_px: FloatArray  # (2,)
    distortion: FloatArray  # (5 or 4,)
    model: LensModel


def _lens(problem: Problem, state: State, c: int) -> _Lens:
    calibrated, change = problem.calibration[c], state.lens[c]
    focal = calibrated[:2] * np.exp([change[0], change[0] + change[1]])
    principal = calibrated[2:4] + calibrated[:2] * change[2:4]
    model: LensModel = "fisheye" if calibrated[10] else "pinhole"
    distortion = calibrated[4:9].copy() if model == "pinhole" else calibrated[[4, 5, 8, 9]]
    distortion[list(projection.RADIAL[model])] += change[4:]
    return _Lens(focal, principal, distortion, model)


def cost(problem: Problem, state: State, priors: Priors, weights: Weights, motion: MotionPrior) -> float:
    """Half the robust squares of the residuals, half the squares of the priors, and the motion prior."""
    s, c2 = _squared_deviations(problem, weights, linearise(problem, state)), weights.loss_scale**2
    value = LOSSES[weights.loss].value(np.where(np.isfinite(s), s, _UNPREDICTED * c2), c2)
    data = 0.5 * float((weights.information[problem.observations.camera] * value).sum())
    return data + priors.cost(state) + motion.cost(state.control)


def _squared_deviations(problem: Problem, weights: Weights, at: Linearisation) -> FloatArray:
    residual = at.xy_px - problem.observations.xy_px
    return (residual**2).sum(axis=1) / weights.sigma_px[problem.observations.camera] ** 2


def normal_equations(
    problem: Problem, state: State, priors: Priors, weights: Weights, motion: MotionPrior
) -> tuple[csr_array, FloatArray]:
    """Gauss-Newton matrix and gradient of `cost`: J^T W J + priors + the spline's ridge, and J^T W r + priors."""
    from scipy.sparse import block_diag, csr_array, diags_array

    at = linearise(problem, state)
    seen = np.flatnonzero(np.isfinite(at.xy_px[:, 0]))
    camera = problem.observations.camera[seen]
    s = _squared_deviations(problem, weights, at)[seen]
    w = weights.information[camera] / weights.sigma_px[camera] ** 2
    w = np.repeat(w * LOSSES[weights.loss].weight(s, weights.loss_scale**2), 2)
    residual = (at.xy_px - problem.observations.xy_px)[seen].ravel()
    J = _sparse_jacobian(problem, state, at, seen)
    known_gradient, known = priors.linearised(state)
    prior = block_diag([known, motion.weight * _energy(motion)])
    pull = np.concatenate([known_gradient, motion.cost_gradient(state.control).ravel()])
    H = csr_array(J.T @ diags_array(w) @ J + prior)
    spline = np.arange(len(pull)) >= priors.deviation.size
    ridge = np.where(spline, RIDGE * H.diagonal()[spline].max(), 0.0)
    return csr_array(H + diags_array(ridge)), J.T @ (w * residual) + pull


def _energy(motion: MotionPrior) -> csr_array:
    """Matrix (3 m, 3 m) of the motion prior's energy."""
    from scipy.sparse import csr_array, diags_array

    band = motion.band()
    n = band.shape[1]
    lower = [diags_array(band[d, : n - d], offsets=-d) for d in range(1, len(band))]
    return csr_array(diags_array(band[0]) + sum(part + part.T for part in lower))


def _sparse_jacobian(problem: Problem, state: State, at: Linearisation, seen: IntArray) -> csr_array:
    """Derivatives (2 k, 16 c + 3 m) of the projections of the detections `seen` (k,)."""
    from scipy.sparse import csr_array

    by_control = at.basis[seen, None, :, None] * at.by_point[seen][:, :, None]  # (k, 2, 4, 3)
    values = np.concatenate([at.by_camera[seen], by_control.reshape(len(seen), 2, 12)], axis=2)
    of_camera = N_PARAMETERS * problem.observations.camera[seen, None] + np.arange(N_PARAMETERS)
    of_control = N_PARAMETERS * problem.n_cameras + 3 * at.first[seen, None] + np.arange(12)
    columns = np.repeat(np.concatenate([of_camera, of_control], axis=1), 2, axis=0)
    rows = np.repeat(np.arange(2 * len(seen)), columns.shape[1])
    shape = (2 * len(seen), N_PARAMETERS * problem.n_cameras + 3 * len(state.control))
    return csr_array((values.ravel(), (rows, columns.ravel())), shape=shape)


def damped_step(
    problem: Problem, state: State, priors: Priors, weights: Weights, motion: MotionPrior, damping: float
) -> FloatArray:
    """The Levenberg-Marquardt step (16 c + 3 m,) of all parameters, those held fixed resting.

    (H + damping diag H) step = -g, where the unit is held subject to this: the spread of the camera centres about the
    reference does not change to first order. Solved with a Lagrange multiplier.
    """
    H, g = normal_equations(problem, state, priors, weights, motion)
    moving = np.concatenate([priors.free.ravel(), np.ones(3 * len(state.control), bool)])
    outward = np.zeros((problem.n_cameras, N_PARAMETERS))
    if problem.unit_held:
        outward[:, CENTRE] = state.centre - state.centre[problem.reference]
        outward[problem.reference] = -outward.sum(axis=0)
    constraint = np.concatenate([outward.ravel(), np.zeros(3 * len(state.control))])[moving]
    dense = H.toarray()[np.ix_(moving, moving)]
    scale = np.sqrt(np.diag(dense))  # parameters of very different units
    dense = (dense + damping * np.diag(np.diag(dense))) / np.outer(scale, scale)
    corner = np.full((1, 1), 0.0 if problem.unit_held else 1.0)
    bordered = np.block([[dense, (constraint / scale)[:, None]], [(constraint / scale)[None], corner]])
    step = np.zeros(len(moving))
    step[moving] = np.linalg.solve(bordered, np.append(-g[moving] / scale, 0.0))[:-1] / scale
    return step
