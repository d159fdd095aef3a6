"""The compiled loops over the detections: projections, what is not predicted, gauge invariance, cost.

`random_problem` and `random_state` also serve the tests of what is built on the kernel.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skytrace.estimation.adjust import solve
from skytrace.estimation.adjust.camera_priors import Priors
from skytrace.estimation.adjust.problem import (
    N_PARAMETERS,
    KnotGrid,
    Observations,
    Problem,
    State,
    Weights,
    calibration_row,
)
from skytrace.estimation.priors import motion_prior
from skytrace.estimation.scene import CameraState
from skytrace.geometry.projection import LensModel
from skytrace.geometry.rigid import Rigid, so3_exp
from skytrace.model.camera import Intrinsics

STRONG: tuple[tuple[LensModel, list[float]], ...] = (
    ("pinhole", [0.19, -0.76, 2e-3, -1.5e-3, 0.94]),
    ("fisheye", [0.12, -0.3, 0.2, -0.05]),
    ("pinhole", [-0.25, 0.08, -3e-3, 2e-3, 0.0]),
)
SIZE = (1920, 1080)
RUNS = ((-4, 8), (11, 17))
SPACING_S = 0.25


def random_state(rng, n_cameras=3, runs=RUNS):
    """Cameras on a ring that look inwards on a path some 20 m across; clocks and lenses off their nominal values."""
    rotations, centres = [], []
    for azimuth in 2 * np.pi * (np.arange(n_cameras) + rng.uniform(-0.2, 0.2, n_cameras)) / n_cameras:
        centre = np.array([30 * np.cos(azimuth), 30 * np.sin(azimuth), rng.uniform(-8, 8)])
        forward = -centre / np.linalg.norm(centre)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        rotations.append(so3_exp(rng.normal(0, 0.05, 3)) @ np.stack([right, np.cross(forward, right), forward]))
        centres.append(centre)
    clock = np.column_stack(
        [rng.uniform(-0.5, 0.5, n_cameras), 1 + 1e-3 * rng.normal(size=n_cameras), rng.uniform(0.01, 0.03, n_cameras)]
    )
    lens = rng.normal(size=(n_cameras, 7)) * [0.02, 0.01, 0.01, 0.01, 0.02, 0.05, 0.05]
    control = np.concatenate([np.cumsum(rng.normal(size=(b - a + 3, 3)), axis=0) for a, b in runs])
    control -= 0.5 * (control.min(axis=0) + control.max(axis=0))
    return State(np.stack(rotations), np.stack(centres), clock, lens, 11 * control / np.abs(control).max(axis=0))


def random_problem(rng, state, per_camera=60, runs=RUNS, noise_px=0.0, reference=0):
    """Detections of a state spread over all runs, off by noise."""
    grid = KnotGrid(SPACING_S, runs)
    n_cameras = len(state.centre)
    camera = np.repeat(np.arange(n_cameras), per_camera)
    row = rng.uniform(0, 1, len(camera))
    intervals = np.concatenate([np.arange(a, b) for a, b in runs])
    # Every interval in turn, so that each camera sees all of them.
    at = SPACING_S * (np.resize(intervals, per_camera) + rng.uniform(0, 1, (n_cameras, per_camera))).ravel()
    tau = (at - state.clock[camera, 0] - state.clock[camera, 2] * row) / state.clock[camera, 1]
    focal = rng.uniform(1300, 1700, (n_cameras, 1)) * [1.0, 0.98]
    principal = [960.0, 540.0] + rng.normal(0, 20, (n_cameras, 2))
    lenses = [Intrinsics(focal[c], principal[c], STRONG[c % 3][1], SIZE, STRONG[c % 3][0]) for c in range(n_cameras)]
    calibration = np.stack([calibration_row(lens) for lens in lenses])
    problem = Problem(Observations(camera, tau, row, np.zeros((len(camera), 2))), calibration, grid, reference)
    xy = solve.predict(problem, state) + noise_px * rng.normal(size=(len(camera), 2))
    return replace(problem, observations=replace(problem.observations, xy_px=xy))


def random_weights(rng, n_cameras=3):
    return Weights(rng.uniform(0.4, 2.0, n_cameras), rng.uniform(0.3, 1.0, n_cameras))


def moved(state, camera_step=None, control_step=None):
    n, m = len(state.centre), len(state.control)
    return state.moved(
        np.zeros((n, N_PARAMETERS)) if camera_step is None else camera_step,
        np.zeros((m, 3)) if control_step is None else control_step,
    )


def taken(observations, index):
    """The observations of some indices, in their order."""
    o = observations
    return Observations(o.camera[index], o.tau_s[index], o.row[index], o.xy_px[index])


def times_of(problem, state):
    o = problem.observations
    at_mean, rate, readout = state.clock[o.camera].T
    return at_mean + rate * o.tau_s + readout * o.row


@pytest.fixture
def state(rng):
    return random_state(rng)


@pytest.fixture
def problem(rng, state):
    return random_problem(rng, state, noise_px=1.0)


def test_predictions_are_those_of_the_model_types(problem, state):
    """Against Rigid, Intrinsics and the knot grid's own evaluation."""
    predicted = solve.predict(problem, state)
    points = problem.grid.evaluate(state.control, times_of(problem, state))
    for c in range(problem.n_cameras):
        model, distortion = STRONG[c]
        calibrated = Intrinsics(problem.calibration[c, :2], problem.calibration[c, 2:4], distortion, SIZE, model)
        pose = Rigid.from_centre(state.rotation[c], state.centre[c])
        lens = CameraState(pose, 0.0, 1.0, 0.0, state.lens[c]).intrinsics(calibrated)
        own = problem.observations.camera == c
        np.testing.assert_allclose(predicted[own], lens.project(pose.apply(points[own])), rtol=0, atol=1e-9)
    assert np.ptp(predicted, axis=0).min() > 500  # the path fills the images, where the lenses bend


def test_outside_the_runs_and_behind_the_camera_nothing_is_predicted(rng, state):
    problem = random_problem(rng, state)
    edges = SPACING_S * np.array([-4.0 - 1e-6, -4.0, 8.0 - 1e-6, 8.0, 9.5, 11.0, 17.0 - 1e-6, 17.0, 400.0, -400.0])
    clock = np.array(state.clock)
    clock[0] = [0.0, 1.0, 0.0]
    n = len(edges)
    seen = Observations(np.zeros(n, int), edges, np.zeros(n), np.zeros((n, 2)))
    at_edges = replace(problem, observations=seen)
    inside = np.array([0, 1, 1, 0, 0, 1, 1, 0, 0, 0], bool)
    predicted = solve.predict(at_edges, replace(state, clock=clock))
    np.testing.assert_array_equal(np.isfinite(predicted).all(axis=1), inside)
    np.testing.assert_array_equal(np.isnan(predicted).all(axis=1), ~inside)
    about_face = np.array(state.rotation)
    about_face[1] = np.diag([-1.0, 1.0, -1.0]) @ about_face[1]
    predicted = solve.predict(problem, replace(state, rotation=about_face))
    np.testing.assert_array_equal(np.isnan(predicted[:, 0]), problem.observations.camera == 1)


def test_predictions_do_not_depend_on_the_world_frame_or_unit(problem, state, rng):
    """Gauge invariance: turn, shift and scale the world; the images stay."""
    turn, shift, scale = so3_exp(rng.normal(size=3)), rng.normal(0, 50, 3), 7.3
    elsewhere = replace(
        state,
        rotation=state.rotation @ turn.T,
        centre=scale * state.centre @ turn.T + shift,
        control=scale * state.control @ turn.T + shift,
    )
    np.testing.assert_allclose(solve.predict(problem, elsewhere), solve.predict(problem, state), rtol=0, atol=1e-9)
    scaled = state.scaled(0.3, state.centre[1])
    np.testing.assert_allclose(solve.predict(problem, scaled), solve.predict(problem, state), rtol=0, atol=1e-9)
    np.testing.assert_allclose(scaled.centre[1], state.centre[1], rtol=0, atol=1e-12)


def no_priors(n_cameras=3):
    return Priors(np.zeros((n_cameras, N_PARAMETERS)), np.full((n_cameras, N_PARAMETERS), np.inf))


def same_equations(a, b, tolerance=0.0):
    for name in ("camera", "camera_gradient", "coupling", "band", "spline_gradient"):
        expected = getattr(b, name)
        np.testing.assert_allclose(getattr(a, name), expected, rtol=0, atol=tolerance * np.abs(expected).max())


def test_a_detection_outside_the_runs_does_not_enter_the_normal_equations(problem, state, rng):
    weights, motion = random_weights(rng), motion_prior("jerk", SPACING_S, RUNS, 1e-3)
    o = problem.observations
    lost = Observations(
        np.append(o.camera, 2), np.append(o.tau_s, 1e4), np.append(o.row, 0.5), np.vstack([o.xy_px, [[1.0, 2.0]]])
    )
    plain = solve.assemble(problem, state, no_priors(), weights, motion)
    same_equations(
        solve.assemble(replace(problem, observations=lost), state, no_priors(), weights, motion), plain, 1e-12
    )


def test_a_detection_behind_its_camera_does_not_enter_the_normal_equations(problem, state, rng):
    weights, motion = random_weights(rng), motion_prior("jerk", SPACING_S, RUNS, 1e-3)
    about_face = np.array(state.rotation)
    about_face[1] = np.diag([-1.0, 1.0, -1.0]) @ about_face[1]
    turned = replace(state, rotation=about_face)
    others = np.flatnonzero(problem.observations.camera != 1)
    without = replace(problem, observations=taken(problem.observations, others))
    found = solve.assemble(problem, turned, no_priors(), weights, motion)
    same_equations(found, solve.assemble(without, turned, no_priors(), weights, motion), 1e-12)
    assert not found.camera_gradient[N_PARAMETERS : 2 * N_PARAMETERS].any()


def test_the_order_of_the_detections_does_not_matter(problem, state, rng):
    """Sorting makes the loops fast, not right: cameras and times may come in any order."""
    weights, motion = random_weights(rng), motion_prior("jerk", SPACING_S, RUNS, 1e-3)
    shuffled = taken(problem.observations, rng.permutation(len(problem.observations)))
    same_equations(
        solve.assemble(replace(problem, observations=shuffled), state, no_priors(), weights, motion),
        solve.assemble(problem, state, no_priors(), weights, motion),
        1e-12,
    )


@pytest.mark.parametrize("copies", [1, 3])
def test_many_detections_in_one_interval_count_each(problem, state, rng, copies):
    """Runs longer than a chunk, and of odd length: every detection adds its share once."""
    weights, motion = random_weights(rng), motion_prior("jerk", SPACING_S, RUNS, 0.0)
    o = problem.observations
    repeated = np.repeat(np.arange(len(o)), 7 * copies)
    plain = solve.assemble(problem, state, no_priors(), weights, motion)
    found = solve.assemble(replace(problem, observations=taken(o, repeated)), state, no_priors(), weights, motion)
    for name in ("camera", "camera_gradient", "coupling", "band", "spline_gradient"):
        expected = 7 * copies * getattr(plain, name)
        np.testing.assert_allclose(getattr(found, name), expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_cost_by_hand(problem, state):
    """Errors of 0, 5 px in a camera of 1 px, 500 px in one of 10 px that counts half, and one that is not predicted."""
    predicted = solve.predict(problem, state)
    first = np.searchsorted(problem.observations.camera, [0, 0, 1, 1]) + [0, 1, 0, 1]
    picked = taken(problem.observations, first)
    tau = np.array(picked.tau_s)
    tau[3] = 1e4
    xy = predicted[first] - [[0.0, 0.0], [3.0, 4.0], [300.0, 400.0], [0.0, 0.0]]
    few = replace(problem, observations=replace(picked, tau_s=tau, xy_px=xy))
    weights, c2 = Weights(np.array([1.0, 10.0, 1.0]), np.array([1.0, 0.5, 1.0])), 2.0**2
    motion = motion_prior("jerk", SPACING_S, RUNS, 0.0)
    expected = 0.5 * c2 * (np.log1p(25 / c2) + 0.5 * np.log1p(2500 / c2) + 0.5 * np.log1p(100.0))
    assert solve.cost(few, state, no_priors(), weights, motion) == pytest.approx(expected, rel=1e-9)
