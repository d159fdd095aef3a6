"""How sure the adjustment is: deviations of the trajectory, the camera centres, the clocks and the lenses.

The estimate is a linear function of the errors of the detections, of the priors and of the motion prior
(`estimation.influence`), and its covariance is that function's: H^-1 M H^-1, with H the normal matrix and M the
covariance of the gradient at the truth (Huber's sandwich, 1967; White, "Maximum likelihood estimation of misspecified
models", 1982). M differs from H because detections err for seconds on end (`estimation.error_model`). What that costs
depends on the unknown: a clock, which pulls the track now ahead and now back, averages over such errors that a lens
does not; and positions feel them once, not added up over time.

H is eliminated as for a step, so nothing dense but the cameras' system is inverted: a position varies given the cameras
(banded) and with the cameras (through the coupling). Positions are free up to a similarity and to the clock that tells
their times, so deviations are those that remain after the best alignment of the whole trajectory in space and time: the
choice of the reference camera does not enter. Where a frame is known (`estimation.known`), positions are free only up
to those motions that are not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from skytrace.estimation.adjust import banded, solve
from skytrace.estimation.adjust.driver import Adjusted
from skytrace.estimation.adjust.problem import CENTRE, CLOCK, LENS
from skytrace.estimation.error_model import ErrorModel, error_model
from skytrace.estimation.influence import Influence, influence
from skytrace.estimation.known import Known
from skytrace.estimation.slow_errors import gradient_and_positions
from skytrace.geometry.arrays import BoolArray, FloatArray, IntArray
from skytrace.geometry.rigid import hat

_WILD = 25.0  # knots of more than this many times the median variance do not take part in the alignment
_NUDGE = 1e-3  # of a matrix, for the derivative of its inverse


@dataclass(frozen=True, eq=False, slots=True)
class Posterior:
    """Standard deviations; 0 for what is held fixed."""

    knot_sigma: FloatArray  # (knots,) of the position at each knot of each run, runs one after another
    centre_covariance: FloatArray  # (c, 3, 3) in world units
    clock: FloatArray  # (c, 3) time at mean camera time (s), rate, readout (s)
    clock_offset: FloatArray  # (c,) of the offset at camera time 0 (s)
    lens: FloatArray  # (c, 7)
    errors: ErrorModel  # what the detections' errors were taken to be
    shape_sigma: FloatArray  # (knots,) as `knot_sigma`, of the flight's shape whatever frame is known


def knot_weights(run_lengths: tuple[int, ...]) -> tuple[IntArray, FloatArray]:
    """First control point (k,) of each knot of each run, and the three weights (3,) that give the position there."""
    first, start = [], 0
    for n in run_lengths:
        first.append(start + np.arange(n + 1))
        start += n + 3
    return np.concatenate(first), np.array([1.0, 4.0, 1.0]) / 6


def posterior(
    adjusted: Adjusted, mean_camera_time_s: FloatArray, supported: BoolArray, reference: int | None = None
) -> Posterior:
    """Deviations at the adjusted state.

    `mean_camera_time_s` (c,) refers the clock offsets to camera time 0; `supported` (knots,) are the knots that the
    alignment goes by, since the spline may run wild where nobody saw the target. Clocks are told by that of camera
    `reference`, the adjustment's if none is given.
    """
    moves = influence(adjusted)
    return deviations(moves, error_model(moves), mean_camera_time_s, supported, reference)


def deviations(
    moves: Influence,
    errors: ErrorModel,
    mean_camera_time_s: FloatArray,
    supported: BoolArray,
    reference: int | None = None,
) -> Posterior:
    """Deviations (see `posterior`) of an estimate whose detections err like this."""
    state = moves.adjusted.state
    knots_s = moves.adjusted.problem.grid.knots_s()
    clocks = _clocks_told_by(moves, moves.adjusted.problem.reference if reference is None else reference)
    first, weights = knot_weights(moves.adjusted.motion.run_lengths)
    noise = _white_noise(moves, errors)
    slow, local, together = gradient_and_positions(
        moves,
        errors.slow_px2,
        errors.correlation_s,
        knots_s,
        [_at_knots(response, first, weights) for response in moves.bias_response],
    )
    covariance = moves.response @ (noise.camera + slow + _prior_gradient(moves)) @ moves.response.T
    local += _knot_variances(_sandwich_band(moves.equations.band, noise.band), first, weights)
    response = -_at_knots(moves.follows, first, weights)  # (knots, 3, p) of positions to cameras
    velocity = (state.control[first + 2] - state.control[first]) / (2 * moves.adjusted.problem.grid.spacing_s)
    similarity = _similarities(_at_knots(state.control, first, weights))
    alignments = np.concatenate([similarity, np.stack([velocity, velocity * knots_s[:, None]], axis=2)], axis=2)
    free = _free_motions(moves.adjusted.known)

    centres = moves.unknown_rows[:, CENTRE]  # (c, 3, p)
    variance = (local + _quadratic(response, covariance)).sum(axis=1)
    known = supported & (variance <= _WILD * np.median(variance[supported])) if supported.any() else supported

    def sigma(response: FloatArray) -> FloatArray:
        # An error that moves a position moves the cameras too, so that they take up part of it.
        both = 2 * ((response @ moves.response) * together).sum(axis=-1)
        return np.sqrt(np.maximum((local + both + _quadratic(response, covariance)).sum(axis=1), 0))

    aligned = _least_squares(alignments[known], response[known])  # (9, p)
    knot_sigma = shape_sigma = sigma(response - alignments @ aligned)
    if free is None:
        centres = centres - _similarities(state.centre) @ aligned[:7]
    else:
        alignments = np.concatenate([similarity @ free, alignments[:, :, 7:]], axis=2)
        aligned = _least_squares(alignments[known], response[known])
        knot_sigma = sigma(response - alignments @ aligned)
        centres = centres - _similarities(state.centre) @ free @ aligned[: free.shape[1]]
    lens = moves.unknown_rows[:, LENS]
    return Posterior(
        knot_sigma,
        centres @ covariance @ centres.transpose(0, 2, 1),
        np.sqrt(np.maximum(_quadratic(clocks, covariance), 0)),
        np.sqrt(np.maximum(_quadratic(clocks[:, 0] - mean_camera_time_s[:, None] * clocks[:, 1], covariance), 0)),
        np.sqrt(np.maximum(_quadratic(lens, covariance), 0)),
        errors,
        shape_sigma,
    )


def _free_motions(known: Known | None) -> FloatArray | None:
    """The similarities (7, q) of a scene that lies in a known frame which leave what is known as it is."""
    if known is None or known.undetermined is None:
        return None
    rigid = np.vstack([known.undetermined, np.zeros((1, known.undetermined.shape[1]))])
    return rigid if known.unit_known else np.hstack([rigid, np.eye(7)[:, 6:]])


def _clocks_told_by(moves: Influence, reference: int) -> FloatArray:
    """Answers (c, 3, p) of the cameras' time at mean camera time, rate and readout, told by one camera's clock."""
    clock, rows = moves.adjusted.state.clock, moves.unknown_rows[:, CLOCK]
    offset, rate = rows[reference, :2]
    # A clock that is ahead by what the reference is ahead, and by more the later, shows the same time.
    since_s = (clock[:, 0] - clock[reference, 0]) / clock[reference, 1]
    along = clock / clock[reference, 1]
    return rows - np.stack([offset + since_s[:, None] * rate, along[:, 1:2] * rate, along[:, 2:] * rate], axis=1)


@dataclass(frozen=True, eq=False, slots=True)
class _Noise:
    """Covariance of the gradient under what is independent from one detection to the next."""

    camera: FloatArray  # (p, p) of the cameras' unknowns, the spline eliminated
    band: FloatArray  # (3 m, 12) of the spline, the cameras held


def _white_noise(moves: Influence, errors: ErrorModel) -> _Noise:
    """White errors of the detections, and the flight's own departure from the smoothest path (the motion prior)."""
    adjusted, own = moves.adjusted, moves.weights
    squared = own.information**2 * moves.curvature * errors.white_px2 / own.sigma_px**2
    free = np.where(adjusted.priors.free, np.inf, 0.0)
    data = solve.assemble(
        adjusted.problem,
        adjusted.state,
        replace(adjusted.priors, deviation=free, terms=()),
        replace(own, information=squared),
        adjusted.motion.weighted(0.0),
    )
    band = data.band + adjusted.motion.weight * adjusted.motion.band().T
    coupling = np.zeros((len(band), moves.n_unknowns))
    used = data.column >= 0
    np.add.at(coupling.T, data.column[used], data.coupling[:, used].T)
    follows = moves.follows.reshape(len(band), -1)
    crossed = coupling.T @ follows
    return _Noise(data.camera - crossed - crossed.T + follows.T @ _banded_product(band, follows), band)


def _prior_gradient(moves: Influence) -> FloatArray:
    """Covariance (p, p) of the gradient under the errors of the priors, which the adjustment tightened on purpose."""
    return moves.adjusted.inflation * moves.known


def _banded_product(band: FloatArray, x: FloatArray) -> FloatArray:
    """A x for a symmetric A kept as its band (n, w) and x (n, k)."""
    out = band[:, :1] * x
    for d in range(1, band.shape[1]):
        entry = band[:-d, d, None]
        out[d:] += entry * x[:-d]
        out[:-d] += entry * x[d:]
    return out


def _sandwich_band(matrix: FloatArray, middle: FloatArray) -> FloatArray:
    """The band (n, w) of H^-1 M H^-1: minus the derivative of (H + t M)^-1 by t, by a central difference."""
    inverses: list[FloatArray] = []
    for sign in (-1, 1):
        nudged = np.array(matrix + sign * _NUDGE * middle, order="C")
        if not banded.factorise(nudged):
            raise np.linalg.LinAlgError("the spline's matrix is not positive definite")
        inverses.append(banded.inverse_band(nudged))
    difference, other = inverses
    difference -= other
    difference /= 2 * _NUDGE
    return difference


def _quadratic(response: FloatArray, covariance: FloatArray) -> FloatArray:
    """Variances (...) of linear functions (..., p) of parameters with a covariance (p, p)."""
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


def _similarities(points: FloatArray) -> FloatArray:
    """Displacements (n, 3, 7) of points (n, 3) under unit translations, rotations and scaling."""
    out = np.zeros((len(points), 3, 7))
    out[:, :, :3] = np.eye(3)
    out[:, :, 3:6] = -hat(points)
    out[:, :, 6] = points
    return out


def _least_squares(columns: FloatArray, responses: FloatArray) -> FloatArray:
    """The combination (q, p) of columns (n, 3, q) closest to responses (n, 3, p)."""
    flat = columns.reshape(-1, columns.shape[2])
    scale = np.maximum(np.linalg.norm(flat, axis=0), 1e-300)
    Q, R = np.linalg.qr(flat / scale)
    return np.linalg.lstsq(R, Q.T @ responses.reshape(len(flat), -1), rcond=None)[0] / scale[:, None]
