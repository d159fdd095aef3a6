"""Rigid motions and similarities: conventions by hand, and refusals."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.geometry.rigid import Rigid, Similarity, align_similarity, hat, nearest_rotation, so3_exp

QUARTER_ABOUT_Z = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def test_positive_angles_turn_x_towards_y():
    np.testing.assert_allclose(so3_exp(np.array([0.0, 0.0, np.pi / 2])), QUARTER_ABOUT_Z, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(hat(np.array([1.0, 2.0, 3.0])), [[0, -3, 2], [3, 0, -1], [-2, 1, 0]])


def test_apply_rotates_then_translates_any_shape():
    motion = Rigid(QUARTER_ABOUT_Z, np.array([10.0, 20.0, 30.0]))
    np.testing.assert_allclose(motion.apply(np.array([1.0, 0.0, 5.0])), [10, 21, 35])
    many = motion.apply(np.tile([1.0, 0.0, 5.0], (4, 2, 1)))
    assert many.shape == (4, 2, 3)
    np.testing.assert_allclose(many[3, 1], [10, 21, 35])


def test_matmul_reads_right_to_left():
    turn, shift = Rigid(QUARTER_ABOUT_Z, np.zeros(3)), Rigid(np.eye(3), np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose((turn @ shift).apply(np.zeros(3)), [0, 1, 0])
    np.testing.assert_allclose((shift @ turn).apply(np.zeros(3)), [1, 0, 0])


def test_long_products_stay_orthonormal():
    step = Rigid(so3_exp(np.array([0.1, -0.2, 0.3])), np.array([1e-3, 0.0, 0.0]))
    total = Rigid.identity()
    for _ in range(2000):
        total = step @ total
    np.testing.assert_allclose(total.rotation @ total.rotation.T, np.eye(3), rtol=0, atol=1e-13)


def test_a_similarity_scales_before_it_shifts():
    s = Similarity(2.0, QUARTER_ABOUT_Z, np.array([1.0, 1.0, 1.0]))
    np.testing.assert_allclose(s.apply(np.array([[3.0, 0.0, 0.0]])), [[1, 7, 1]])


@pytest.mark.parametrize(
    "matrix", [np.diag([1.0, 1.0, -1.0]), 1.001 * np.eye(3), np.array([[1.0, 0.1, 0], [0, 1, 0], [0, 0, 1]])]
)
def test_what_is_not_a_rotation_is_refused(matrix):
    with pytest.raises(ValueError, match="orthonormal"):
        Rigid(matrix, np.zeros(3))


def test_shapes_and_scales_are_checked():
    with pytest.raises(ValueError, match="translation: expected shape"):
        Rigid(np.eye(3), np.zeros(2))
    with pytest.raises(ValueError, match="not finite"):
        Rigid(np.eye(3), np.array([0.0, np.nan, 0.0]))
    for scale in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match="scale: expected a positive number"):
            Similarity(scale, np.eye(3), np.zeros(3))


def test_nearest_rotation_of_a_mirror_image_is_proper():
    assert np.linalg.det(nearest_rotation(np.diag([1.0, 1.0, -1.0]))) == pytest.approx(1)


@pytest.mark.parametrize("shapes", [((2, 3), (2, 3)), ((4, 3), (5, 3)), ((4, 2), (4, 2)), ((3,), (3,))])
def test_alignment_needs_three_points_each(shapes):
    with pytest.raises(ValueError, match="expected two arrays"):
        align_similarity(np.ones(shapes[0]), np.ones(shapes[1]))


def test_alignment_refuses_points_in_one_place(rng):
    with pytest.raises(ValueError, match="coincide"):
        align_similarity(np.ones((5, 3)), rng.normal(size=(5, 3)))


def test_alignment_ignores_points_of_no_weight(rng):
    x = rng.normal(size=(6, 3))
    y = 3 * x @ QUARTER_ABOUT_Z.T + 1
    y[5] += 1000
    found = align_similarity(x, y, np.array([1.0, 1, 1, 1, 1, 0]))
    assert found.scale == pytest.approx(3)
    np.testing.assert_allclose(found.rotation, QUARTER_ABOUT_Z, rtol=0, atol=1e-12)
