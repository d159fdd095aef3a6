"""Where the trajectory may be claimed, on hand-made supports."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.estimation.adjust.problem import KnotGrid
from skytrace.estimation.coverage import CoverageSettings, covered_trajectory, inliers, support

GRID = KnotGrid(0.2, ((5, 65), (100, 130)))  # 1.0 to 13.0 s and 20.0 to 26.0 s


def dense(begin_s, end_s):
    return np.arange(begin_s, end_s, 0.04)


def cover(times, sigma=None, grid=GRID, **changes):
    control = np.random.default_rng(1).normal(size=(grid.n_control, 3))
    if sigma is None:
        sigma = np.full(len(grid.knots_s()), 0.1)
    return covered_trajectory(grid, control, sigma, times, CoverageSettings(**changes))[0], control


def cuts(times, seen=None, sigma=None, **changes):
    control = np.random.default_rng(1).normal(size=(GRID.n_control, 3))
    if sigma is None:
        sigma = np.full(len(GRID.knots_s()), 0.1)
    settings = CoverageSettings(**changes)
    trajectory, found = covered_trajectory(GRID, control, sigma, times, settings, seen_s=seen)
    return trajectory.covered_s, found


def spans(trajectory):
    return [(round(s.begin_s, 6), round(s.end_s, 6)) for s in trajectory.segments]


def test_inliers_lie_within_so_many_deviations():
    residual = np.array([[0.0, 0.0], [3.0, 4.0], [6.0, 8.1], [np.nan, np.nan], [-10.0, 0.0]])
    np.testing.assert_array_equal(inliers(residual, 2.0, 5.0), [True, True, False, False, True])


def test_support_counts_cameras_not_detections():
    t = np.array([0.0, 1.0, 2.0, 3.0])
    cameras = [np.array([0.9, 0.95, 1.1]), np.array([1.25, 2.75]), np.zeros(0)]
    np.testing.assert_array_equal(support(t, cameras, 0.25), [0, 2, 0, 1])


def test_two_cameras_cover_what_one_does_not():
    trajectory, control = cover([dense(2, 10), dense(4, 12), dense(21, 23)])
    (segment,) = trajectory.segments
    # Support reaches a window of 0.25 s beyond the detections.
    assert spans(trajectory) == [(3.75, 10.2)]
    t = np.linspace(3.75, 10.2, 200)
    np.testing.assert_allclose(segment.evaluate(t), GRID.evaluate(control, t), rtol=0, atol=1e-9)
    np.testing.assert_allclose(segment.evaluate(t, 1), GRID.evaluate(control, t, 1), rtol=0, atol=1e-8)


def test_three_cameras_may_be_demanded():
    times = [dense(2, 10), dense(4, 12), dense(5, 9)]
    assert spans(cover(times, min_cameras=3)[0]) == [(4.75, 9.2)]


def test_short_silences_are_bridged_and_long_ones_are_not():
    both = np.r_[dense(2, 6), dense(6.4, 9), dense(10, 12)]
    trajectory, _ = cover([both, both])
    (a, b), (c, d) = spans(trajectory)
    assert (a, d) == (1.75, 12.2)
    assert b == pytest.approx(9.2, abs=0.051)
    assert c == pytest.approx(9.75, abs=0.051)


def test_segments_of_less_than_a_second_are_dropped():
    times = [np.r_[dense(2, 2.3), dense(5, 6)], np.r_[dense(2, 2.3), dense(5, 6)]]
    assert spans(cover(times)[0]) == [(4.75, 6.2)]
    assert len(spans(cover(times, min_segment_s=0.3)[0])) == 2


def test_segments_never_reach_across_or_beyond_runs():
    everywhere = [dense(0, 30), dense(0, 30)]
    trajectory, control = cover(everywhere)
    assert spans(trajectory) == [(1.0, 12.95), (20.0, 25.95)]
    for segment in trajectory.segments:
        t = np.linspace(segment.begin_s, segment.end_s, 100)
        np.testing.assert_allclose(segment.evaluate(t), GRID.evaluate(control, t), rtol=0, atol=1e-9)


def test_stretches_much_less_certain_than_usual_are_not_claimed():
    sigma = np.full(len(GRID.knots_s()), 0.1)
    knots = GRID.knots_s()
    sigma[(knots > 7.9) & (knots < 9.1)] = 10.0
    trajectory, _ = cover([dense(2, 12), dense(2, 12)], sigma)
    (_, b), (c, _) = spans(trajectory)
    # Deviations are interpolated between knots: the limit of five medians is crossed just beside the last good knot.
    assert b == pytest.approx(7.8, abs=0.051)
    assert c == pytest.approx(9.2, abs=0.051)
    assert len(spans(cover([dense(2, 12), dense(2, 12)], sigma, max_sigma_ratio=200)[0])) == 1


def test_the_usual_deviation_is_that_of_supported_knots():
    """Most of the spline is wild because nobody saw it; that must not raise the limit."""
    knots = GRID.knots_s()
    sigma = np.full(len(knots), 100.0)
    sigma[(knots > 2.5) & (knots < 6.1)] = 0.1
    sigma[(knots > 6.1) & (knots < 7.5)] = 2.0
    trajectory, _ = cover([dense(3, 7), dense(3, 7)], sigma)
    ((_, end_s),) = spans(trajectory)
    assert end_s == pytest.approx(6.0, abs=0.051)


def test_deviations_go_with_their_knots():
    sigma = np.linspace(0.1, 0.2, len(GRID.knots_s()))
    trajectory, _ = cover([dense(0, 30), dense(3, 30)], sigma)
    t = np.linspace(4, 12, 50)
    np.testing.assert_allclose(trajectory.sigma(t), np.interp(t, GRID.knots_s()[:61], sigma[:61]), rtol=1e-9)
    t = np.linspace(20.5, 25, 50)
    np.testing.assert_allclose(trajectory.sigma(t), np.interp(t, GRID.knots_s()[61:], sigma[61:]), rtol=1e-9)


@pytest.mark.parametrize("times", [[], [dense(2, 10)], [dense(2, 10), np.zeros(0)], [dense(2, 5), dense(7, 10)]])
def test_without_two_cameras_at_a_time_nothing_is_claimed(times):
    assert cover(times)[0].segments == ()


def test_what_is_not_claimed_is_counted_by_reason():
    """Seen by one camera to 4 s; from 12 s by two of which one disagrees; nobody looks from 13 to 15 s."""
    agreeing = [dense(2, 12), dense(4, 12)]
    seen = [dense(2, 13), dense(4, 13)]
    covered_s, found = cuts([*agreeing, dense(15, 17)], [*seen, dense(15, 17)])
    assert covered_s == pytest.approx(12.2 - 3.75, abs=0.06)
    assert found.cut_s["too_few_cameras"] == pytest.approx(2 + 2.5, abs=0.16)
    assert found.cut_s["cameras_disagree"] == pytest.approx(1.0, abs=0.11)
    assert found.cut_s["too_uncertain"] == found.cut_s["too_short"] == 0
    assert found.seen_s == pytest.approx(covered_s + sum(found.cut_s.values()), abs=0.06)


def test_cameras_that_never_meet_disagree():
    """Both see the target from 14 to 16 s, where there is no spline at all."""
    times = [np.r_[dense(2, 10), dense(14, 16)]] * 2
    _, found = cuts(times)
    assert found.cut_s["cameras_disagree"] == pytest.approx(2.5, abs=0.11)


def test_uncertain_and_short_stretches_are_told_apart():
    knots = GRID.knots_s()
    sigma = np.full(len(knots), 0.1)
    sigma[(knots > 7.9) & (knots < 9.1)] = 10.0
    both = np.r_[dense(2, 12), dense(22, 22.3)]
    covered_s, found = cuts([both, both], sigma=sigma)
    assert found.cut_s["too_uncertain"] == pytest.approx(1.4, abs=0.11)
    assert found.cut_s["too_short"] == pytest.approx(0.8, abs=0.11)
    _, lenient = cuts([both, both], sigma=sigma, max_sigma_ratio=200, min_segment_s=0.1)
    assert sum(lenient.cut_s.values()) == 0
    assert covered_s < lenient.seen_s


def test_asking_for_more_cameras_cuts_more():
    times = [dense(2, 10), dense(4, 12), dense(5, 9)]
    two, three = cuts(times)[1], cuts(times, min_cameras=3)[1]
    assert three.cut_s["too_few_cameras"] == pytest.approx(two.cut_s["too_few_cameras"] + 2, abs=0.11)
    assert three.seen_s == two.seen_s
