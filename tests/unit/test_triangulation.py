"""Robust triangulation: what is valid, and what is NaN."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.geometry.triangulation import midpoint, parallax, ray_errors, triangulate

CENTRE = np.array([[-50.0, 0.0, 0.0], [50.0, 0.0, 0.0], [0.0, -50.0, 0.0], [0.0, 60.0, 0.0]])
POINT = np.array([[0.0, 0.0, 30.0], [5.0, 5.0, 20.0]])


def rays(point=POINT, centre=CENTRE):
    ray = point[:, None] - centre
    return ray / np.linalg.norm(ray, axis=2, keepdims=True)


def turned(ray, degrees):
    axis = np.cross(ray, [0.0, 0.6, 0.8])
    axis /= np.linalg.norm(axis)
    angle = np.radians(degrees)
    return np.cos(angle) * ray + np.sin(angle) * np.cross(axis, ray)


def test_one_ray_or_none_gives_no_point():
    ray = rays()
    ray[0, 1:] = np.nan
    ray[1] = np.nan
    found = triangulate(CENTRE, ray, 0.01, 0.03)
    assert not found.valid.any()
    assert np.isnan(found.point_in_world).all()
    assert not found.inlier.any()


def test_missing_rays_are_no_inliers_and_do_no_harm():
    ray = rays()
    ray[0, 3] = np.nan
    found = triangulate(CENTRE, ray, 0.01, 0.03)
    np.testing.assert_allclose(found.point_in_world, POINT, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(found.inlier, [[True, True, True, False], [True] * 4])


def test_too_small_an_angle_is_not_valid():
    near = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    ray = rays(centre=near)  # 1/30 and 1/21 rad or so
    angle = parallax(ray, np.ones((2, 2), bool))
    np.testing.assert_allclose(angle[0], np.arctan(1 / 30), rtol=1e-9)
    found = triangulate(near, ray, 0.001, 0.04)
    np.testing.assert_array_equal(found.valid, [False, True])
    np.testing.assert_array_equal(np.isnan(found.point_in_world[:, 0]), [True, False])


def test_half_of_the_rays_agreeing_is_not_enough():
    ray = rays()[:1]
    ray[0, 2], ray[0, 3] = turned(ray[0, 2], 20), turned(ray[0, 3], -35)
    assert not triangulate(CENTRE, ray, 0.005, 0.03).valid[0]
    found = triangulate(CENTRE, ray, 0.005, 0.03, min_fraction=0.5)
    assert found.valid[0]
    np.testing.assert_array_equal(found.inlier[0], [True, True, False, False])
    np.testing.assert_allclose(found.point_in_world[0], POINT[0], rtol=0, atol=1e-8)


def test_rays_that_meet_behind_a_camera_do_not_agree():
    found = triangulate(CENTRE[:2], -rays()[:, :2], 0.01, 0.03)
    assert not found.valid.any()


def test_errors_are_angles_in_radians():
    ray = rays()[:1].copy()
    ray[0, 1] = turned(ray[0, 1], 2.0)
    ray[0, 2] = -ray[0, 2]
    ray[0, 3] = np.nan
    error = ray_errors(POINT[:1], CENTRE, ray)[0]
    np.testing.assert_allclose(error[:3], [0, np.radians(2), np.pi], rtol=0, atol=1e-9)
    assert np.isnan(error[3])


def test_parallel_rays_and_rays_without_weight_are_undetermined():
    parallel = np.tile([0.0, 0.0, 1.0], (1, 2, 1))
    assert np.isnan(midpoint(CENTRE[:2], parallel, np.ones((1, 2)))).all()
    assert np.isnan(midpoint(CENTRE, rays()[:1], np.zeros((1, 4)))).all()
    assert np.isnan(midpoint(CENTRE, rays()[:1], np.array([[1.0, 0, 0, 0]]))).all()


def test_rays_of_no_weight_may_be_nan():
    ray = rays()
    ray[:, 3] = np.nan
    point = midpoint(CENTRE, ray, np.array([[1.0, 1, 1, 0], [1, 1, 0, 0]]))
    np.testing.assert_allclose(point, POINT, rtol=0, atol=1e-9)


def test_the_midpoint_halves_the_gap_of_skew_rays():
    centre = np.array([[0.0, 0.0, 0.0], [5.0, 2.0, -5.0]])
    ray = np.array([[[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]])  # pass at (5, 0, 0) and (5, 2, 0)
    np.testing.assert_allclose(midpoint(centre, ray, np.ones((1, 2))), [[5, 1, 0]], atol=1e-12)
    np.testing.assert_allclose(midpoint(centre, ray, np.array([[3.0, 1.0]])), [[5, 0.5, 0]], atol=1e-12)


def test_the_point_is_the_angular_least_squares_fit_to_all_agreeing_rays(rng):
    """Rays of near cameras bind more tightly: the weights are inverse squared distances."""
    centre = CENTRE * [[0.3], [1.0], [2.0], [4.0]]
    ray = rays(centre=centre) + rng.normal(0, 2e-3, (2, 4, 3))
    ray /= np.linalg.norm(ray, axis=2, keepdims=True)
    point = POINT
    for _ in range(20):
        point = midpoint(centre, ray, np.linalg.norm(point[:, None] - centre, axis=2) ** -2)
    found = triangulate(centre, ray, 0.02, 0.03)
    assert found.inlier.all()
    np.testing.assert_allclose(found.point_in_world, point, rtol=0, atol=1e-4)
    assert (np.linalg.norm(midpoint(centre, ray, np.ones((2, 4))) - point, axis=1) > 1e-2).all()


def test_noise_is_averaged_over_all_agreeing_rays(rng):
    point = np.tile(POINT[:1], (400, 1))
    ray = rays(point) + rng.normal(0, 1e-3, (400, 4, 3))
    ray /= np.linalg.norm(ray, axis=2, keepdims=True)
    spread = [
        np.linalg.norm(triangulate(CENTRE[:c], ray[:, :c], 0.02, 0.03).point_in_world - point, axis=1).mean()
        for c in (2, 4)
    ]
    assert spread[1] < 0.85 * spread[0]
    assert spread[1] == pytest.approx(0.05, abs=0.03)


def test_cameras_that_face_each_other_do_not_fix_the_point_between_them(rng):
    point = np.tile([[10.0, 0.05, 0.0]], (200, 1))
    ray = rays(point, CENTRE[:2]) + rng.normal(0, 1e-3, (200, 2, 3))
    ray /= np.linalg.norm(ray, axis=2, keepdims=True)
    found = triangulate(CENTRE[:2], ray, 0.01, 0.035)
    error = np.linalg.norm(found.point_in_world - point, axis=1)[found.valid]
    assert error.max(initial=0.0) < 5.0
