"""Points from rays: exact without noise, unimpressed by one wrong ray of four, and NaN where nothing is known."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from law_strategies import law, rigids, seeds

from skytrace.geometry.triangulation import midpoint, parallax, ray_errors, triangulate


def scene(seed, n_cameras=4, n=20):
    """Centres (c, 3) on a ring, points (n, 3) inside it and the unit rays (n, c, 3) between them."""
    rng = np.random.default_rng(seed)
    azimuth = 2 * np.pi * (np.arange(n_cameras) + rng.uniform(-0.2, 0.2, n_cameras)) / n_cameras
    centre = np.column_stack([60 * np.cos(azimuth), 60 * np.sin(azimuth), rng.uniform(0, 3, n_cameras)])
    point = rng.uniform(-20, 20, (n, 3)) + [0, 0, 30]
    ray = point[:, None] - centre
    return centre, point, ray / np.linalg.norm(ray, axis=2, keepdims=True)


@law
@given(seed=seeds, n_cameras=st.integers(2, 6))
def test_exact_rays_meet_in_the_point(seed, n_cameras):
    centre, point, ray = scene(seed, n_cameras)
    np.testing.assert_allclose(midpoint(centre, ray, np.ones(ray.shape[:2])), point, rtol=0, atol=1e-8)
    np.testing.assert_allclose(ray_errors(point, centre, ray), 0, rtol=0, atol=1e-12)
    found = triangulate(centre, ray, 0.005, 0.03)
    assert found.valid.all()
    assert found.inlier.all()
    np.testing.assert_allclose(found.point_in_world, point, rtol=0, atol=1e-8)
    np.testing.assert_array_equal(found.angle_rad, parallax(ray, np.ones(ray.shape[:2], bool)))


@law
@given(seed=seeds, wrong=st.integers(0, 3), degrees=st.floats(3, 170))
def test_one_wrong_ray_of_four_is_found_out(seed, wrong, degrees):
    centre, point, ray = scene(seed)
    across = np.cross(ray[:, wrong], [0.3, -0.5, 0.8])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    angle = np.radians(degrees)
    ray[:, wrong] = np.cos(angle) * ray[:, wrong] + np.sin(angle) * across
    found = triangulate(centre, ray, 0.005, 0.03)
    assert found.valid.all()
    np.testing.assert_allclose(found.point_in_world, point, rtol=0, atol=1e-7)
    expected = np.ones((len(point), 4), bool)
    expected[:, wrong] = False
    np.testing.assert_array_equal(found.inlier, expected)


@law
@given(seed=seeds, pose=rigids, scale=st.floats(0.1, 10))
def test_triangulation_moves_with_the_world(seed, pose, scale):
    centre, _, ray = scene(seed)
    rng = np.random.default_rng(seed)
    ray = ray + rng.normal(0, 1e-3, ray.shape)
    ray /= np.linalg.norm(ray, axis=2, keepdims=True)
    here = triangulate(centre, ray, 0.02, 0.03)
    there = triangulate(scale * pose.apply(centre), ray @ pose.rotation.T, 0.02, 0.03)
    np.testing.assert_array_equal(here.inlier, there.inlier)
    expected = scale * pose.apply(here.point_in_world)
    np.testing.assert_allclose(there.point_in_world, expected, rtol=0, atol=1e-8 * max(scale, 1) * 100)


@law
@given(seed=seeds)
def test_midpoint_is_nearest_to_the_rays(seed):
    centre, _, ray = scene(seed)
    rng = np.random.default_rng(seed)
    ray = ray + rng.normal(0, 0.02, ray.shape)
    ray /= np.linalg.norm(ray, axis=2, keepdims=True)
    weight = rng.uniform(0, 1, ray.shape[:2]) * (rng.uniform(0, 1, ray.shape[:2]) > 0.2)
    weight[:, :2] += 0.1

    def cost(point):
        offset = np.cross(point[:, None] - centre, ray)
        return (weight * (offset**2).sum(2)).sum(1)

    best = midpoint(centre, ray, weight)
    for step in np.vstack([np.eye(3), -np.eye(3)]):
        assert (cost(best + 0.01 * step) > cost(best)).all()
