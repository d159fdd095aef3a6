"""The refined offset of a pair: several optima that fit alike widen its deviation and lower its confidence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skytrace.estimation.confidence import confidence
from skytrace.estimation.pair_refine import ambiguity
from skytrace.estimation.two_view import PairGeometry
from skytrace.geometry.rigid import Rigid

BEST = PairGeometry(Rigid(np.eye(3), np.array([1.0, 0, 0])), 5.0, 1.0, 30.0, 55.0, 60.0, 0.001, 1e-5, 0.3)


def shifted(frames):
    """Another optimum, later by some frames at 30 Hz."""
    return replace(BEST, offset_s=5.0 + frames / 30)


def test_a_single_optimum_is_sure():
    assert ambiguity(BEST, [BEST], [-3.0]) == (0.0, 1.0)


def test_an_equal_optimum_elsewhere_halves_the_confidence():
    spread_s, within = ambiguity(BEST, [BEST, shifted(3)], [-7.0, -7.0])
    assert spread_s == pytest.approx(0.1 / np.sqrt(2))
    assert within == pytest.approx(0.5)


def test_an_optimum_that_is_far_less_likely_counts_little():
    spread_s, within = ambiguity(BEST, [shifted(3), BEST], [-17.0, -7.0])
    assert spread_s < 0.001
    assert within > 0.9999


def test_an_optimum_within_a_frame_widens_the_deviation_only():
    spread_s, within = ambiguity(BEST, [BEST, shifted(0.6)], [0.0, 0.0])
    assert spread_s == pytest.approx(0.02 / np.sqrt(2))
    assert within == 1.0


def test_confidence_grows_with_evidence_and_support_and_falls_with_the_rival():
    sure = confidence(150.0, 20.0, 0.9, 60.0)
    assert sure > confidence(80.0, 20.0, 0.9, 60.0) > confidence(80.0, 70.0, 0.9, 60.0)
    assert sure > confidence(150.0, 20.0, 0.5, 60.0)
    assert confidence(150.0, 20.0, 0.9, 19.0) <= 0.85
    assert confidence(150.0, 150.0, 0.9, 60.0) <= 0.5
