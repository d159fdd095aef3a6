"""The compiled loops against plain numpy: projections, derivatives, normal equations, banded inverse.

`random_problem` and `random_state` also serve the tests of what is built on the kernel.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skytrace.estimation.adjust import kernel, solve
from skytrace.estimation.adjust.problem import (
    N_PARAMETERS,
    KnotGrid,
    Observations,
    Problem,
    State,
    Weights,
)
from skytrace.estimation.scene import CameraState
from skytrace.geometry.rigid import Rigid, so3_exp
from skytrace.model.camera import Intrinsics
from skytrace.solvers import bspline

STRONG = np.array([[0.19, -0.76, 2e-3, -1.5e-3, 0.94], [-0.25, 0.08, -3e-3, 2e-3, 0.0], [0.08, -0.2, 1e-3, 4e-3, -0.1]])
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
    calibration = np.hstack([focal, principal, STRONG[np.arange(n_cameras) % 3]])
    problem = Problem(Observations(camera, tau, row, np.zeros((len(camera), 2))), calibration, grid, reference)
    xy = solve.predict(problem, state) + noise_px * rng.normal(size=(len(camera), 2))
    return replace(problem, observations=replace(problem.observations, xy_px=xy))


def random_weights(rng, n_cameras=3):
    return Weights(rng.uniform(0.4, 2.0, n_cameras), rng.uniform(0.3, 1.0, n_cameras))


def arguments(problem, state):
    o, g = problem.observations, problem.grid
    return (
        o.camera, o.tau_s, o.row, state.rotation, state.centre, state.clock, state.lens, problem.calibration,
        state.control, g.control_of_interval(), g.first_interval, g.spacing_s,
    )  # fmt: skip


def moved(state, camera_step=None, control_step=None):
    n, m = len(state.centre), len(state.control)
    return state.moved(
        np.zeros((n, N_PARAMETERS)) if camera_step is None else camera_step,
        np.zeros((m, 3)) if control_step is None else control_step,
    )


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
        fx, fy, cx, cy, *distortion = problem.calibration[c]
        pose = Rigid.from_centre(state.rotation[c], state.centre[c])
        lens = CameraState(pose, 0.0, 1.0, 0.0, state.lens[c]).intrinsics(
            Intrinsics([fx, fy], [cx, cy], distortion, SIZE)
        )
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
    J = kernel.jacobian(*arguments(problem, replace(state, rotation=about_face)))
    np.testing.assert_array_equal(np.isnan(J).any(axis=(1, 2)), problem.observations.camera == 1)


# Sizes of a difference step for each camera parameter.
_STEPS = np.array([1e-6] * 3 + [1e-5] * 3 + [1e-6] * 3 + [1e-6] * 4 + [1e-5] * 3)


@pytest.mark.parametrize("seed", range(5))
def test_jacobian_equals_central_differences(seed):
    rng = np.random.default_rng(seed)
    state = random_state(rng)
    problem = random_problem(rng, state)
    J = kernel.jacobian(*arguments(problem, state))
    assert J.shape == (len(problem.observations), 2, 19)
    for k in range(19):
        sides = []
        for sign in (1, -1):
            if k < N_PARAMETERS:
                other = moved(state, camera_step=sign * _STEPS[k] * np.tile(np.eye(N_PARAMETERS)[k], (3, 1)))
            else:  # all control points together move every point of the path alike
                other = moved(state, control_step=sign * 1e-5 * np.tile(np.eye(3)[k - 16], (len(state.control), 1)))
            sides.append(solve.predict(problem, other))
        numeric = (sides[0] - sides[1]) / (2 * (_STEPS[k] if k < N_PARAMETERS else 1e-5))
        largest = np.abs(numeric).max()
        assert largest > 1
        np.testing.assert_allclose(J[:, :, k], numeric, rtol=1e-5, atol=1e-7 * largest, err_msg=f"parameter {k}")


def test_the_point_moves_the_projection_through_its_control_points(problem, state, rng):
    """One control point moves a projection by its basis weight times the derivative by the point."""
    J = kernel.jacobian(*arguments(problem, state))
    first, u = problem.grid.locate(times_of(problem, state))
    weights = bspline.basis(u)
    for index in (0, 5, 14, 17, 23):
        step = np.zeros_like(state.control)
        step[index] = 1e-5 * rng.normal(size=3)
        sides = [solve.predict(problem, moved(state, control_step=sign * step)) for sign in (1, -1)]
        weight = np.zeros(len(first))
        for k in range(4):
            weight[first + k == index] = weights[first + k == index, k]
        np.testing.assert_allclose(
            (sides[0] - sides[1]) / 2, weight[:, None] * (J[:, :, 16:] @ step[index]), rtol=0, atol=1e-9
        )
        assert (weight > 0).any()


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


def dense_jacobian(problem, state):
    """(2 n, 16 c + 3 m): cameras first, then control points, coordinates interleaved."""
    J = kernel.jacobian(*arguments(problem, state))
    n, c, m = len(J), problem.n_cameras, len(state.control)
    first, u = problem.grid.locate(times_of(problem, state))
    weights = bspline.basis(u)
    full = np.zeros((n, 2, 16 * c + 3 * m))
    for i in range(n):
        k = problem.observations.camera[i]
        full[i, :, 16 * k : 16 * k + 16] = J[i, :, :16]
        for d in range(4):
            at = 16 * c + 3 * (first[i] + d)
            full[i, :, at : at + 3] = weights[i, d] * J[i, :, 16:]
    return full.reshape(2 * n, -1)


def dense_normal_equations(problem, state, weights):
    """(16 c + 3 m) square matrix and gradient of the robust cost, by matrix products."""
    J = dense_jacobian(problem, state)
    residual = solve.predict(problem, state) - problem.observations.xy_px
    sigma, information = (a[problem.observations.camera] for a in (weights.sigma_px, weights.information))
    s = (residual**2).sum(axis=1) / sigma**2
    w = np.repeat(information / (sigma**2 * (1 + s / weights.loss_scale**2)), 2)
    return J.T @ (w[:, None] * J), J.T @ (w * residual.ravel())


def assert_relative(actual, expected, tolerance):
    np.testing.assert_allclose(actual, expected, rtol=0, atol=tolerance * np.abs(expected).max())


def test_normal_equations_equal_a_plain_dense_assembly(problem, state, rng):
    weights = random_weights(rng)
    H, g = dense_normal_equations(problem, state, weights)
    camera, camera_gradient, coupling, blocks, spline_gradient = kernel.normal_equations(
        *arguments(problem, state)[:3], problem.observations.xy_px, *arguments(problem, state)[3:],
        weights.sigma_px, weights.information, weights.loss_scale,
    )  # fmt: skip
    c, m = problem.n_cameras, len(state.control)
    for k in range(c):
        own = slice(16 * k, 16 * k + 16)
        assert_relative(camera[k], H[own, own], 1e-10)
        assert_relative(camera_gradient[k], g[own], 1e-10)
        assert_relative(coupling[k].reshape(3 * m, 16), H[16 * c :, own], 1e-10)
        for other in range(c):
            if other != k:
                assert not H[own, 16 * other : 16 * other + 16].any()
    spline = H[16 * c :, 16 * c :].reshape(m, 3, m, 3)
    seen = np.zeros_like(spline, dtype=bool)
    for i in range(m):
        for d in range(4):
            if i + d < m:
                assert_relative(blocks[i, d], spline[i, :, i + d], 1e-10) if spline[i, :, i + d].any() else None
                seen[i, :, i + d] = seen[i + d, :, i] = True
            else:
                assert not blocks[i, d].any()
    assert not spline[~seen].any()
    assert_relative(spline_gradient.ravel(), g[16 * c :], 1e-10)
    # The band keeps the lower triangle of the same matrix.
    band = solve.spline_band(blocks)
    dense = H[16 * c :, 16 * c :]
    for d in range(12):
        assert_relative(band[d, : 3 * m - d], np.diag(dense, -d), 1e-10) if np.diag(dense, -d).any() else None
        assert not band[d, 3 * m - d :].any()


def test_what_is_not_predicted_does_not_enter_the_normal_equations(problem, state, rng):
    weights = random_weights(rng)

    def equations(p):
        a = arguments(p, state)
        return kernel.normal_equations(
            *a[:3], p.observations.xy_px, *a[3:], weights.sigma_px, weights.information, weights.loss_scale
        )

    o = problem.observations
    lost = replace(
        problem,
        observations=Observations(
            np.append(o.camera, 1), np.append(o.tau_s, 1e4), np.append(o.row, 0.5), np.vstack([o.xy_px, [[1.0, 2.0]]])
        ),
    )
    for with_lost, without in zip(equations(lost), equations(problem), strict=True):
        np.testing.assert_array_equal(with_lost, without)


def test_robust_cost_by_hand():
    measured = np.zeros((4, 2))
    predicted = np.array([[0.0, 0.0], [3.0, 4.0], [300.0, 400.0], [np.nan, np.nan]])
    camera = np.array([0, 0, 1, 1])
    sigma, information, c2 = np.array([1.0, 10.0]), np.array([1.0, 0.5]), 2.0**2
    expected = 0.5 * c2 * (np.log1p(25 / c2) + 0.5 * np.log1p(2500 / c2) + 0.5 * np.log1p(100.0))
    assert kernel.robust_cost(measured, predicted, camera, sigma, information, 2.0) == pytest.approx(expected)


@pytest.mark.parametrize(("n", "width"), [(1, 1), (1, 4), (7, 4), (30, 4), (40, 12), (5, 12)])
def test_banded_inverse_equals_the_band_of_the_dense_inverse(n, width, rng):
    from scipy.linalg import cholesky_banded

    L = np.tril(rng.normal(size=(n, n)))
    L[np.subtract.outer(np.arange(n), np.arange(n)) >= width] = 0
    L[np.diag_indices(n)] = rng.uniform(1, 2, n)
    A = L @ L.T
    band = np.zeros((width, n))
    for d in range(min(width, n)):
        band[d, : n - d] = np.diag(A, -d)
    Z = kernel.banded_inverse(cholesky_banded(band, lower=True))
    inverse = np.linalg.inv(A)
    for d in range(min(width, n)):
        np.testing.assert_allclose(Z[d, : n - d], np.diag(inverse, -d), rtol=0, atol=1e-9 * np.abs(inverse).max())
