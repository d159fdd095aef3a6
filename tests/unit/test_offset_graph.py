"""All pairs together: the consistent offsets, and one clock per camera."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from skytrace.estimation.offset_graph import Mode, PairClock, consistent_offsets, joint_clocks

TRUE_S = [0.0, 12.3, -40.7, 88.0, 5.5]


def modes_of(cameras, rng, n_false=4, score=50.0):
    """The true mode of every pair, best, among false ones."""
    modes = {}
    for i, j in combinations(cameras, 2):
        false = [Mode(float(rng.uniform(-200, 200)), float(rng.uniform(5, 0.5 * score))) for _ in range(n_false)]
        modes[i, j] = [Mode(TRUE_S[j] - TRUE_S[i] + float(rng.uniform(-0.1, 0.1)), score), *false]
    return modes


def assert_true(group, cameras, tolerance_s=0.3):
    assert set(group) == set(cameras)
    first = min(group)
    for c in cameras:
        assert group[c] - group[first] == pytest.approx(TRUE_S[c] - TRUE_S[first], abs=tolerance_s)


def test_true_modes_are_chosen(rng):
    (group,) = consistent_offsets(modes_of(range(5), rng), 5, 0.4)
    assert_true(group, range(5))


def test_a_pair_whose_best_mode_is_wrong_is_rescued(rng):
    modes = modes_of(range(4), rng)
    for pair in ((0, 1), (2, 3)):
        modes[pair] = [Mode(modes[pair][0].offset_s + 33.0, 90.0), *modes[pair]]
    (group,) = consistent_offsets(modes, 4, 0.4)
    assert_true(group, range(4))


def test_a_pair_without_a_true_mode_is_overruled(rng):
    modes = modes_of(range(4), rng)
    modes[1, 2] = [Mode(150.0, 80.0), Mode(-20.0, 60.0)]
    modes[0, 3] = []
    (group,) = consistent_offsets(modes, 4, 0.4)
    assert_true(group, range(4))


def test_evidence_counts_rather_than_the_number_of_modes(rng):
    modes = {
        (0, 1): [Mode(12.3, 60.0)],
        (0, 2): [Mode(0.0, 4.0), Mode(-40.7, 50.0)],
        (1, 2): [Mode(-12.3, 4.0), Mode(-53.0, 50.0)],
    }
    (group,) = consistent_offsets(modes, 3, 0.4)
    assert_true(group, range(3))


def test_modes_agree_only_within_the_tolerance():
    modes = {(0, 1): [Mode(10.0, 60.0)], (1, 2): [Mode(5.0, 50.0)], (0, 2): [Mode(15.5, 20.0), Mode(15.9, 40.0)]}
    (wide,) = consistent_offsets(modes, 3, 1.0)
    (narrow,) = consistent_offsets(modes, 3, 0.2)
    # A wide tolerance lets all three pairs agree; a narrow one has to do without one of them.
    assert wide[2] - wide[0] == pytest.approx(15.5, abs=0.51)
    assert narrow[2] - narrow[0] == pytest.approx(15.0)


def test_pairs_are_read_either_way_round():
    """Both links lead to the last camera, so that from there one camera follows against the order of its pair."""
    modes = {(0, 2): [Mode(-40.7, 20.0)], (1, 2): [Mode(-53.0, 30.0)]}
    (group,) = consistent_offsets(modes, 3, 0.4)
    assert_true(group, range(3))


def test_groups_that_nothing_connects(rng):
    modes = modes_of([0, 3, 4], rng) | {(1, 2): [Mode(TRUE_S[2] - TRUE_S[1], 30.0)]}
    for pair in combinations(range(5), 2):
        modes.setdefault(pair, [])
    groups = consistent_offsets(modes, 5, 0.4)
    assert [set(g) for g in groups] == [{0, 3, 4}, {1, 2}]
    assert_true(groups[0], [0, 3, 4])
    assert_true(groups[1], [1, 2])


def test_cameras_without_evidence_stand_alone():
    groups = consistent_offsets({(0, 2): [Mode(-40.7, 10.0)], (0, 1): []}, 4, 0.4)
    assert [set(g) for g in groups] == [{0, 2}, {1}, {3}]
    assert consistent_offsets({}, 2, 0.4) == [{0: 0.0}, {1: 0.0}]
    assert consistent_offsets({}, 0, 0.4) == []


CLOCKS = {0: (0.0, 1.0), 1: (12.3, 1 + 2e-4), 2: (-40.7, 1 - 3e-4), 3: (88.0, 1 + 1e-4)}
FREE = 1.0  # a prior on the rates that does not matter


def pair_clock(i, j, centre_world_s=100.0, error_s=0.0, rate_error=0.0, weight=60.0):
    """What a perfect pair would measure, off by error_s in the middle of the overlap."""
    (ai, ri), (aj, rj) = CLOCKS[i], CLOCKS[j]
    rate = ri / rj + rate_error
    centre = (centre_world_s - ai) / ri
    offset = (ai + ri * centre - aj) / rj + error_s - rate * centre
    return PairClock(i, j, offset, rate, centre, 30.0, weight)


def all_pairs(rng):
    return [pair_clock(i, j, rng.uniform(80, 120)) for i, j in combinations(CLOCKS, 2)]


def assert_clocks(clocks, atol_s, atol_rate):
    for c, (offset_s, rate) in CLOCKS.items():
        assert clocks[c][0] == pytest.approx(offset_s, abs=atol_s)
        assert clocks[c][1] == pytest.approx(rate, abs=atol_rate)


def test_exact_pairs_give_exact_clocks(rng):
    clocks, disagreement = joint_clocks(all_pairs(rng), list(CLOCKS), 0, FREE)
    assert_clocks(clocks, 1e-5, 1e-7)
    assert disagreement.shape == (6,)
    assert disagreement.max() < 1e-5


def test_a_chain_of_pairs_is_enough_and_their_direction_does_not_matter():
    clocks, _ = joint_clocks([pair_clock(2, 0), pair_clock(2, 3), pair_clock(1, 3)], list(CLOCKS), 0, FREE)
    assert_clocks(clocks, 1e-5, 1e-7)


def test_any_camera_may_be_the_reference(rng):
    clocks, _ = joint_clocks(all_pairs(rng), list(CLOCKS), 2, FREE)
    assert clocks[2] == (0.0, 1.0)
    offset2, rate2 = CLOCKS[2]
    for c, (offset, rate) in CLOCKS.items():
        assert clocks[c][1] == pytest.approx(rate / rate2, abs=1e-7)
        assert clocks[c][0] == pytest.approx((offset - offset2) / rate2, abs=1e-5)


@pytest.mark.parametrize("error_s", [0.3, -5.0, 400.0])
def test_one_wrong_pair_is_overruled_and_named(rng, error_s):
    pairs = all_pairs(rng)
    pairs[1] = pair_clock(0, 2, error_s=error_s, rate_error=3e-4)
    clocks, disagreement = joint_clocks(pairs, list(CLOCKS), 0, 1e-3)
    for c, (offset_s, rate) in CLOCKS.items():
        at_middle = (100.0 - offset_s) / rate  # the camera's time in the middle of the overlaps
        assert clocks[c][0] + clocks[c][1] * at_middle == pytest.approx(100.0, abs=2e-3)
        assert clocks[c][1] == pytest.approx(rate, abs=5e-5)
    assert np.argmax(disagreement) == 1
    assert disagreement[1] == pytest.approx(abs(error_s), rel=0.05)
    assert np.delete(disagreement, 1).max() < 0.01


def test_the_rate_prior_holds_rates_that_the_data_leave_open():
    short = PairClock(0, 1, 5.0, 1.01, 0.0, 0.5, 10.0)  # a second of overlap says nothing about a rate
    clocks, _ = joint_clocks([short], [0, 1], 0, 3e-4)
    assert abs(clocks[1][1] - 1) < 1e-4
    assert clocks[1][0] == pytest.approx(-5.0, abs=1e-3)
    free, _ = joint_clocks([short], [0, 1], 0, FREE)
    assert free[1][1] == pytest.approx(1 / 1.01, rel=1e-3)


def test_weighty_pairs_count_more():
    pairs = [pair_clock(0, 1, weight=100.0), pair_clock(0, 1, error_s=0.01, weight=1.0)]
    clocks, disagreement = joint_clocks(pairs, [0, 1], 0, FREE)
    assert disagreement[0] < 0.1 * disagreement[1]
    assert clocks[1][0] == pytest.approx(CLOCKS[1][0], abs=1e-3)
