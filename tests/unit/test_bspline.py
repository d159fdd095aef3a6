"""B-splines by hand."""

from __future__ import annotations

import numpy as np

from skytrace.solvers import bspline


def test_weights_at_knots_and_middle():
    expected = [[1 / 6, 4 / 6, 1 / 6, 0], [1 / 48, 23 / 48, 23 / 48, 1 / 48], [0, 1 / 6, 4 / 6, 1 / 6]]
    np.testing.assert_allclose(bspline.basis(np.array([0.0, 0.5, 1.0])), expected, rtol=0, atol=1e-15)


def test_times_beyond_the_ends_belong_to_the_end_intervals():
    interval, u = bspline.locate(np.array([9.0, 10.0, 10.9, 11.0, 11.5]), 10.0, 0.5, 2)
    np.testing.assert_array_equal(interval, [0, 0, 1, 1, 1])
    np.testing.assert_allclose(u, [-2, 0, 0.8, 1, 2])


def test_a_straight_path_has_constant_velocity_in_seconds():
    control = np.arange(7.0)[:, None] * [3.0, -1.0]
    interval, u = bspline.locate(np.array([0.1, 0.7, 1.9]), 0.0, 0.5, 4)
    np.testing.assert_allclose(bspline.evaluate(control, interval, u, 0.5, 1), np.tile([6.0, -2.0], (3, 1)))
    np.testing.assert_allclose(bspline.evaluate(control, interval, u, 0.5, 2), 0, atol=1e-12)


def test_energy_of_least_jerk_is_the_squared_third_difference():
    """The third derivative is constant on an interval: the third difference of its four control points."""
    difference = np.array([-1.0, 3.0, -3.0, 1.0])
    np.testing.assert_allclose(bspline.energy_matrix(3), np.outer(difference, difference), rtol=0, atol=1e-12)
