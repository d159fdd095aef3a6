"""Motion priors: the integral they stand for, their gradient and band, and the weight that finds itself."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import cholesky_banded, solveh_banded

from skytrace.estimation.adjust.banded import inverse_band
from skytrace.estimation.adjust.problem import KnotGrid
from skytrace.estimation.priors import automatic_weight, balanced, energy_trace, given_weight, motion_prior

RUNS = ((-3, 4), (9, 11), (20, 21))
SPACING_S = 0.3
ORDER = {"kinetic": 1, "force": 2, "jerk": 3}
kinds = pytest.mark.parametrize("kind", ORDER)


def dense_energy(prior):
    """The energy's matrix of one coordinate, column by column from the gradient."""
    m = sum(prior.run_lengths) + 3 * len(prior.run_lengths)
    return np.column_stack([prior.gradient(unit[:, None])[:, 0] for unit in np.eye(m)])


@kinds
def test_energy_is_the_integral_of_the_squared_derivative(kind, rng):
    grid = KnotGrid(SPACING_S, RUNS)
    control = rng.normal(size=(grid.n_control, 3))
    integral = 0.0
    for a, b in RUNS:
        for k in range(a, b):  # each piece is a polynomial

            def squared(t):
                return float((grid.evaluate(control, np.array([t]), ORDER[kind]) ** 2).sum())

            integral += quad(squared, k * SPACING_S, (k + 1) * SPACING_S * (1 - 1e-15), epsrel=1e-11)[0]
    assert motion_prior(kind, SPACING_S, RUNS, 1.0).energy(control) == pytest.approx(integral, rel=1e-8)


@kinds
def test_gradient_is_half_the_slope_of_the_energy(kind, rng):
    prior = motion_prior(kind, SPACING_S, RUNS, 1.0)
    control = rng.normal(size=(19, 3))
    numeric = np.zeros_like(control)
    for index in np.ndindex(*control.shape):
        step = np.zeros_like(control)
        step[index] = 1e-4
        numeric[index] = (prior.energy(control + step) - prior.energy(control - step)) / 4e-4
    gradient = prior.gradient(control)
    np.testing.assert_allclose(gradient, numeric, rtol=0, atol=1e-8 * np.abs(gradient).max())


@kinds
def test_band_is_the_matrix_of_the_gradient(kind):
    prior = motion_prior(kind, SPACING_S, RUNS, 1.0)
    P, band = np.kron(dense_energy(prior), np.eye(3)), prior.band()
    np.testing.assert_allclose(P, P.T, rtol=0, atol=1e-12 * P.max())
    n = len(P)
    assert band.shape == (12, n)
    for d in range(12):
        np.testing.assert_allclose(band[d, : n - d], np.diag(P, -d), rtol=0, atol=1e-12 * P.max())
        assert not band[d, n - d :].any()
    for d in range(12, n):
        assert not np.diag(P, -d).any()


@kinds
def test_runs_do_not_pull_at_each_other_and_low_order_motion_is_free(kind):
    prior = motion_prior(kind, SPACING_S, RUNS, 1.0)
    P = dense_energy(prior)
    start = 0
    for n in (10, 5, 4):
        outside = np.delete(P[start : start + n], np.s_[start : start + n], axis=1)
        assert not outside.any()
        start += n
    free = np.arange(19.0)[:, None] ** np.arange(ORDER[kind])
    np.testing.assert_allclose(P @ free, 0, atol=1e-9 * P.max() * free.max())
    assert prior.rank == 3 * np.linalg.matrix_rank(P, tol=1e-9 * P.max())


def test_weights_are_kept_apart_from_the_energy():
    prior = motion_prior("jerk", SPACING_S, RUNS, 5.0)
    heavier = prior.weighted(7.0)
    assert (prior.weight, heavier.weight) == (5.0, 7.0)
    np.testing.assert_array_equal(heavier.band(), prior.band())


def test_no_prior_is_a_weak_fixed_regularisation():
    prior = motion_prior("none", SPACING_S, RUNS, 5.0)
    assert not prior.automatic
    assert 0 < prior.weight < 1e-6
    assert all(motion_prior(kind, SPACING_S, RUNS, 5.0).automatic for kind in ORDER)


def test_trace_equals_the_dense_trace(rng):
    prior = motion_prior("force", SPACING_S, RUNS, 1.0)
    band = 0.3 * prior.band()
    band[0] += rng.uniform(0.5, 1.0, band.shape[1])
    n = band.shape[1]
    H = sum(np.diag(band[d, : n - d], -d) + (np.diag(band[d, : n - d], d) if d else 0) for d in range(12))
    P = np.kron(dense_energy(prior), np.eye(3))
    expected = np.trace(P @ np.linalg.inv(H))
    assert energy_trace(prior, lower_inverse(band)) == pytest.approx(expected, rel=1e-9)


def lower_inverse(band):
    """The band of the inverse of a matrix, both in LAPACK's storage."""
    return inverse_band(np.ascontiguousarray(cholesky_banded(band, lower=True).T)).T


def fixed_point(weight, rng, noise=1.0, n=400, start=1.0):
    """The automatic weight for control points drawn from the prior of a true weight and seen through noise."""
    runs = ((0, n),)
    prior = motion_prior("force", SPACING_S, runs, start)
    m = n + 3
    P = prior.band()
    drawn = weight * P
    drawn[0] += 1e-3  # keeps the drift within bounds
    L = cholesky_banded(drawn, lower=True)
    dense = sum(np.diag(L[d, : 3 * m - d], -d) for d in range(12))
    truth = np.linalg.solve(dense.T, rng.normal(size=3 * m))
    seen = truth + noise * rng.normal(size=3 * m)
    for _ in range(60):
        band = prior.weight * P
        band[0] += noise**-2
        estimate = solveh_banded(band, seen / noise**2, lower=True).reshape(-1, 3)
        trace = energy_trace(prior, lower_inverse(band))
        prior = prior.weighted(automatic_weight(prior, estimate, trace))
    return prior.weight


@pytest.mark.parametrize("weight", [0.01, 1.0])
@pytest.mark.parametrize("start", [1e-3, 1e3])
def test_the_automatic_weight_finds_the_one_the_motion_was_drawn_with(weight, start, rng):
    assert fixed_point(weight, rng, start=start) == pytest.approx(weight, rel=0.35)


def test_the_automatic_weight_by_hand():
    prior = motion_prior("jerk", SPACING_S, RUNS, 2.0)
    assert prior.rank == 3 * (7 + 2 + 1)
    control = np.zeros((19, 3))
    control[0, 0] = 1.0
    energy = prior.energy(control)
    assert automatic_weight(prior, control, 6.0) == pytest.approx((30 - 12) / energy)
    # Data that determine nothing leave at least one degree of freedom.
    assert automatic_weight(prior, control, 15.0) == pytest.approx(1 / energy)
    assert np.isfinite(automatic_weight(prior, np.zeros((19, 3)), 6.0))


def sized(runs=RUNS):
    """A prior with a weight that knows which control points tell the flight's size."""
    prior = motion_prior("jerk", SPACING_S, runs, 3.0)
    extent = np.ones(sum(b - a + 3 for a, b in runs))
    extent[:2] = 0.0
    return dataclasses.replace(prior, extent=extent)


def test_the_cost_has_its_gradient(rng):
    prior = sized()
    control = rng.normal(size=(len(prior.extent), 3))
    prior = balanced(prior, control, 0.02)
    gradient, step = prior.cost_gradient(control), 1e-6
    for row, axis in [(0, 0), (3, 1), (7, 2)]:
        moved = control.copy()
        moved[row, axis] += step
        up = prior.cost(moved)
        moved[row, axis] -= 2 * step
        assert (up - prior.cost(moved)) / (2 * step) == pytest.approx(gradient[row, axis], rel=1e-5, abs=1e-6)


def test_a_balanced_prior_does_not_pull_on_the_flights_size(rng):
    """Scaling the path about its middle leaves the cost unchanged to first order; without the balance it does not."""
    prior = sized()
    control = rng.normal(size=(len(prior.extent), 3)) + [5.0, -3.0, 40.0]
    for known, relative in ((balanced(prior, control, 0.02), 0.0), (prior.weighted(0.02), 1.0)):
        middle = prior.extent @ control / prior.extent.sum()
        along = float((known.cost_gradient(control) * (control - middle)).sum())
        assert along / (0.02 * prior.energy(control)) == pytest.approx(relative, abs=1e-9)


@kinds
@pytest.mark.parametrize("extent", [0.0, 1.0])
def test_a_given_weight_does_not_depend_on_the_unit_of_length(kind, extent, rng):
    prior = motion_prior(kind, SPACING_S, RUNS, 1.0)
    control = rng.normal(size=(len(prior.extent), 3))
    prior = dataclasses.replace(prior, extent=np.full(len(control), extent))
    for unit in (1.0, 1e-3, 250.0):
        weighted = prior.weighted(given_weight(prior, unit * control, 7.0))
        assert weighted.relative_weight(unit * control) == pytest.approx(7.0, rel=1e-12)
        # The cost of the shape is that of the flight in units of its own size.
        size = np.sqrt(((control - control.mean(axis=0)) ** 2).sum(axis=1).mean())
        assert weighted.weight * weighted.energy(unit * control) == pytest.approx(
            7.0 * prior.energy(control / size), rel=1e-9
        )
