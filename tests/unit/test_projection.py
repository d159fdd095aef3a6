"""Projection: OpenCV's formula by hand, and points that have no image."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.geometry.projection import distort, one_to_one_radius, project, undistort

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


def test_the_fold_is_the_first_place_where_the_radius_stops_growing():
    assert one_to_one_radius(np.zeros(5)) == np.inf
    assert one_to_one_radius(np.array([0.19, -0.76, 0.0, 0.0, 0.94])) == np.inf
    assert one_to_one_radius(np.array([-1 / 3, 0.0, 0.01, 0.01, 0.0])) == pytest.approx(1.0)
    assert one_to_one_radius(np.array([-0.5, 0.1, 0.0, 0.0, 0.0])) == pytest.approx(1.0)  # and once more at root two
    lens = np.array([0.1, -0.3, 0.0, 0.0, 0.05])
    radius = np.linspace(0, 3, 300001)
    bent = distort(np.column_stack([radius, 0 * radius]), lens)[:, 0]
    assert one_to_one_radius(lens) == pytest.approx(radius[np.argmax(np.diff(bent) < 0)], abs=1e-4)


def test_a_mirror_image_across_the_axis_is_no_solution():
    """Far out this lens turns points to the other side, where Newton's method finds some of them."""
    lens = np.array([-0.25, -0.2, 0.002, 0.001, 0.0])
    angle = np.linspace(0, 2 * np.pi, 200)
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    radius = np.linspace(0, 1, 1001)
    largest = max(np.linalg.norm(distort(radius[:, None] * d, lens), axis=1).max() for d in rim)
    for beyond in (1.05, 1.5, 2.0, 5.0):
        assert not undistort(beyond * largest * rim, lens)[1].any()
    assert undistort(0.9 * largest * rim, lens)[1].all()


def test_newtons_steps_are_kept_from_leaving_the_image():
    """A pincushion lens so strong that a full first step overshoots for good."""
    lens = np.array([0.52767, 0.87466, 0.00104, 0.00063, -0.54715])
    xy = np.array([[-0.21966, 0.76495]])
    found, valid = undistort(distort(xy, lens), lens)
    assert valid.all()
    np.testing.assert_allclose(found, xy, rtol=0, atol=1e-9)
