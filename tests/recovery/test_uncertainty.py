"""Claimed deviations beside true errors on a few flights; `python -m benchmarks.uncertainty` measures many."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.uncertainty import LENS, normalised_errors, reconstructed

from skytrace.simulation import presets

FLIGHT = replace(presets["realistic"], duration_s=90.0, n_cameras=4)


@pytest.fixture(scope="module")
def errors():
    """Normalised errors of five flights with wrong lenses and drifting detections."""
    return [normalised_errors(*reconstructed(FLIGHT, (7, seed))) for seed in range(5)]


def root_mean_square(errors, *names: str) -> float:
    return float(np.sqrt(np.mean([np.mean(flight[name] ** 2) for flight in errors for name in names])))


def test_positions_and_cameras_are_as_sure_as_they_claim(errors):
    assert 0.75 < root_mean_square(errors, "trajectory") < 1.35
    assert 0.7 < root_mean_square(errors, "camera centres") < 1.4


def test_clocks_and_lenses_are_as_sure_as_they_claim(errors):
    assert 0.65 < root_mean_square(errors, "clock offset", "clock period", "readout") < 1.4
    assert 0.7 < root_mean_square(errors, *LENS) < 1.3


def test_no_flight_is_far_off(errors):
    """A claim that is right on average only would be of little use."""
    by_flight = [root_mean_square([flight], "trajectory") for flight in errors]
    assert min(by_flight) > 0.5
    assert max(by_flight) < 2.0
