"""Levenberg-Marquardt on the eliminated system: against dense algebra, and back to the truth."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from test_adjust_kernel import (
    RUNS,
    SPACING_S,
    moved,
    random_problem,
    random_state,
    random_weights,
)

from skytrace.estimation.adjust import normal, solve
from skytrace.estimation.adjust.camera_priors import Priors
from skytrace.estimation.adjust.problem import (
    CENTRE,
    CLOCK,
    LENS,
    N_PARAMETERS,
    OFFSET,
    ROTATION,
)
from skytrace.estimation.priors import motion_prior
from skytrace.geometry.rigid import so3_log
from skytrace.pipeline import summary

DEVIATION = np.r_[[np.inf] * 7, 1e-2, 5e-3, 0.02, 0.005, 0.01, 0.01, 0.05, 0.1, 0.1]


def priors_about(state, off=None, reference=0):
    """Priors on rates, readouts and lenses with means at the state (or off it), the reference camera held."""
    n = len(state.centre)
    mean = np.zeros((n, N_PARAMETERS))
    mean[:, CLOCK], mean[:, LENS] = state.clock, state.lens
    deviation = np.tile(DEVIATION, (n, 1))
    deviation[reference, :8] = 0.0
    return Priors(mean if off is None else mean + off, deviation)


def weak_motion(weight=1e-12):
    return motion_prior("jerk", SPACING_S, RUNS, weight)


def dense_of(equations):
    """The whole symmetric matrix, its gradient and the constraint on the camera step."""
    p, size = len(equations.camera), len(equations.band)
    spline = np.zeros((size, size))
    for d in range(12):
        spline += np.diag(equations.band[: size - d, d], -d)
        if d:
            spline += np.diag(equations.band[: size - d, d], d)
    coupling = coupling_of(equations)
    H = np.block([[equations.camera, coupling.T], [coupling, spline]])
    constraint = np.zeros(p + size)
    constraint[:p] = equations.scale_constraint
    return H, np.concatenate([equations.camera_gradient, equations.spline_gradient]), constraint


def coupling_of(equations):
    """Columns of the coupling by unknown."""
    return equations.coupling[:, equations.column >= 0]


def kkt(A, b, d):
    """Solve A x = b subject to d . x = 0 with a Lagrange multiplier."""
    n = len(A)
    bordered = np.block([[A, d[:, None]], [d[None], np.zeros((1, 1))]])
    rhs = np.concatenate([b, np.zeros((1, *b.shape[1:]))])
    return np.linalg.solve(bordered, rhs)[:n]


@pytest.fixture
def state(rng):
    return random_state(rng)


@pytest.fixture
def noisy(rng, state):
    return random_problem(rng, state, noise_px=1.0)


@pytest.fixture
def equations(rng, state, noisy):
    off = 0.5 * DEVIATION * rng.normal(size=(3, N_PARAMETERS))
    off[:, :7] = 0
    return solve.assemble(noisy, state, priors_about(state, off), random_weights(rng), weak_motion(1e-3))


def test_a_constrained_solve_is_the_kkt_solve(rng):
    L = rng.normal(size=(9, 9)) * np.logspace(-4, 4, 9)[:, None]  # parameters of very different units
    A, d = L @ L.T, rng.normal(size=9)
    d /= np.linalg.norm(d)
    for b in (A @ rng.normal(size=9), A @ rng.normal(size=(9, 4))):
        x = normal.constrained_solve(A, b, d)
        scale = np.sqrt(np.diag(A))
        expected = kkt(A / np.outer(scale, scale), (b.T / scale).T, d / scale)
        np.testing.assert_allclose((x.T * scale).T, expected, rtol=0, atol=1e-5 * np.abs(expected).max())
        np.testing.assert_allclose(d @ x, 0, rtol=0, atol=1e-9 * np.abs(x).max())
    b = A @ rng.normal(size=9)
    np.testing.assert_allclose(A @ normal.constrained_solve(A, b, None), b, rtol=0, atol=1e-9 * np.abs(b).max())


def test_a_constrained_solve_needs_no_more_than_definiteness_on_the_plane(rng):
    d = rng.normal(size=6)
    d /= np.linalg.norm(d)
    plane = np.linalg.svd(d[None])[2][1:].T
    A = plane @ np.diag(rng.uniform(1, 3, 5)) @ plane.T  # singular along d
    b = rng.normal(size=6)
    x = normal.constrained_solve(A, b, d)
    np.testing.assert_allclose(x, plane @ np.linalg.solve(plane.T @ A @ plane, plane.T @ b), rtol=0, atol=1e-9)
    with pytest.raises(np.linalg.LinAlgError):
        normal.constrained_solve(-A, b, d)


def test_the_gradient_is_the_slope_of_the_cost(rng, state, noisy):
    off = 0.3 * DEVIATION * rng.normal(size=(3, N_PARAMETERS))
    off[:, :7] = 0
    priors, weights, motion = priors_about(state, off), random_weights(rng), weak_motion(1e-3)
    equations = solve.assemble(noisy, state, priors, weights, motion)

    def slope(camera=None, control=None):
        sides = [
            solve.cost(noisy, moved(state, *(None if s is None else sign * s for s in (camera, control))), priors,
                       weights, motion)
            for sign in (1, -1)
        ]  # fmt: skip
        return (sides[0] - sides[1]) / 2

    numeric = []
    for c, k in np.argwhere(priors.free):
        step = np.zeros((3, N_PARAMETERS))
        step[c, k] = 1e-6
        numeric.append(slope(camera=step) / 1e-6)
    atol = 1e-6 * np.abs(equations.camera_gradient).max()
    np.testing.assert_allclose(equations.camera_gradient, numeric, rtol=1e-5, atol=atol)
    for i in (0, 4, 14, 16, 23):
        for axis in range(3):
            step = np.zeros((len(state.control), 3))
            step[i, axis] = 1e-6
            assert equations.spline_gradient[3 * i + axis] == pytest.approx(
                slope(control=step) / 1e-6, rel=1e-5, abs=1e-6 * np.abs(equations.spline_gradient).max()
            )


@pytest.mark.parametrize("damping", [0.0, 1e-4, 1.0])
def test_a_step_is_the_dense_solution_of_the_whole_damped_system(equations, damping):
    H, g, constraint = dense_of(equations)
    scale = np.sqrt(np.diag(H))
    damped = (H + damping * np.diag(np.diag(H))) / np.outer(scale, scale)
    expected = kkt(damped, -g / scale, constraint / scale)
    camera, spline = normal.step(equations, normal.eliminate(equations, damping))
    found = np.concatenate([camera, spline]) * scale
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8 * np.abs(expected).max())
    assert abs(constraint[: len(camera)] @ camera) < 1e-9 * np.linalg.norm(camera)


def test_the_scale_direction_changes_the_unit_of_length_and_nothing_else(equations, state):
    free = priors_about(state).free
    direction = np.zeros(free.shape)
    direction[free] = equations.scale_constraint
    assert np.linalg.norm(direction) == pytest.approx(1)
    outward = state.centre - state.centre[0]
    np.testing.assert_allclose(direction[:, CENTRE], outward / np.linalg.norm(outward), rtol=0, atol=1e-12)
    direction[:, CENTRE] = 0
    assert not direction.any()


def test_parameters_of_one_unknown_move_together(equations, rng):
    """Two cameras of one lens: the system is that of the sum of their columns."""
    p = len(equations.camera)
    own = np.arange(p)
    own[equations.column[16 + 9]] = own[equations.column[32 + 9]]  # the focal lengths of the second and third camera
    _, own = np.unique(own, return_inverse=True)
    S = np.zeros((p, p - 1))
    S[np.arange(p), own] = 1
    tied = replace(
        equations,
        camera=S.T @ equations.camera @ S,
        camera_gradient=S.T @ equations.camera_gradient,
        column=np.where(equations.column >= 0, own[equations.column], -1),
        scale_constraint=equations.scale_constraint @ S,
    )
    H, g, constraint = dense_of(equations)
    T = np.block([[S, np.zeros((p, len(H) - p))], [np.zeros((len(H) - p, p - 1)), np.eye(len(H) - p)]])
    scale = np.sqrt(np.diag(T.T @ H @ T))
    expected = kkt(T.T @ H @ T / np.outer(scale, scale), -(g @ T) / scale, constraint @ T / scale)
    camera, spline = normal.step(tied, normal.eliminate(tied, 0.0))
    found = np.concatenate([camera, spline]) * scale
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8 * np.abs(expected).max())


def test_an_indefinite_spline_block_is_an_error(equations):
    broken = replace(equations, band=-equations.band)
    with pytest.raises(np.linalg.LinAlgError):
        normal.eliminate(broken, 0.0)


def perturbed(state, rng, size=1.0):
    step = size * rng.normal(size=(3, N_PARAMETERS)) * np.r_[
        [0.005] * 3, [0.2] * 3, 0.005, 2e-4, 2e-3, 0.004, 0.001, 0.002, 0.002, 0.005, 0.01, 0.01
    ]  # fmt: skip
    step[0, :8] = 0
    return moved(state, step, size * rng.normal(0, 0.15, state.control.shape))


def spread(state):
    return np.linalg.norm(state.centre - state.centre[0])


@pytest.mark.parametrize("seed", range(3))
def test_exact_data_lead_back_to_the_truth(seed):
    rng = np.random.default_rng(seed)
    truth = random_state(rng)
    problem = random_problem(rng, truth, per_camera=120)
    weights, priors = replace(random_weights(rng), loss_scale=50.0), priors_about(truth)
    start = perturbed(truth, rng)
    # The unit of length is that of the start.
    start = start.scaled(spread(truth) / spread(start), start.centre[0])
    error = solve.predict(problem, start) - problem.observations.xy_px
    assert np.nanmedian(np.abs(error)) > 5
    found = solve.minimise(problem, start, priors, weights, weak_motion(0.0), max_iterations=60, tolerance=1e-12)
    assert found.cost < 1e-12
    state = found.state
    turn = max(np.linalg.norm(so3_log(a @ b.T)) for a, b in zip(state.rotation, truth.rotation, strict=True))
    assert turn < 1e-10
    np.testing.assert_allclose(state.centre, truth.centre, rtol=0, atol=1e-9)
    np.testing.assert_allclose(state.clock, truth.clock, rtol=0, atol=1e-11)
    np.testing.assert_allclose(state.lens, truth.lens, rtol=0, atol=1e-10)
    np.testing.assert_allclose(state.control, truth.control, rtol=0, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_no_iteration_raises_the_cost(seed):
    rng = np.random.default_rng(seed)
    truth = random_state(rng)
    problem = random_problem(rng, truth, noise_px=1.0)
    wrong = rng.permutation(len(problem.observations))[:30]
    xy = np.array(problem.observations.xy_px)
    xy[wrong] = rng.uniform(0, 1000, (30, 2))
    problem = replace(problem, observations=replace(problem.observations, xy_px=xy))
    priors, weights, motion = priors_about(truth), random_weights(rng), weak_motion(1e-2)
    start = perturbed(truth, rng, 2.0)
    costs = [solve.cost(problem, start, priors, weights, motion)]
    for n in range(1, 16):
        found = solve.minimise(problem, start, priors, weights, motion, max_iterations=n, tolerance=0.0)
        assert found.iterations <= n
        assert found.cost == pytest.approx(solve.cost(problem, found.state, priors, weights, motion), rel=1e-12)
        costs.append(found.cost)
    assert (np.diff(costs) <= 0).all()
    assert costs[-1] < 0.7 * costs[0]


def test_the_gauge_stays_where_it_was(rng, state):
    problem = random_problem(rng, state, noise_px=2.0)
    start = perturbed(state, rng)
    found = solve.minimise(problem, start, priors_about(state), random_weights(rng), weak_motion(1e-2)).state
    np.testing.assert_array_equal(found.rotation[0], start.rotation[0])
    np.testing.assert_allclose(found.centre[0], start.centre[0], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found.clock[0, :2], start.clock[0, :2])
    assert spread(found) == pytest.approx(spread(start), rel=1e-12)
    assert not np.allclose(found.centre[1:], start.centre[1:], atol=1e-3)


def test_what_a_prior_holds_fixed_does_not_move(rng, state):
    problem = random_problem(rng, state, noise_px=2.0)
    priors = priors_about(state)
    deviation = np.array(priors.deviation)
    deviation[:, LENS] = 0
    deviation[2, ROTATION] = 0
    start = perturbed(state, rng)
    found = solve.minimise(
        problem, start, Priors(priors.mean, deviation), random_weights(rng), weak_motion(1e-2), max_iterations=5
    ).state
    np.testing.assert_array_equal(found.lens, start.lens)
    np.testing.assert_array_equal(found.rotation[2], start.rotation[2])
    assert (found.clock[1:, OFFSET - 6] != start.clock[1:, OFFSET - 6]).all()


def test_a_tight_prior_wins_over_the_data_and_a_wide_one_does_not(rng, state):
    problem = random_problem(rng, state, per_camera=120)
    off = np.zeros((3, N_PARAMETERS))
    off[:, 9] = 0.01  # a focal length one percent longer than the data say
    found = []
    for width in (1e-7, 10.0):
        priors = priors_about(state, off)
        deviation = np.array(priors.deviation)
        deviation[:, 9] = width
        weights = random_weights(rng)
        found.append(solve.minimise(problem, state, Priors(priors.mean, deviation), weights, weak_motion()).state.lens)
    np.testing.assert_allclose(found[0][:, 0] - state.lens[:, 0], 0.01, rtol=0, atol=1e-4)
    np.testing.assert_allclose(found[1][:, 0] - state.lens[:, 0], 0.0, rtol=0, atol=1e-4)


def test_convergence_is_told(rng, state):
    problem = random_problem(rng, state, noise_px=1.0)
    priors, weights, motion = priors_about(state), random_weights(rng), weak_motion(1e-2)
    start = perturbed(state, rng)
    hasty = solve.minimise(problem, start, priors, weights, motion, max_iterations=1)
    assert not hasty.converged
    patient = solve.minimise(problem, start, priors, weights, motion, max_iterations=100, tolerance=1e-6)
    assert patient.converged
    assert patient.iterations < 100
    again = solve.minimise(problem, patient.state, priors, weights, motion, max_iterations=100, tolerance=1e-6)
    assert again.cost == pytest.approx(patient.cost, rel=1e-5)


def test_running_out_of_iterations_is_no_convergence(rng, state, monkeypatch):
    problem = random_problem(rng, state, noise_px=1.0)
    start = perturbed(state, rng)

    def useless(equations, factor):
        return np.zeros(len(equations.camera)), np.zeros(len(equations.coupling))

    monkeypatch.setattr(solve, "step", useless)
    found = solve.minimise(problem, start, priors_about(state), random_weights(rng), weak_motion(), max_iterations=3)
    assert found.iterations == 3
    assert found.state is start
    assert found.ending == "iterations"
    assert not found.converged


def lost(equations, factor):
    return np.full(len(equations.camera), np.nan), np.zeros(len(equations.coupling))


def backwards(equations, factor):
    camera, spline = normal.step(equations, factor)
    return -camera, -spline


def wild(equations, factor):
    """Focal lengths beyond what floating point holds."""
    return np.full(len(equations.camera), 1e6), np.zeros(len(equations.coupling))


@pytest.mark.parametrize("wrong", [lost, wild])
def test_a_step_that_is_no_number_is_not_accepted(rng, state, monkeypatch, wrong):
    problem = random_problem(rng, state, noise_px=1.0)
    start = perturbed(state, rng)
    calls = []

    def sometimes(equations, factor):
        calls.append(len(calls) % 2)
        return (wrong if calls[-1] == 0 else normal.step)(equations, factor)

    monkeypatch.setattr(solve, "step", sometimes)
    arguments = problem, start, priors_about(state), random_weights(rng), weak_motion(1e-2)
    found = solve.minimise(*arguments, max_iterations=200, tolerance=1e-6)
    assert len(calls) > 3
    assert found.state.finite
    assert found.converged
    assert found.cost < 0.5 * solve.cost(*arguments)


def test_losing_a_hopeless_camera_is_not_an_improvement(rng, state, monkeypatch):
    """A pose of no numbers predicts nothing, which costs less than what the camera measured."""
    problem = random_problem(rng, state)
    hopeless = np.where((problem.observations.camera == 1)[:, None], 1e6, problem.observations.xy_px)
    problem = replace(problem, observations=replace(problem.observations, xy_px=hopeless))
    weights, motion = random_weights(rng), weak_motion(1e-12)
    priors = priors_about(state)
    nowhere = np.array(state.rotation)
    nowhere[1] = np.nan
    lower = solve.cost(problem, replace(state, rotation=nowhere), priors, weights, motion)
    assert lower < solve.cost(problem, state, priors, weights, motion)

    def turned_away(equations, factor):
        camera, spline = np.zeros(len(equations.camera)), np.zeros(len(equations.coupling))
        camera[equations.column[16:19]] = np.nan
        return camera, spline

    monkeypatch.setattr(solve, "step", turned_away)
    found = solve.minimise(problem, state, priors, weights, motion, max_iterations=5)
    assert found.state is state


def test_a_step_without_numbers_is_no_solution(equations):
    spoilt = replace(equations, camera_gradient=np.full_like(equations.camera_gradient, np.nan))
    with pytest.raises(np.linalg.LinAlgError):
        normal.step(spoilt, normal.eliminate(spoilt, 0.0))


def test_only_steps_that_raise_the_cost_are_divergence(rng, state, monkeypatch):
    problem = random_problem(rng, state, noise_px=1.0)
    start = perturbed(state, rng)
    monkeypatch.setattr(solve, "step", backwards)
    # Uphill steps promise nothing; what the linearisation promises is told by the true step.
    monkeypatch.setattr(solve, "_promised", lambda *a: 1.0)
    found = solve.minimise(
        problem, start, priors_about(state), random_weights(rng), weak_motion(1e-2), max_iterations=100
    )
    assert found.ending == "no acceptable step"
    assert not found.converged
    assert found.state is start
    assert found.iterations < 20


def test_a_start_without_a_cost_is_divergence(rng, state):
    problem = random_problem(rng, state, noise_px=1.0)
    for spoil in (np.nan, np.inf):
        lens = np.array(state.lens)
        lens[1, 0] = spoil
        start = replace(state, lens=lens)
        found = solve.minimise(problem, start, priors_about(state), random_weights(rng), weak_motion(1e-2))
        assert found.ending == "not finite"
        assert found.state is start
        assert not found.converged
    xy = np.array(problem.observations.xy_px)
    xy[7, 0] = np.nan
    spoilt = replace(problem, observations=replace(problem.observations, xy_px=xy))
    found = solve.minimise(spoilt, state, priors_about(state), random_weights(rng), weak_motion(1e-2))
    assert found.ending == "not finite"


def test_equations_without_a_solution_are_divergence(rng, state, monkeypatch):
    problem = random_problem(rng, state, noise_px=1.0)

    def never(equations, damping):
        raise np.linalg.LinAlgError("singular")

    monkeypatch.setattr(solve, "eliminate", never)
    found = solve.minimise(
        problem, state, priors_about(state), random_weights(rng), weak_motion(1e-2), max_iterations=100
    )
    assert found.ending == "singular"
    assert found.state is state


def test_a_cost_below_zero_settles_too(rng, state):
    """The motion prior's term for the size of the flight has any sign, as it depends on the unit of length."""
    problem = random_problem(rng, state, noise_px=0.1)
    motion = replace(weak_motion(1e-9), extent=np.ones(len(state.control)), determined=20.0)
    arguments = problem, perturbed(state, rng, 0.1), priors_about(state), random_weights(rng), motion
    found = solve.minimise(*arguments, max_iterations=100, tolerance=1e-6)
    assert found.cost < 0
    assert found.converged
    assert found.iterations < 10


def test_starting_at_the_minimum_is_convergence(rng, state):
    problem = random_problem(rng, state)
    found = solve.minimise(
        problem, state, priors_about(state), random_weights(rng), weak_motion(0.0), max_iterations=100
    )
    assert found.cost == 0
    assert found.converged


def test_every_ending_but_convergence_is_told_to_the_user():
    assert set(summary._ENDINGS) == set(get_args(solve.Ending)) - {"converged"}
    assert all("diverged" in words for ending, words in summary._ENDINGS.items() if ending != "iterations")
