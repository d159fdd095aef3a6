"""What residuals tell of the detections' errors, on problems whose errors are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_adjust_kernel import random_problem, random_state
from test_adjust_solve import priors_about

from skytrace.estimation.adjust import solve
from skytrace.estimation.adjust.driver import Adjusted
from skytrace.estimation.adjust.problem import Weights
from skytrace.estimation.error_model import error_model
from skytrace.estimation.influence import influence
from skytrace.estimation.noise import lagged_products
from skytrace.estimation.priors import motion_prior
from skytrace.estimation.scene import Scene
from skytrace.estimation.slow_errors import gradient_and_positions, slow_gradient
from skytrace.simulation.wander import wander

RUNS, SPACING_S = ((0, 480),), 0.25  # two minutes
RATE_HZ = 15.0


def flight(rng, slow_px, correlation_s=2.0, white_px=0.5, weights=(1.0, 1.0, 1.0, 1.0)):
    """Four cameras adjusted to detections that err like this."""
    n = len(weights)
    along = SPACING_S * np.arange(483)
    control = 9 * np.sin(2 * np.pi * (along[:, None] * rng.uniform(0.06, 0.12, 3) + rng.uniform(0, 1, 3)))
    truth = replace(random_state(rng, n, RUNS), control=control)
    per_camera = round(RATE_HZ * 120)
    problem = random_problem(rng, truth, per_camera, RUNS)
    o = problem.observations
    tau_s = np.tile(np.linspace(1.0, 118.0, per_camera), n)
    observations = replace(
        o, tau_s=tau_s, row=0.5 + 0.3 * np.sin(0.5 * tau_s), camera=np.repeat(np.arange(n), per_camera)
    )
    problem = replace(problem, observations=observations)
    memory = np.exp(-117.0 / (per_camera - 1) / correlation_s)
    drift = np.concatenate([np.stack([wander(per_camera, memory, rng) for _ in range(2)], axis=1) for _ in range(n)])
    xy_px = solve.predict(problem, truth)
    xy_px += white_px * rng.normal(size=xy_px.shape) + np.repeat(slow_px, per_camera)[:, None] * drift
    problem = replace(problem, observations=replace(observations, xy_px=xy_px))
    motion = motion_prior("jerk", SPACING_S, RUNS, 1e-6)
    weight = Weights(np.hypot(white_px, slow_px), np.array(weights))
    priors = priors_about(truth)
    found = solve.minimise(problem, truth, priors, weight, motion, max_iterations=30).state
    ids = tuple(f"cam{i}" for i in range(n))
    return Adjusted(
        Scene("cam0", {}), ids, problem, found, priors, weight, motion, np.tile(np.arange(per_camera), n),
        solve.predict(problem, found) - xy_px, 1.0, 0.0, 1, "converged",
    )  # fmt: skip


def test_white_errors_are_found_white(rng):
    errors = error_model(influence(flight(rng, np.zeros(4))))
    np.testing.assert_allclose(errors.white_px2, 0.25, rtol=0.15)
    assert errors.slow_px2.max() < 0.02


@pytest.mark.parametrize("correlation_s", [1.0, 4.0])
def test_slow_errors_are_found_behind_what_the_fit_follows(correlation_s):
    """Residuals hold about half of them: the rest went into the trajectory, poses and lenses."""
    found = []
    for seed in range(3):
        adjusted = flight(np.random.default_rng(seed), np.ones(4), correlation_s)
        found.append(error_model(influence(adjusted)))
    residual = 0.5 * (adjusted.residual_px**2).sum(axis=1).mean()
    assert residual - 0.25 < 0.7
    assert np.mean([e.slow_px2 for e in found]) == pytest.approx(1.0, rel=0.25)
    assert np.mean([e.correlation_s for e in found]) == pytest.approx(correlation_s, rel=0.35)
    assert np.mean([e.white_px2 for e in found]) == pytest.approx(0.25, rel=0.35)
    assert all(0.02 < e.hidden < 0.5 for e in found)


def test_a_camera_that_drifts_more_is_told_from_the_others():
    found = [error_model(influence(flight(np.random.default_rng(s), np.array([0.4, 0.4, 1.5, 0.4])))) for s in range(3)]
    mean = np.mean([e.slow_px2 for e in found], axis=0)
    assert mean[2] == pytest.approx(2.25, rel=0.4)
    assert mean[[0, 1, 3]].max() < 0.5


def test_a_camera_that_the_trajectory_follows_is_taken_to_be_like_the_others():
    """It counts a hundredfold, and its residuals show next to nothing."""
    adjusted = flight(np.random.default_rng(1), np.ones(4), weights=(100.0, 1.0, 1.0, 1.0))
    own = adjusted.problem.observations.camera == 0
    assert 0.5 * (adjusted.residual_px[own] ** 2).sum(axis=1).mean() < 0.5
    assert error_model(influence(adjusted)).slow_px2[0] == pytest.approx(1.0, abs=0.6)


def test_sums_over_pairs_of_blocks_equal_their_definition(rng):
    adjusted = flight(rng, np.ones(4))
    moves = influence(adjusted)
    slow_px2, correlation_s = np.array([0.5, 0.0, 1.0, 2.0]), 1.7
    at_s = np.array([-3.0, 10.0, 10.1, 60.0, 200.0])
    displacement = rng.normal(size=(4, 5, 3, 2))
    gradient, positions, both = gradient_and_positions(moves, slow_px2, correlation_s, at_s, list(displacement))
    expected_gradient, expected_both = np.zeros_like(gradient), np.zeros_like(both)
    for c, (b, score) in enumerate(zip(moves.blocks, moves.scores(), strict=True)):
        rho = np.exp(-np.abs(b.time_s[:, None] - b.time_s) / correlation_s)
        expected_gradient += slow_px2[c] * np.einsum("apx,ab,bqx->pq", score, rho, score, optimize=True)
        rho = np.exp(-np.abs(at_s[:, None] - b.time_s) / correlation_s)
        smoothed = np.einsum("kb,bpx->kpx", rho, score)
        expected_both += slow_px2[c] * np.einsum("kax,kpx->kap", displacement[c], smoothed)
    np.testing.assert_allclose(gradient, expected_gradient, atol=1e-9 * np.abs(gradient).max())
    np.testing.assert_allclose(both, expected_both, atol=1e-9 * np.abs(both).max())
    np.testing.assert_allclose(positions, np.einsum("c,ckax->ka", slow_px2, displacement**2), rtol=1e-12)
    np.testing.assert_allclose(slow_gradient(moves, slow_px2, correlation_s), gradient, rtol=1e-12)


def test_products_at_lags_count_every_pair(rng):
    position = np.sort(rng.integers(0, 50, 80))
    values = rng.normal(size=(80, 2))
    pairs, products = lagged_products(position, values, 6)
    for lag in range(1, 6):
        i, j = np.nonzero(position[None] - position[:, None] == lag)
        assert pairs[lag] == len(i)
        assert products[lag] == pytest.approx((values[i] * values[j]).sum(), abs=1e-9)
