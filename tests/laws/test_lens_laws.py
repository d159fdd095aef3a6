"""Lenses: undistortion inverts distortion, derivatives are exact, and what cannot be inverted is said to be so."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from law_strategies import law, lenses, seeds

from skytrace.geometry.projection import distort, distort_jacobian, project, to_rays, undistort
from skytrace.model.camera import Intrinsics

# Invertible up to this radius on the plane z = 1: half a diagonal angle of 37 degrees.
REACH = 0.75


def disc(seed, n=50, radius=REACH):
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, 2 * np.pi, n)
    return (radius * np.sqrt(rng.uniform(0, 1, n)))[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


@law
@given(lens=lenses, seed=seeds)
def test_undistort_inverts_distort(lens, seed):
    xy = disc(seed)
    found, valid = undistort(distort(xy, lens), lens)
    assert valid.all()
    np.testing.assert_allclose(found, xy, rtol=0, atol=1e-10)


@law
@given(lens=lenses, seed=seeds)
def test_distort_inverts_undistort_wherever_it_says_so(lens, seed):
    xy_distorted = disc(seed, radius=1.5)
    found, valid = undistort(xy_distorted, lens)
    np.testing.assert_allclose(distort(found[valid], lens), xy_distorted[valid], rtol=0, atol=1e-9)


@law
@given(lens=lenses, seed=seeds)
def test_one_point_does_not_change_another(lens, seed):
    xy_distorted = np.concatenate([disc(seed, 5), disc(seed, 5, radius=4.0)])
    together = undistort(xy_distorted, lens)
    alone = [undistort(row[None], lens) for row in xy_distorted]
    np.testing.assert_array_equal(together[1], [valid[0] for _, valid in alone])
    sure = together[1]
    np.testing.assert_allclose(together[0][sure], np.concatenate([xy for xy, _ in alone])[sure], rtol=0, atol=1e-10)


@law
@given(lens=lenses, seed=seeds)
def test_derivative_of_distort_is_the_difference_quotient(lens, seed):
    xy, h = disc(seed), 1e-6
    J = distort_jacobian(xy, lens)
    for axis, step in enumerate(h * np.eye(2)):
        numeric = (distort(xy + step, lens) - distort(xy - step, lens)) / (2 * h)
        np.testing.assert_allclose(J[:, :, axis], numeric, rtol=0, atol=1e-8)


@law
@given(k1=st.floats(-0.6, -0.2), beyond=st.floats(1.001, 3.0), angle=st.floats(0, 6.2))
def test_beyond_the_fold_of_a_barrel_lens_nothing_is_valid(k1, beyond, angle):
    lens = np.array([k1, 0.0, 0.0, 0.0, 0.0])
    fold = np.sqrt(-1 / (3 * k1))  # where r (1 + k1 r^2) is largest
    largest = fold * (1 + k1 * fold**2)
    direction = np.array([[np.cos(angle), np.sin(angle)]])
    assert not undistort(beyond * largest * direction, lens)[1].any()
    found, valid = undistort(0.98 * largest * direction, lens)
    assert valid.all()
    assert np.linalg.norm(found) < fold


@law
@given(seed=seeds, lens=lenses)
def test_pixels_rays_and_points_agree(seed, lens):
    camera = Intrinsics(np.array([1500.0, 1450.0]), np.array([970.0, 530.0]), lens, (1920, 1080))
    xy = disc(seed)
    depth = np.random.default_rng(seed).uniform(0.1, 500, len(xy))
    point = np.column_stack([xy, np.ones(len(xy))]) * depth[:, None]
    pixels = camera.project(point)
    np.testing.assert_allclose(camera.undistort(pixels)[0], xy, rtol=0, atol=1e-9)
    rays = camera.rays(pixels)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1, rtol=0, atol=1e-12)
    np.testing.assert_allclose(rays, point / np.linalg.norm(point, axis=1, keepdims=True), rtol=0, atol=1e-9)
    np.testing.assert_allclose(to_rays(xy), rays, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(pixels, project(point, camera.focal_px, camera.principal_px, lens))
    assert np.isnan(camera.project(-point)).all()


def test_a_lens_that_folds_back_out_has_no_second_image():
    """k2 > 0 lets the radius rise again beyond the fold at r = 1; those places are not what the camera sees."""
    lens = np.array([-0.5, 0.1, 0.0, 0.0, 0.0])
    assert distort(np.array([[1.0, 0.0]]), lens)[0, 0] == pytest.approx(0.6)  # the largest radius before the fold
    assert not undistort(np.array([[0.7, 0.0], [0.0, -0.9], [0.8, 0.8]]), lens)[1].any()


def test_the_strongest_lens_of_these_laws_bends_by_many_pixels():
    corner = np.array([[0.6, 0.4]])
    assert 1500 * np.linalg.norm(distort(corner, np.array([0.19, -0.76, 6e-4, -4e-4, 0.94])) - corner) > 10
