"""The RANSAC loop on lines in the plane, where every answer can be checked by eye."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.solvers.ransac import ransac


class LineProblem:
    """Models (m, 2): slope and intercept."""

    sample_size = 2

    def __init__(self, x, y, refines=True):
        self.x, self.y, self.n_data, self.refines = x, y, len(x), refines
        self.generated = 0

    def generate(self, samples):
        assert samples.shape[1] == 2
        assert (samples[:, 0] != samples[:, 1]).all()
        self.generated += len(samples)
        x, y = self.x[samples], self.y[samples]
        sound = np.abs(x[:, 1] - x[:, 0]) > 1e-9
        slope = (y[sound, 1] - y[sound, 0]) / (x[sound, 1] - x[sound, 0])
        return np.column_stack([slope, y[sound, 0] - slope * x[sound, 0]])

    def residuals(self, models):
        return models[:, :1] * self.x + models[:, 1:] - self.y

    def refine(self, model, inlier):
        if not self.refines or inlier.sum() < 2:
            return None
        return np.polyfit(self.x[inlier], self.y[inlier], 1)


def line_data(rng, outliers=0.4, n=200, noise=0.02):
    x = rng.uniform(-5, 5, n)
    y = 2 * x - 1 + rng.normal(0, noise, n)
    wrong = rng.permutation(n)[: int(outliers * n)]
    y[wrong] += rng.choice([-1, 1], len(wrong)) * rng.uniform(1, 20, len(wrong))
    good = np.ones(n, bool)
    good[wrong] = False
    return LineProblem(x, y), good


def test_finds_the_line_among_forty_percent_outliers(rng):
    problem, good = line_data(rng)
    found = ransac(problem, 0.1, rng)
    assert found is not None
    np.testing.assert_allclose(found.model, [2, -1], rtol=0, atol=0.01)
    np.testing.assert_array_equal(found.inlier, good)
    expected = np.polyfit(problem.x[good], problem.y[good], 1)
    np.testing.assert_allclose(found.model, expected, rtol=0, atol=1e-9)  # the last refinement saw all inliers


def test_cost_is_the_mean_truncated_square(rng):
    problem, _ = line_data(rng)
    found = ransac(problem, 0.1, rng)
    residual = problem.residuals(found.model[None])[0]
    assert found.cost == pytest.approx(np.minimum((residual / 0.1) ** 2, 1).mean())
    np.testing.assert_array_equal(found.inlier, np.abs(residual) < 0.1)


def test_refinement_only_ever_lowers_the_cost(rng):
    problem, _ = line_data(rng, noise=0.05)
    raw = ransac(LineProblem(problem.x, problem.y, refines=False), 0.1, np.random.default_rng(3))
    refined = ransac(problem, 0.1, np.random.default_rng(3))
    assert refined.cost < raw.cost
    harmful = LineProblem(problem.x, problem.y)
    harmful.refine = lambda model, inlier: model + 0.5
    assert ransac(harmful, 0.1, np.random.default_rng(3)).cost == raw.cost


def test_stops_once_confident_and_keeps_on_where_not(rng):
    easy, _ = line_data(rng, outliers=0.0)
    assert ransac(easy, 0.1, rng, batch=10).n_samples <= 20
    hard, good = line_data(rng, outliers=0.9, n=400)
    found = ransac(hard, 0.1, rng, batch=50)
    # 0.1 squared: a sample of inliers only in every hundred, 687 for confidence 0.999.
    assert 500 <= found.n_samples <= 1100
    assert found.inlier[good].all()
    doubtful = ransac(hard, 0.1, np.random.default_rng(0), batch=50, confidence=0.5)
    assert doubtful.n_samples < found.n_samples


def test_never_draws_more_than_it_may(rng):
    noise = LineProblem(rng.uniform(-5, 5, 100), rng.uniform(-100, 100, 100))
    found = ransac(noise, 1e-6, rng, max_samples=300, batch=100)
    assert found.n_samples == noise.generated == 300


def test_one_seed_one_answer(rng):
    problem, _ = line_data(rng)
    a, b = (ransac(problem, 0.1, np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(a.model, b.model)
    assert a.n_samples == b.n_samples


def test_too_few_data_or_no_model_is_no_answer(rng):
    assert ransac(LineProblem(np.ones(1), np.ones(1)), 0.1, rng) is None
    assert ransac(LineProblem(np.zeros(0), np.zeros(0)), 0.1, rng) is None
    upright = LineProblem(np.ones(10), np.arange(10.0))
    assert ransac(upright, 0.1, rng, max_samples=200) is None
    assert upright.generated == 200
