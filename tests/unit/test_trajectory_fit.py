"""The first spline: where its knots lie, and how it goes through triangulated points."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from skytrace.estimation.trajectory_fit import fit_spline, knot_grid


def every(begin_s, end_s, step_s=0.1):
    return np.arange(begin_s, end_s, step_s)


def test_one_run_covers_the_times_and_a_margin():
    grid = knot_grid(np.array([3.05, 3.1, 3.3, 3.5, 4.3]), 0.2, 0.6, 2.0)
    assert grid.runs == ((12, 25),)  # intervals 15 to 21, three more on either side
    assert grid.spacing_s == 0.2
    assert grid.n_control == 16


def test_silences_are_bridged_up_to_a_length():
    times = np.r_[every(0.05, 5), every(6.85, 10), every(20.05, 25)]
    assert knot_grid(times, 0.2, 0.4, 2.0).runs == ((-2, 52), (98, 127))
    assert knot_grid(times, 0.2, 0.4, 1.0).runs == ((-2, 27), (32, 52), (98, 127))


def test_times_need_not_be_in_order(rng):
    times = np.r_[every(0, 3), every(9, 12), every(40, 41)]
    assert knot_grid(rng.permutation(times), 0.2, 0.2, 1.0).runs == knot_grid(times, 0.2, 0.2, 1.0).runs


def test_a_handful_of_times_far_from_all_others_is_no_run():
    assert knot_grid(np.zeros(0), 0.2, 0.6, 2.0) is None
    assert knot_grid(every(0, 0.35), 0.2, 0.6, 2.0) is None
    alone = knot_grid(every(10, 15), 0.2, 0.6, 2.0).runs
    assert knot_grid(np.r_[every(0, 0.35), every(10, 15), 30.0], 0.2, 0.6, 2.0).runs == alone
    assert len(knot_grid(np.r_[every(0, 0.45), every(10, 15), 30.0], 0.2, 0.6, 2.0).runs) == 2


@settings(max_examples=100, deadline=None, derandomize=True, database=None)
@given(
    begins=st.lists(st.floats(-50, 50), min_size=1, max_size=6),
    spacing=st.floats(0.1, 1.0),
    margin=st.floats(0.05, 2.0),
    bridge=st.floats(0.0, 5.0),
)
def test_runs_are_apart_and_every_time_is_inside(begins, spacing, margin, bridge):
    times = (np.array(begins)[:, None] + np.arange(8) / 15).ravel()
    grid = knot_grid(times, spacing, margin, bridge)
    for (_, b), (a, _) in pairwise(grid.runs):
        assert a > b  # at least one interval between them
    first, u = grid.locate(times)
    assert (first >= 0).all()
    assert ((u >= 0) & (u <= 1)).all()
    around = np.concatenate([times - margin / 2, times + margin / 2])
    assert (grid.locate(around)[0] >= 0).all()
    assert len(grid.knots_s()) == sum(b - a + 1 for a, b in grid.runs)


def flight(t):
    return np.column_stack([10 * np.sin(0.5 * t), 8 * np.cos(0.3 * t), 20 + 3 * np.sin(0.7 * t + 1)])


def test_exact_points_are_followed():
    t = np.arange(0, 20, 1 / 15)
    grid = knot_grid(t, 0.2, 0.6, 2.0)
    control = fit_spline(grid, t, flight(t), np.ones(len(t)))
    between = np.linspace(0, 19.9, 997)
    assert np.abs(grid.evaluate(control, between) - flight(between)).max() < 1e-3


def test_noise_is_smoothed_and_outliers_are_ignored(rng):
    t = np.arange(0, 30, 1 / 15)
    sigma = np.full(len(t), 0.1)
    points = flight(t) + 0.1 * rng.normal(size=(len(t), 3))
    grid = knot_grid(t, 0.2, 0.6, 2.0)
    between = np.linspace(0.5, 29.4, 997)

    def deviation(p):
        return np.sqrt(np.mean((grid.evaluate(fit_spline(grid, t, p, sigma), between) - flight(between)) ** 2))

    clean = deviation(points)
    assert clean < 0.05
    wild = points.copy()
    wild[rng.permutation(len(t))[:22]] += rng.normal(0, 20, (22, 3))
    assert deviation(wild) < 1.5 * clean


def test_uncertain_points_count_less(rng):
    t = np.repeat(np.arange(0, 20, 1 / 15), 2)
    sigma = np.tile([0.05, 1.0], len(t) // 2)
    points = flight(t) + sigma[:, None] * rng.normal(size=(len(t), 3))
    grid = knot_grid(t, 0.2, 0.6, 2.0)
    weighed = grid.evaluate(fit_spline(grid, t, points, sigma), t) - flight(t)
    equal = grid.evaluate(fit_spline(grid, t, points, np.full(len(t), 0.5)), t) - flight(t)
    assert np.sqrt(np.mean(weighed**2)) < 0.75 * np.sqrt(np.mean(equal**2))


def test_short_silences_are_bridged_smoothly():
    t = np.arange(0, 20, 1 / 15)
    t = t[(t < 8) | (t > 9.2)]
    grid = knot_grid(t, 0.2, 0.6, 2.0)
    assert len(grid.runs) == 1
    control = fit_spline(grid, t, flight(t), np.ones(len(t)))
    between = np.linspace(8, 9.2, 50)
    assert np.abs(grid.evaluate(control, between) - flight(between)).max() < 0.05


def test_points_outside_the_grid_are_left_out():
    t = np.arange(0, 10, 1 / 15)
    grid = knot_grid(t, 0.2, 0.6, 2.0)
    points = flight(t)
    alone = fit_spline(grid, t, points, np.ones(len(t)))
    more = fit_spline(grid, np.append(t, 500.0), np.vstack([points, [[1e6, 1e6, 1e6]]]), np.ones(len(t) + 1))
    np.testing.assert_allclose(more, alone, rtol=0, atol=1e-9)
