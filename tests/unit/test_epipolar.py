"""Two views by hand."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.geometry.epipolar import choose_pose, decompose_essential, essential_matrix, homogeneous, sampson_error
from skytrace.geometry.rigid import Rigid

SIDEWAYS = Rigid(np.eye(3), np.array([-1.0, 0.0, 0.0]))  # camera 1 stands one unit to the right of camera 0


def test_homogeneous_appends_a_one_to_any_shape():
    out = homogeneous(np.full((2, 5, 2), 7.0))
    assert out.shape == (2, 5, 3)
    np.testing.assert_array_equal(out[1, 3], [7, 7, 1])


def test_sideways_cameras_see_points_on_one_row():
    E = essential_matrix(SIDEWAYS)
    xy0 = np.array([[0.2, 0.1], [0.2, 0.1]])
    xy1 = np.array([[0.0, 0.1], [0.0, 0.13]])
    error = sampson_error(E, xy0, xy1)
    # The row differs by 0.03; the nearest true pair shares it out between both images.
    np.testing.assert_allclose(np.abs(error), [0, 0.03 / np.sqrt(2)], rtol=0, atol=1e-15)


def test_stacked_matrices_give_stacked_errors(rng):
    F = rng.normal(size=(4, 3, 3))
    xy0, xy1 = rng.normal(size=(2, 6, 2))
    many = sampson_error(F, xy0, xy1)
    assert many.shape == (4, 6)
    np.testing.assert_allclose(many[2], sampson_error(F[2], xy0, xy1), rtol=1e-13)


def test_a_matrix_of_zeros_gives_no_nan():
    np.testing.assert_array_equal(sampson_error(np.zeros((3, 3)), np.ones((2, 2)), np.ones((2, 2))), 0)


def test_a_matrix_near_an_essential_one_decomposes_nearby(rng):
    E = essential_matrix(SIDEWAYS) + 1e-4 * rng.normal(size=(3, 3))
    candidates = decompose_essential(E)
    assert (
        min(np.abs(c.rotation - np.eye(3)).max() + np.abs(c.translation - [-1, 0, 0]).max() for c in candidates) < 2e-3
    )
    assert all(np.linalg.norm(c.translation) == pytest.approx(1) for c in candidates)


def test_cheirality_reports_the_fraction_in_front():
    point = np.array([[0.0, 0.0, 5.0], [1.0, 0.5, 4.0], [0.5, -0.5, 6.0], [0.2, 0.2, 3.0]])
    moved = SIDEWAYS.apply(point)
    xy0, xy1 = point[:, :2] / point[:, 2:], moved[:, :2] / moved[:, 2:]
    xy1[3, 0] = xy0[3, 0] + 0.1  # rays that diverge meet behind the cameras
    best, fraction = choose_pose([Rigid(np.eye(3), np.array([1.0, 0.0, 0.0])), SIDEWAYS], xy0, xy1)
    assert best is SIDEWAYS
    assert fraction == 0.75
