"""Projection: OpenCV's formula by hand, and points that have no image."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.geometry.projection import distort, project, undistort

LENS = np.array([0.1, -0.2, 0.003, -0.004, 0.05])


def test_distortion_follows_the_published_formula():
    x, y = 0.3, -0.5
    r2 = x * x + y * y
    radial = 1 + 0.1 * r2 - 0.2 * r2**2 + 0.05 * r2**3
    expected = [
        x * radial + 2 * 0.003 * x * y - 0.004 * (r2 + 2 * x * x),
        y * radial + 0.003 * (r2 + 2 * y * y) - 2 * 0.004 * x * y,
    ]
    np.testing.assert_allclose(distort(np.array([[x, y]]), LENS)[0], expected, rtol=0, atol=1e-15)


def test_pixels_of_a_point_by_hand():
    pixels = project(np.array([[2.0, -1.0, 4.0]]), np.array([1000.0, 900.0]), np.array([640.0, 360.0]), np.zeros(5))
    np.testing.assert_allclose(pixels, [[1140, 135]])


def test_points_behind_or_in_the_camera_have_no_pixels():
    points = np.array([[0.0, 0.0, 1.0], [0.1, 0.1, 0.0], [0.1, 0.1, -2.0], [0.0, 0.0, np.nan]])
    pixels = project(points, np.array([1000.0, 1000.0]), np.array([640.0, 360.0]), LENS)
    np.testing.assert_array_equal(np.isnan(pixels).all(axis=1), [False, True, True, True])


def test_undistort_of_nothing_and_of_nan():
    xy, valid = undistort(np.zeros((0, 2)), LENS)
    assert xy.shape == (0, 2)
    assert valid.shape == (0,)
    xy, valid = undistort(np.array([[0.1, 0.2], [np.nan, 0.0]]), LENS)
    np.testing.assert_array_equal(valid, [True, False])
    np.testing.assert_allclose(distort(xy[:1], LENS), [[0.1, 0.2]], rtol=0, atol=1e-12)


def test_undistort_leaves_its_argument_alone():
    given = np.array([[0.3, 0.2]])
    undistort(given, LENS)
    np.testing.assert_array_equal(given, [[0.3, 0.2]])


@pytest.mark.parametrize("lens", [(-0.3, 0.0, 0.0, 0.0, 0.0), (-0.4, 0.25, 0.0, 0.0, -0.1)])
def test_points_far_outside_a_folding_lens_are_marked(lens):
    lens = np.array(lens)
    radius = np.linspace(0, 4, 40001)
    largest = distort(np.column_stack([radius, 0 * radius]), lens)[:, 0].max()
    _, valid = undistort(np.array([[0.99 * largest, 0.0], [1.01 * largest, 0.0], [0.0, -5 * largest]]), lens)
    np.testing.assert_array_equal(valid, [True, False, False])
