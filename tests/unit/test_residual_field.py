"""Residuals that depend on the place in the image are told from those that drift in time."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from skytrace.estimation.residual_field import residual_pattern

SIZE_PX = (1920, 1080)
RATE_HZ = 10.0


def flight(seed: int, duration_s: float = 400.0, drift_px: float = 1.0, drift_s: float = 3.0):
    """Times, places of a target that comes back to them in another order, and residuals that drift."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0, duration_s, 1 / RATE_HZ)
    turns = 2 * np.pi * time_s[:, None] / rng.uniform(23, 71, 4)
    wander = np.sin(turns + rng.uniform(0, 6, 4)) @ rng.normal(size=(4, 2))
    place = np.array(SIZE_PX) * (0.5 + 0.4 * wander / np.abs(wander).max(axis=0))
    kept = np.exp(-1 / (RATE_HZ * drift_s))
    drift = np.sqrt(1 - kept**2) * lfilter([1], [1, -kept], rng.normal(size=(len(time_s), 2)), axis=0)
    return time_s, place, drift_px * drift + rng.normal(0, 0.3, drift.shape)


def bent(place, amplitude_px):
    """The displacement by a lens of another shape."""
    x, y = 2 * np.pi * place.T / SIZE_PX[0]
    return amplitude_px * np.sqrt(2) * np.column_stack([np.sin(3 * x) * np.cos(2 * y), np.cos(2 * x) * np.sin(3 * y)])


@pytest.mark.parametrize("seed", range(5))
def test_a_bent_lens_is_found_and_measured(seed: int) -> None:
    time_s, place, error = flight(seed, drift_px=0.6)
    pattern = residual_pattern(time_s, place, error + bent(place, 1.0), SIZE_PX)
    assert pattern is not None
    assert pattern.deviations > 4
    assert pattern.chance == 1 / (pattern.shifts + 1)
    assert 0.4 < pattern.rms_px < 0.9


def test_drift_alone_is_hardly_ever_taken_for_a_lens() -> None:
    found = [residual_pattern(*flight(seed), SIZE_PX) for seed in range(24)]
    deviations = np.array([pattern.deviations for pattern in found if pattern is not None])
    assert len(deviations) == 24
    assert (deviations > 4).sum() == 0
    assert 0.5 < deviations.std() < 2.0
    assert np.mean([pattern.chance <= 0.05 for pattern in found if pattern is not None]) <= 0.15


def test_a_constant_error_is_no_pattern() -> None:
    time_s, place, error = flight(3)
    plain, shifted = (residual_pattern(time_s, place, e, SIZE_PX) for e in (error, error + [5.0, -3.0]))
    assert plain is not None
    assert shifted is not None
    assert shifted.deviations == pytest.approx(plain.deviations, abs=0.05)


def test_the_unit_of_the_residuals_cancels() -> None:
    time_s, place, error = flight(4)
    one, ten = (residual_pattern(time_s, place, k * (error + bent(place, 0.5)), SIZE_PX) for k in (1.0, 10.0))
    assert one is not None
    assert ten is not None
    assert ten.deviations == pytest.approx(one.deviations)
    assert ten.rms_px == pytest.approx(10 * one.rms_px)


@pytest.mark.parametrize("n", [0, 1, 2, 300])
def test_short_flights_tell_nothing(n: int) -> None:
    time_s, place, error = flight(5)
    assert residual_pattern(time_s[:n], place[:n], error[:n], SIZE_PX) is None


def test_a_target_that_never_comes_back_tells_nothing() -> None:
    time_s, _, error = flight(6, duration_s=120.0)
    place = np.column_stack([1900 * time_s / 120, np.full(len(time_s), 500.0)])
    assert residual_pattern(time_s, place, error, SIZE_PX) is None
