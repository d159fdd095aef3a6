"""Noise: its size, robustly, and how much of it is independent."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from skytrace.estimation.noise import inflation, robust_sigma


def autoregressive(rng, n, rho):
    """Residuals (n, 2) of unit deviation with correlation rho from one frame to the next."""
    burn = 500
    return lfilter([np.sqrt(1 - rho**2)], [1, -rho], rng.normal(size=(n + burn, 2)), axis=0)[burn:]


def test_sigma_is_the_deviation_per_axis(rng):
    assert robust_sigma(2.5 * rng.normal(size=(20000, 2))) == pytest.approx(2.5, rel=0.03)


def test_sigma_survives_outliers_and_gaps(rng):
    residual = rng.normal(size=(20000, 2))
    residual[::10] = 1000.0
    residual[5::10] = np.nan
    assert robust_sigma(residual) == pytest.approx(1.0, abs=0.2)


def test_sigma_of_nothing_and_of_exact_data():
    assert robust_sigma(np.full((5, 2), np.nan)) == 1.0
    assert robust_sigma(np.zeros((0, 2))) == 1.0
    assert 0 < robust_sigma(np.zeros((5, 2))) < 1e-6


def test_white_noise_is_not_inflated(rng):
    for _ in range(3):
        assert inflation(rng.normal(size=(20000, 2)), np.arange(20000), 1.0, 30.0) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("rho", [0.3, 0.6, 0.8, 0.9, 0.95])
def test_autoregressive_noise_is_inflated_as_theory_says(rng, rho):
    found = inflation(autoregressive(rng, 60000, rho), np.arange(60000), 1.0, 30.0)
    assert found == pytest.approx((1 + rho) / (1 - rho), rel=0.15)


def test_missing_frames_and_lost_predictions_do_not_change_the_correlation(rng):
    residual = autoregressive(rng, 120000, 0.8)
    kept = np.flatnonzero(rng.uniform(size=120000) > 0.5)
    thinned = residual[kept]
    thinned[::7] = np.nan
    assert inflation(thinned, kept + 10**6, 1.0, 30.0) == pytest.approx(9.0, rel=0.15)


def test_it_does_not_depend_on_the_unit(rng):
    residual = autoregressive(rng, 5000, 0.7)
    one = inflation(residual, np.arange(5000), 1.0, 30.0)
    assert inflation(20 * residual, np.arange(5000), 20.0, 30.0) == pytest.approx(one, rel=1e-9)


def test_outliers_do_not_hide_the_correlation(rng):
    residual = autoregressive(rng, 60000, 0.8)
    residual[rng.permutation(60000)[:600]] = 500.0
    assert inflation(residual, np.arange(60000), 1.0, 30.0) > 6.5


def test_correlations_count_up_to_a_time_not_a_number_of_frames(rng):
    """A drift of minutes: the sum stops after `longest_s`, at any frame rate."""
    drift = autoregressive(rng, 60000, 0.9999)
    drift /= drift.std()
    for rate_hz, longest_s in ((30.0, 3.0), (30.0, 1.0), (10.0, 3.0)):
        found = inflation(drift, np.arange(60000), 1.0, rate_hz, longest_s)
        assert found == pytest.approx(2 * rate_hz * longest_s, rel=0.1)


def test_alternating_noise_is_not_deflated_below_one(rng):
    flips = rng.normal(size=(2000, 2)) * 0.1 + (-1.0) ** np.arange(2000)[:, None]
    assert inflation(flips, np.arange(2000), 1.0, 30.0) == 1.0


@pytest.mark.parametrize("n", [0, 1, 9])
def test_too_few_residuals_are_taken_as_independent(rng, n):
    assert inflation(np.ones((n, 2)), np.arange(n), 1.0, 30.0) == 1.0
    assert inflation(np.zeros((50, 2)), np.arange(50), 1.0, 30.0) == 1.0
    assert inflation(np.full((50, 2), np.nan), np.arange(50), 1.0, 30.0) == 1.0


def test_detections_in_every_other_frame_only_are_correlated_all_the_same(rng):
    residual = autoregressive(rng, 60000, 0.9)
    for step in (2, 3, 4, 6, 7):
        found = inflation(residual[::step], np.arange(60000)[::step], 1.0, 30.0)
        assert found == pytest.approx(19.0, rel=0.25)  # counted in frames, whatever their number
