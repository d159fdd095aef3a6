"""The plain numpy reference: its derivatives against differences, and the compiled solver against it."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from test_adjust_kernel import RUNS, SPACING_S, moved, random_problem, random_state, random_weights, taken
from test_adjust_solve import DEVIATION, dense_of, perturbed, priors_about

from skytrace.estimation.adjust import normal, reference, solve
from skytrace.estimation.adjust.camera_priors import GaussianTerm
from skytrace.estimation.adjust.losses import LossKind
from skytrace.estimation.adjust.problem import CENTRE, FOCAL, N_PARAMETERS, OFFSET, READOUT
from skytrace.estimation.priors import balanced, motion_prior

# Sizes of a difference step for each camera parameter.
_STEPS = np.array([1e-6] * 3 + [1e-5] * 3 + [1e-6] * 3 + [1e-6] * 4 + [1e-5] * 3)


def differences(problem, state, steps):
    """Central differences (n, 2) of the projections along moves of the state."""
    sides = [reference.linearise(problem, moved(state, *(sign * s for s in steps))).xy_px for sign in (1, -1)]
    return (sides[0] - sides[1]) / 2


@pytest.mark.parametrize("seed", range(3))
def test_derivatives_by_a_camera_equal_differences(seed):
    rng = np.random.default_rng(seed)
    state = random_state(rng)
    problem = random_problem(rng, state)
    at = reference.linearise(problem, state)
    for k in range(N_PARAMETERS):
        step = _STEPS[k] * np.tile(np.eye(N_PARAMETERS)[k], (3, 1))
        numeric = differences(problem, state, (step, np.zeros_like(state.control))) / _STEPS[k]
        largest = np.abs(numeric).max()
        assert largest > 1
        np.testing.assert_allclose(
            at.by_camera[:, :, k], numeric, rtol=1e-5, atol=1e-7 * largest, err_msg=f"parameter {k}"
        )
    np.testing.assert_array_equal(reference.image_velocity(problem, state), at.by_camera[:, :, OFFSET])


def test_the_point_moves_the_projection_through_its_control_points(rng):
    state = random_state(rng)
    problem = random_problem(rng, state)
    at = reference.linearise(problem, state)
    for index in (0, 5, 14, 17, 23):
        step = np.zeros_like(state.control)
        step[index] = 1e-5 * rng.normal(size=3)
        weight = (at.basis * (at.first[:, None] + np.arange(4) == index)).sum(axis=1)
        numeric = differences(problem, state, (np.zeros((3, N_PARAMETERS)), step))
        np.testing.assert_allclose(numeric, weight[:, None] * (at.by_point @ step[index]), rtol=0, atol=1e-9)
        assert (weight > 0).any()


def assert_relative(actual, expected, tolerance=1e-10):
    np.testing.assert_allclose(actual, expected, rtol=0, atol=tolerance * np.abs(expected).max())


def joint_term(rng, truth):
    """A joint prior on coordinates of two cameras, off the state, one of them held fixed."""
    index = N_PARAMETERS * np.array([0, 1, 1, 2, 2]) + np.array([CENTRE.start, CENTRE.start, FOCAL, FOCAL, READOUT])
    A = rng.normal(size=(5, 5))
    values = truth.parameters().ravel()[index]
    return GaussianTerm(index, values + 0.01 * rng.normal(size=5), 50 * A @ A.T)


def hard_case(seed, loss="cauchy", motion_kind="jerk"):
    """A random problem away from its minimum, with outliers, priors off their means and detections nobody predicts."""
    rng = np.random.default_rng(seed)
    truth = random_state(rng)
    problem = random_problem(rng, truth, per_camera=80, noise_px=1.0)
    xy = np.array(problem.observations.xy_px)
    xy[rng.permutation(len(xy))[:40]] += rng.normal(0, 80, (40, 2))
    tau = np.array(problem.observations.tau_s)
    tau[rng.permutation(len(tau))[:10]] += 100.0
    problem = replace(problem, observations=replace(problem.observations, xy_px=xy, tau_s=tau))
    state = perturbed(truth, rng, 0.3)
    off = 0.5 * np.where(np.isfinite(DEVIATION), DEVIATION, 0.0) * rng.normal(size=(3, N_PARAMETERS))
    motion = motion_prior(motion_kind, SPACING_S, RUNS, 1.0)
    motion = balanced(replace(motion, extent=rng.uniform(size=len(state.control)).round()), state.control, 1e-3)
    priors = replace(priors_about(truth, off), terms=(joint_term(rng, truth),))
    return problem, state, priors, replace(random_weights(rng), loss=loss), motion


@pytest.mark.parametrize("loss", get_args(LossKind))
@pytest.mark.parametrize("seed", range(3))
def test_cost_and_projections_agree(seed, loss):
    problem, state, priors, weights, motion = hard_case(seed, loss)
    at = reference.linearise(problem, state)
    found = solve.predict(problem, state)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(at.xy_px))
    assert 10 <= np.isnan(found[:, 0]).sum() < 60
    np.testing.assert_allclose(found, at.xy_px, rtol=1e-12)
    expected = reference.cost(problem, state, priors, weights, motion)
    assert solve.cost(problem, state, priors, weights, motion) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("loss", get_args(LossKind))
@pytest.mark.parametrize("motion", ["kinetic", "force", "jerk"])
@pytest.mark.parametrize("seed", range(3))
def test_normal_equations_agree(seed, motion, loss):
    problem, state, priors, weights, motion = hard_case(seed, loss, motion)
    equations = solve.assemble(problem, state, priors, weights, motion)
    H, g, _ = dense_of(equations)
    expected, gradient = reference.normal_equations(problem, state, priors, weights, motion)
    moving = np.r_[priors.free.ravel(), np.ones(3 * len(state.control), bool)]
    expected, gradient = expected.toarray()[np.ix_(moving, moving)], gradient[moving]
    p = len(equations.camera)
    # Entries are of very different sizes; each is compared with the diagonal of its row and column.
    scale = np.sqrt(np.diag(expected))
    assert_relative(H / np.outer(scale, scale), expected / np.outer(scale, scale))
    for part in (slice(0, p), slice(p, None)):
        assert_relative(g[part], gradient[part])


@pytest.mark.parametrize("unit_held", [True, False])
@pytest.mark.parametrize("damping", [1e-4, 1.0])
@pytest.mark.parametrize("seed", range(5))
def test_steps_agree(seed, damping, unit_held):
    problem, state, priors, weights, motion = hard_case(seed)
    problem = replace(problem, unit_held=unit_held)
    equations = solve.assemble(problem, state, priors, weights, motion)
    camera, spline = normal.step(equations, normal.eliminate(equations, damping))
    expected = reference.damped_step(problem, state, priors, weights, motion, damping)
    size = N_PARAMETERS * problem.n_cameras
    by_parameter = np.zeros(size)
    by_parameter[priors.free.ravel()] = camera
    for k in range(N_PARAMETERS):  # each kind of parameter in its own unit
        np.testing.assert_allclose(
            by_parameter[k::N_PARAMETERS],
            expected[k:size:N_PARAMETERS],
            rtol=0,
            atol=1e-10 * max(np.abs(expected[k:size:N_PARAMETERS]).max(), 1e-300),
        )
    assert_relative(spline, expected[size:])
    assert np.abs(camera).max() > 0


def test_agreement_does_not_hang_on_the_order_of_the_detections(rng):
    problem, state, priors, weights, motion = hard_case(9)
    shuffled = replace(problem, observations=taken(problem.observations, rng.permutation(len(problem.observations))))
    _, g, _ = dense_of(solve.assemble(shuffled, state, priors, weights, motion))
    gradient = reference.normal_equations(problem, state, priors, weights, motion)[1]
    assert_relative(g, gradient[np.r_[priors.free.ravel(), np.ones(3 * len(state.control), bool)]])
