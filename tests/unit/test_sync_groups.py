"""Pairs into groups of cameras: what ties, what does not, and how sure the outcome is."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.estimation.confidence import confidence
from skytrace.estimation.pair_modes import PairMode
from skytrace.estimation.pair_refine import RefinedPair
from skytrace.estimation.sync_groups import Measured, camera_confidence, tie_groups
from skytrace.estimation.sync_settings import SyncSettings
from skytrace.estimation.two_view import PairGeometry
from skytrace.geometry.rigid import Rigid

TRUE_S = [0.0, 12.5, -40.0, 7.0]


def measured(i, j, sure, sigma_s=1e-3, error_s=0.0, support=0.9):
    offset_s = TRUE_S[j] - TRUE_S[i] + error_s
    pose = Rigid(np.eye(3), np.array([1.0, 0.0, 0.0]))
    geometry = PairGeometry(pose, offset_s, 1.0, 50.0, 60.0 * support, 60.0, sigma_s, 1e-5, 0.5)
    return Measured(i, j, PairMode(geometry, 100.0), RefinedPair(geometry, 100.0, 3.0, sure), True)


def test_one_confident_pair_ties_and_an_unsure_one_does_not():
    (group,) = tie_groups([measured(0, 1, 0.99), measured(0, 2, 0.6)], 3, SyncSettings())
    assert set(group.clocks) == {0, 1}
    # world time is that of camera 0, so camera 1's own time is ahead by its offset
    assert group.clocks[1][0] == pytest.approx(-TRUE_S[1], abs=1e-6)


def test_unsure_pairs_that_agree_tie_together():
    pairs = [measured(0, 1, 0.999), measured(0, 2, 0.85), measured(1, 2, 0.85)]
    (group,) = tie_groups(pairs, 3, SyncSettings())
    assert set(group.clocks) == {0, 1, 2}
    assert group.confidence[2] == pytest.approx(1 - 0.15 * (1 - 0.999 * 0.85))


def test_cameras_that_never_see_the_target_together_are_two_groups():
    first, second = tie_groups([measured(0, 2, 0.99), measured(1, 3, 0.99), measured(0, 1, 0.2)], 4, SyncSettings())
    assert (set(first.clocks), set(second.clocks)) == ({0, 2}, {1, 3})
    assert second.clocks[3][0] == pytest.approx(TRUE_S[1] - TRUE_S[3], abs=1e-6)


def test_a_pair_that_mostly_contradicts_its_geometry_ties_nothing():
    assert tie_groups([measured(0, 1, 0.99, support=0.4)], 2, SyncSettings()) == []


def test_deviations_follow_from_the_pairs():
    (group,) = tie_groups([measured(0, 1, 0.99, sigma_s=3e-4)], 2, SyncSettings())
    assert group.deviations[0] == (0.0, 0.0)
    assert group.deviations[1][0] == pytest.approx(3e-4, rel=0.05)
    assert group.deviations[1][1] == pytest.approx(1e-5, rel=0.3)


def test_confidence_along_a_chain_is_that_of_all_its_links():
    chain = [measured(0, 1, 0.9), measured(1, 2, 0.8)]
    found = camera_confidence([0, 1, 2], chain, 0)
    assert found == pytest.approx({0: 0.9, 1: 0.9, 2: 0.72})


def test_confidence_grows_with_evidence_contrast_and_support():
    base = confidence(100.0, 50.0, 0.8, 60.0)
    assert 0 < base < 1
    assert confidence(200.0, 50.0, 0.8, 60.0) > base
    assert confidence(100.0, 20.0, 0.8, 60.0) > base
    assert confidence(100.0, 50.0, 0.95, 60.0) > base
    assert confidence(-5.0, 0.0, 0.3, 60.0) < 1e-3


def test_short_overlaps_never_count_as_sure():
    assert confidence(1000.0, 0.0, 1.0, 15.0) < SyncSettings().min_confidence
    assert confidence(1000.0, 0.0, 1.0, 60.0) > 0.999
