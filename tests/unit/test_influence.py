"""How the linearised estimate answers to errors: against moving detections and against dense algebra."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_adjust_kernel import RUNS, random_problem, random_state, random_weights
from test_adjust_solve import coupling_of, dense_of
from test_posterior import adjusted_at

from skytrace.estimation.adjust import solve
from skytrace.estimation.influence import influence

N_INTERVALS = sum(b - a for a, b in RUNS)


@pytest.fixture
def adjusted(rng):
    """One detection in every knot interval, without noise and without a robust loss: blocks are exact."""
    state = random_state(rng)
    problem = random_problem(rng, state, per_camera=N_INTERVALS)
    return adjusted_at(problem, state, replace(random_weights(rng), loss="none"), motion_weight=1e-3)


def shifted(adjusted, chosen, shift_px):
    """The normal equations after some detections (n,) have moved by shift_px (2,)."""
    xy_px = adjusted.problem.observations.xy_px + np.where(chosen[:, None], shift_px, 0.0)
    problem = replace(adjusted.problem, observations=replace(adjusted.problem.observations, xy_px=xy_px))
    return solve.assemble(problem, adjusted.state, adjusted.priors, adjusted.weights, adjusted.motion)


def test_scores_are_what_a_moved_detection_does_to_the_eliminated_gradient(adjusted):
    moves = influence(adjusted)
    before = shifted(adjusted, np.zeros(len(adjusted.problem.observations), bool), np.zeros(2))
    spline = dense_of(before)[0][moves.n_unknowns :, moves.n_unknowns :]
    follows = np.linalg.solve(spline, coupling_of(before))
    scores = list(moves.scores())
    o = adjusted.problem.observations
    for c in range(3):
        order = np.flatnonzero(o.camera == c)
        order = order[np.argsort(o.tau_s[order])]
        for i in (0, 7, N_INTERVALS - 1):
            chosen = np.arange(len(o)) == order[i]
            for axis in range(2):
                after = shifted(adjusted, chosen, np.eye(2)[axis])
                change = after.camera_gradient - before.camera_gradient
                change = change - follows.T @ (after.spline_gradient - before.spline_gradient)
                size = np.abs(scores[c]).max()
                np.testing.assert_allclose(-change, scores[c][i, :, axis], atol=1e-7 * size)


def test_a_lasting_bias_moves_the_spline_as_least_squares_does(adjusted):
    moves = influence(adjusted)
    camera = adjusted.problem.observations.camera
    before = shifted(adjusted, camera < 0, np.zeros(2))
    spline = dense_of(before)[0][moves.n_unknowns :, moves.n_unknowns :]
    for c in range(3):
        for axis in range(2):
            after = shifted(adjusted, camera == c, np.eye(2)[axis])
            step = -np.linalg.solve(spline, after.spline_gradient - before.spline_gradient)
            found = moves.bias_response[c, :, :, axis].ravel()
            np.testing.assert_allclose(found, step, atol=1e-6 * np.abs(step).max())


def test_what_the_spline_follows_is_missing_from_the_residuals(adjusted):
    """Move the spline by its answer to a bias and look at the residuals."""
    moves = influence(adjusted)
    left, small = moves.left_in_residuals(), 1e-4
    o = adjusted.problem.observations
    weight = (adjusted.weights.information / adjusted.weights.sigma_px**2)[o.camera]
    for j in range(3):
        squares = np.zeros(3)
        for axis in range(2):
            control = adjusted.state.control + small * moves.bias_response[j, :, :, axis]
            predicted = solve.predict(adjusted.problem, replace(adjusted.state, control=control))
            residual = (predicted - o.xy_px) / small - np.where(o.camera[:, None] == j, np.eye(2)[axis], 0.0)
            for i in range(3):
                own = o.camera == i
                squares[i] += 0.5 * weight[own] @ (residual[own] ** 2).sum(axis=1) / weight[own].sum()
        np.testing.assert_allclose(left[:, j], squares, rtol=1e-3, atol=1e-6)
    # The more a camera counts the more it is followed, the less of its errors is left to see.
    heavy = influence(replace(adjusted, weights=replace(adjusted.weights, information=np.array([1e4, 1.0, 1.0]))))
    assert heavy.left_in_residuals()[0, 0] < 0.05 < left[0, 0]


def test_white_errors_lose_the_degrees_of_freedom_that_the_fit_spends(adjusted):
    alike = replace(adjusted.weights, sigma_px=np.ones(3), information=np.ones(3))
    moves = influence(replace(adjusted, weights=alike))
    H = dense_of(moves.equations)[0]
    p = moves.n_unknowns
    motion = replace(moves.equations, band=adjusted.motion.weight * adjusted.motion.band().T)
    data = H - dense_of(motion)[0]
    spent = np.trace(np.linalg.solve(H[p:, p:], data[p:, p:])) + np.trace(moves.response @ moves.data)
    assert (moves.detections * (1 - moves.white_left())).sum() == pytest.approx(spent, rel=1e-3)


def test_robust_weights_count_as_least_squares_with_the_loss_s_curvature(rng):
    """Under the Cauchy loss the mean pull grows by mean w^2 with the error, w the weight."""
    state = random_state(rng)
    problem = random_problem(rng, state, per_camera=3000, noise_px=1.0)
    weights = replace(random_weights(rng), sigma_px=np.ones(3), information=np.ones(3))
    moves = influence(adjusted_at(problem, state, weights))
    # Means over a Gaussian residual of two axes: of the weight 0.7227, of its square 0.5545.
    np.testing.assert_allclose(moves.weights.information, 0.5545 / 0.7227, rtol=0.02)
    np.testing.assert_allclose(moves.curvature, 0.5545 / 0.7227, rtol=0.02)
    # The Cauchy loss of this scale is 91 % efficient.
    np.testing.assert_allclose(0.5 * (moves.effective_px**2).sum(axis=1).mean(), 1 / 0.915, rtol=0.03)


def test_detections_that_are_not_predicted_do_not_count(rng, adjusted):
    lost = adjusted.residual_px.copy()
    lost[::5] = np.nan
    moves = influence(replace(adjusted, residual_px=lost))
    assert sum(len(b.time_s) for b in moves.blocks) == len(lost) - len(lost[::5])
    assert np.isnan(moves.effective_px[::5]).all()
