"""The adjustment of a scene: from recordings and a first guess to the estimate, its weights and its residuals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from skytrace.estimation import noise
from skytrace.estimation.adjust import banded, normal, solve
from skytrace.estimation.adjust.camera_priors import CameraTerm, Priors
from skytrace.estimation.adjust.problem import (
    ASPECT,
    CENTRE,
    FOCAL,
    LENS,
    N_PARAMETERS,
    OFFSET,
    RATE,
    READOUT,
    ROTATION,
    Observations,
    Problem,
    State,
    Weights,
    calibration_row,
)
from skytrace.estimation.adjust.settings import AdjustSettings, Freedom
from skytrace.estimation.known import Known
from skytrace.estimation.lens_priors import lens_prior
from skytrace.estimation.priors import (
    MotionPrior,
    automatic_weight,
    balanced,
    energy_trace,
    given_weight,
    motion_prior,
)
from skytrace.estimation.scene import CameraState, Scene
from skytrace.geometry.arrays import FloatArray, IntArray
from skytrace.geometry.rigid import Rigid, nearest_rotation
from skytrace.model.track import Recording


@dataclass(frozen=True, eq=False, slots=True)
class Adjusted:
    """The outcome: the scene, and what is needed to judge it."""

    scene: Scene
    camera_ids: tuple[str, ...]
    problem: Problem
    state: State
    priors: Priors
    weights: Weights
    motion: MotionPrior
    frames: IntArray  # (n,) frame of each observation
    residual_px: FloatArray  # (n, 2) projected minus measured; NaN where the trajectory does not reach
    inflation: float  # residuals per independent one, of the slowest camera: deviations grow by its root
    cost: float
    iterations: int
    ending: solve.Ending  # of the last round
    known: Known | None = None  # what it was told of the cameras

    @property
    def converged(self) -> bool:
        return self.ending == "converged"


def adjust(
    scene: Scene,
    recordings: Mapping[str, Recording],
    settings: AdjustSettings,
    freedom: Freedom,
    *,
    rounds: int,
    iterations: int,
    last_iterations: int | None = None,
    previous: Adjusted | None = None,
    terms: tuple[CameraTerm, ...] = (),
    known: Known | None = None,
) -> Adjusted:
    """Alternate the minimisation with the estimation of noise, of its correlation, and of the motion prior's weight.

    Each round takes at most `iterations`, the last one `last_iterations`. A `previous` adjustment of the same cameras
    lends its noise and prior weight to the first round; otherwise they come from the scene as it is. `terms` are what
    is known of the cameras beside their priors, in the order of the scene's cameras; `known`, where the flight tells
    it, replaces their own priors, and where the scene lies in its frame, the gauge of the reference camera.
    """
    camera_ids = tuple(scene.cameras)
    problem, state, frames = build(scene, recordings, camera_ids)
    if known is not None:
        problem = replace(problem, unit_held=not (known.placed and known.unit_known))
        terms = (*terms, *known.terms(state, camera_ids))
    motion = motion_prior(settings.motion_prior, problem.grid.spacing_s, problem.grid.runs, 1.0)
    motion = replace(motion, extent=_seen_by_two(problem, state))
    if previous is not None and previous.camera_ids == camera_ids:
        weights, common, first = previous.weights, previous.inflation, previous.motion.weight
    else:
        weights, common = estimate_weights(problem, state, frames, recordings, camera_ids, settings)
        first = motion.rank / max(motion.energy(state.control), 1e-300)
    if settings.motion_prior_weight is not None:
        first = given_weight(motion, state.control, settings.motion_prior_weight)
    if motion.automatic:
        motion = balanced(motion, state.control, first)
    priors = make_priors(problem, recordings, camera_ids, settings, freedom, common, terms, known)
    if known is not None:
        state = known.started(state, priors.mean, priors.deviation)
    total = 0
    solution = solve.Solution(state, np.inf, 0, "iterations")
    for k in range(rounds):
        priors = make_priors(problem, recordings, camera_ids, settings, freedom, common, terms, known)
        most = last_iterations if last_iterations is not None and k == rounds - 1 else iterations
        solution = solve.minimise(
            problem, state, priors, weights, motion, max_iterations=most, tolerance=settings.tolerance
        )
        state, total = solution.state, total + solution.iterations
        if k < rounds - 1:
            weights, common = estimate_weights(problem, state, frames, recordings, camera_ids, settings)
            motion = reweighted(problem, state, priors, weights, motion, settings.motion_prior_weight)
    return Adjusted(
        to_scene(scene, problem, state, recordings, camera_ids),
        camera_ids,
        problem,
        state,
        priors,
        weights,
        motion,
        frames,
        solve.predict(problem, state) - problem.observations.xy_px,
        common,
        solution.cost,
        total,
        solution.ending,
        known,
    )


def build(
    scene: Scene, recordings: Mapping[str, Recording], camera_ids: tuple[str, ...]
) -> tuple[Problem, State, IntArray]:
    """The problem, its start and the frame number of each observation."""
    if scene.grid is None or scene.control is None:
        raise ValueError("scene: expected a fitted trajectory")
    camera, tau, row, xy, frames, calibration, clock = [], [], [], [], [], [], []
    for index, camera_id in enumerate(camera_ids):
        recording, known = recordings[camera_id], scene.cameras[camera_id]
        times = np.concatenate([recording.camera_time_s(track) for track in recording.tracks])
        pixels = np.concatenate([track.xy_px for track in recording.tracks])
        mean = mean_camera_time_s(recording)
        camera.append(np.full(len(times), index))
        tau.append(times - mean)
        row.append(pixels[:, 1] / recording.intrinsics.height_px)
        xy.append(pixels)
        frames.append(np.concatenate([track.frame for track in recording.tracks]))
        calibration.append(calibration_row(recording.intrinsics))
        clock.append([known.offset_s + known.rate * mean, known.rate, known.readout_s])
    observations = Observations(np.concatenate(camera), np.concatenate(tau), np.concatenate(row), np.concatenate(xy))
    poses = [scene.cameras[c].camera_from_world for c in camera_ids]
    state = State(
        np.stack([p.rotation for p in poses]),
        np.stack([p.centre for p in poses]),
        np.array(clock),
        np.stack([scene.cameras[c].lens for c in camera_ids]),
        np.array(scene.control),
    )
    problem = Problem(observations, np.stack(calibration), scene.grid, camera_ids.index(scene.reference))
    return problem, state, np.concatenate(frames)


def mean_camera_time_s(recording: Recording) -> float:
    """Mean camera time of all detections."""
    total = sum(float(recording.camera_time_s(track).sum()) for track in recording.tracks)
    return total / recording.n_detections


def to_scene(
    scene: Scene, problem: Problem, state: State, recordings: Mapping[str, Recording], camera_ids: tuple[str, ...]
) -> Scene:
    """The scene at a state."""
    cameras = {}
    for i, camera_id in enumerate(camera_ids):
        at_mean, rate, readout = state.clock[i]
        cameras[camera_id] = CameraState(
            Rigid.from_centre(nearest_rotation(state.rotation[i]), state.centre[i]),
            float(at_mean - rate * mean_camera_time_s(recordings[camera_id])),
            float(rate),
            float(readout),
            state.lens[i],
        )
    return Scene(scene.reference, cameras, problem.grid, state.control)


def make_priors(
    problem: Problem,
    recordings: Mapping[str, Recording],
    camera_ids: tuple[str, ...],
    settings: AdjustSettings,
    freedom: Freedom,
    inflation: float,
    terms: tuple[CameraTerm, ...] = (),
    known: Known | None = None,
) -> Priors:
    """Priors in units of the white-noise objective.

    The residuals' correlation makes that objective overstate the data by `inflation`, so the priors are tightened by
    its root: the estimate is that of honest data against honest priors.
    """
    n = problem.n_cameras
    mean, deviation = np.zeros((n, N_PARAMETERS)), np.zeros((n, N_PARAMETERS))
    period = np.array([1 / recordings[c].frame_rate_hz for c in camera_ids])
    mean[:, RATE], mean[:, READOUT] = 1.0, settings.readout_fraction * period
    deviation[:, ROTATION] = deviation[:, CENTRE] = np.inf
    if freedom.clocks:
        deviation[:, OFFSET], deviation[:, RATE] = np.inf, settings.rate_sigma
    if freedom.rolling_shutter:
        deviation[:, READOUT] = settings.readout_sigma * period
    own = [lens_prior(recordings[c].intrinsics, settings) for c in camera_ids]
    mean[:, LENS], lenses = np.stack([m for m, _ in own]), np.stack([d for _, d in own])
    if freedom.focal:
        deviation[:, FOCAL] = lenses[:, 0]
    if freedom.lens:
        deviation[:, ASPECT : LENS.stop] = lenses[:, 1:]
    if known is not None:
        known.enter(mean, deviation, camera_ids, freedom.rolling_shutter)
    # The gauge: clock and pose of the reference camera, the pose only where nothing tells the frame.
    deviation[problem.reference, OFFSET : RATE + 1] = 0.0
    if known is None or not known.placed:
        deviation[problem.reference, : CENTRE.stop] = 0.0
    return Priors(mean, deviation / np.sqrt(inflation), tuple(term.tightened(inflation) for term in terms))


def estimate_weights(
    problem: Problem,
    state: State,
    frames: IntArray,
    recordings: Mapping[str, Recording],
    camera_ids: tuple[str, ...],
    settings: AdjustSettings,
) -> tuple[Weights, float]:
    """Each camera's noise and information per residual, and how much the residuals' correlation inflates variances.

    Correlations last some time whatever the frame rate, so a residual of a fast camera carries less information than
    one of a slow camera. The inflation is that of the slowest camera for one correlation time common to all.
    """
    residual = solve.predict(problem, state) - problem.observations.xy_px
    sigma, correlation_s, rate = np.ones(len(camera_ids)), np.zeros(len(camera_ids)), np.zeros(len(camera_ids))
    for i, camera_id in enumerate(camera_ids):
        own = problem.observations.camera == i
        rate[i] = recordings[camera_id].frame_rate_hz
        sigma[i] = noise.robust_sigma(residual[own])
        correlation_s[i] = (
            noise.inflation(
                residual[own], frames[own], sigma[i], rate[i], loss_scale=settings.loss_scale, loss=settings.loss
            )
            / rate[i]
        )
    slowest = float(rate.min())
    # The camera that shows most correlation is the one whose slow errors the trajectory follows least.
    common = max(1.0, float(correlation_s.max()) * slowest * _absorbed(problem, state))
    # A camera whose noise seems to vanish is being followed by the spline, not measured better than all others.
    sigma = np.maximum(sigma, settings.smallest_sigma_ratio * float(np.median(sigma)))
    return Weights(sigma, slowest / rate, settings.loss_scale, settings.loss), common


def _cameras_per_interval(problem: Problem, state: State) -> tuple[IntArray, IntArray]:
    """Knot intervals (k,) in which the target was seen, and by how many cameras (k,)."""
    o = problem.observations
    time = state.clock[o.camera, 0] + state.clock[o.camera, 1] * o.tau_s
    interval = np.floor(time / problem.grid.spacing_s).astype(np.int64)
    moments = np.unique(interval * problem.n_cameras + o.camera)
    return np.unique(moments // problem.n_cameras, return_counts=True)


def _seen_by_two(problem: Problem, state: State) -> FloatArray:
    """1 for control points (m,) in the middle of intervals seen by two cameras, else 0."""
    interval, cameras = _cameras_per_interval(problem, state)
    middle_s = (interval[cameras >= 2] + 0.5).astype(np.float64) * problem.grid.spacing_s
    first, _ = problem.grid.locate(middle_s)
    first = first[first >= 0]
    extent = np.zeros(problem.grid.n_control)
    extent[first + 1] = extent[first + 2] = 1.0
    return extent


def _absorbed(problem: Problem, state: State) -> float:
    """How much more slow noise there is than the residuals show, because the trajectory follows it.

    Each moment has two measurements per camera in view and three unknowns: of slow errors, which the spline can follow,
    only the share (2 c - 3) / (2 c) remains in the residuals of c cameras.
    """
    _, cameras = _cameras_per_interval(problem, state)
    c = cameras[cameras >= 2]
    return float((2 * c).sum() / (2 * c - 3).sum()) if len(c) else 1.0


def reweighted(
    problem: Problem,
    state: State,
    priors: Priors,
    weights: Weights,
    motion: MotionPrior,
    given: float | None = None,
) -> MotionPrior:
    """The motion prior with its automatic weight at a state, or with the relative one that is given."""
    if not motion.automatic:
        return motion
    if given is not None:
        return balanced(motion, state.control, given_weight(motion, state.control, given))
    equations = solve.assemble(problem, state, priors, weights, motion)
    factor = normal.eliminate(equations, 0.0)
    trace = energy_trace(motion, banded.inverse_band(factor.band).T)
    return balanced(motion, state.control, automatic_weight(motion, state.control, trace))
