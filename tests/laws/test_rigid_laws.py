"""Rotations, rigid motions and similarities obey the group axioms and are recovered from what they do."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from law_strategies import directions, law, points, rigids, rotations, seeds, similarities, spread_points, vectors

from skytrace.geometry.rigid import Rigid, align_similarity, hat, nearest_rotation, so3_exp, so3_log


def assert_same(a, b, atol=1e-9):
    np.testing.assert_allclose(a, b, rtol=0, atol=atol)


@law
@given(v=vectors(10.0), w=vectors(10.0))
def test_hat_is_the_cross_product(v, w):
    assert_same(hat(v) @ w, np.cross(v, w), 1e-12)
    assert_same(hat(v), -hat(v).T, 0.0)
    assert_same(hat(np.stack([v, w]))[1], hat(w), 0.0)


@law
@given(axis=directions, angle=st.floats(0, 2 * np.pi))
@example(axis=np.array([0.0, 0.6, 0.8]), angle=0.0)
@example(axis=np.array([0.0, 0.6, 0.8]), angle=3e-9)
@example(axis=np.array([0.0, 0.6, 0.8]), angle=1e-7)
def test_exp_is_a_rotation_about_the_axis_by_the_angle(axis, angle):
    R = so3_exp(axis * angle)
    assert_same(R @ R.T, np.eye(3), 1e-14)
    assert np.linalg.det(R) == pytest.approx(1, abs=1e-14)
    assert_same(R @ axis, axis, 1e-14)
    across = np.linalg.svd(axis[None])[2][1]
    assert_same(R @ across, np.cos(angle) * across + np.sin(angle) * np.cross(axis, across), 1e-14)


@law
@given(axis=directions, a=st.floats(-3, 3), b=st.floats(-3, 3))
def test_rotations_about_one_axis_add_up(axis, a, b):
    assert_same(so3_exp(a * axis) @ so3_exp(b * axis), so3_exp((a + b) * axis), 1e-13)


@law
@given(axis=directions, angle=st.floats(0, np.pi - 1e-3))
def test_log_inverts_exp(axis, angle):
    assert_same(so3_log(so3_exp(axis * angle)), axis * angle, 1e-11)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-9, 9e-9, 1.1e-8, 1e-7, 9e-7, 1.1e-6, 1e-5, 1e-3])
@law
@given(axis=directions)
def test_log_inverts_exp_near_zero(angle, axis):
    assert_same(so3_log(so3_exp(axis * angle)), axis * angle, 1e-15 + 1e-9 * angle)


@pytest.mark.parametrize("rest", [0.0, 1e-12, 1e-9, 1e-7, 9e-7, 1.1e-6, 1e-5, 1e-3])
@law
@given(axis=directions)
def test_log_inverts_exp_near_half_a_turn(rest, axis):
    omega = so3_log(so3_exp(axis * (np.pi - rest)))
    assert np.linalg.norm(omega) == pytest.approx(np.pi - rest, abs=1e-8)
    if rest < 1e-12:  # both ways round are the same rotation
        omega = omega * np.sign(omega @ axis)
    assert_same(omega, axis * (np.pi - rest), 1e-8)


@law
@given(axis=directions, angle=st.floats(0, 7))
def test_exp_inverts_log_and_log_is_the_shortest_way(axis, angle):
    R = so3_exp(axis * angle)
    omega = so3_log(R)
    assert np.linalg.norm(omega) <= np.pi + 1e-12
    assert_same(so3_exp(omega), R, 1e-8)


@law
@given(rotation=rotations, seed=seeds)
def test_nearest_rotation_keeps_rotations_and_beats_all_others_nearby(rotation, seed):
    assert_same(nearest_rotation(rotation), rotation, 1e-13)
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(3, 3))
    nearest = nearest_rotation(matrix)
    assert_same(nearest @ nearest.T, np.eye(3), 1e-13)
    assert np.linalg.det(nearest) == pytest.approx(1)
    distance = np.linalg.norm(matrix - nearest)
    for size in (1e-3, 0.1, 1.0, 3.0):
        other = so3_exp(size * rng.normal(size=3)) @ nearest
        assert np.linalg.norm(matrix - other) >= distance - 1e-12


@law
@given(a=rigids, b=rigids, c=rigids, x=points())
def test_rigid_motions_form_a_group(a, b, c, x):
    one = Rigid.identity()
    assert_same((a @ b).apply(x), a.apply(b.apply(x)), 1e-10)
    assert_same(((a @ b) @ c).apply(x), (a @ (b @ c)).apply(x), 1e-10)
    for left, right in ((a @ one, a), (one @ a, a), (a @ a.inverse(), one), (a.inverse() @ a, one)):
        assert_same(left.rotation, right.rotation, 1e-12)
        assert_same(left.translation, right.translation, 1e-10)
    assert_same((a @ b).inverse().apply(x), (b.inverse() @ a.inverse()).apply(x), 1e-10)


@law
@given(a=rigids, x=points(least=2))
def test_rigid_motions_keep_distances_and_know_their_centre(a, x):
    y = a.apply(x)
    assert_same(np.linalg.norm(y[1:] - y[:-1], axis=1), np.linalg.norm(x[1:] - x[:-1], axis=1), 1e-10)
    assert_same(a.apply(a.centre), np.zeros(3), 1e-10)
    again = Rigid.from_centre(a.rotation, a.centre)
    assert_same(again.translation, a.translation, 1e-10)
    assert_same(again.rotation, a.rotation, 0.0)


@law
@given(s=similarities, x=points(least=2))
def test_similarities_are_undone_by_their_inverse_and_scale_distances(s, x):
    assert_same(s.inverse().apply(s.apply(x)), x, 1e-9)
    assert_same(s.apply(s.inverse().apply(x)), x, 1e-9)
    assert s.inverse().scale == pytest.approx(1 / s.scale, rel=1e-14)
    y = s.apply(x)
    distance = np.linalg.norm(x[1:] - x[:-1], axis=1)
    assert_same(np.linalg.norm(y[1:] - y[:-1], axis=1), s.scale * distance, 1e-9)


@law
@given(s=similarities, pose=rigids, x=points())
def test_a_pose_in_a_moved_world_sees_the_moved_points_at_scaled_places(s, pose, x):
    assert_same(s.apply_to_pose(pose).apply(s.apply(x)), s.scale * pose.apply(x), 1e-8)


@law
@given(s=similarities, x=spread_points(6), seed=seeds)
def test_alignment_recovers_a_similarity_whatever_the_order_and_weights(s, x, seed):
    rng = np.random.default_rng(seed)
    order, weights = rng.permutation(len(x)), rng.uniform(0.1, 1.0, len(x))
    y = s.apply(x)
    for found in (align_similarity(x, y), align_similarity(x[order], y[order]), align_similarity(x, y, weights)):
        assert found.scale == pytest.approx(s.scale, rel=1e-9)
        assert_same(found.rotation, s.rotation, 1e-9)
        assert_same(found.translation, s.translation, 1e-8 * (1 + s.scale))


@law
@given(x=spread_points(7), y=spread_points(7), seed=seeds)
def test_alignment_of_unlike_points_is_a_weighted_least_squares_minimum(x, y, seed):
    rng = np.random.default_rng(seed)
    weights, order = rng.uniform(0.1, 1.0, len(x)), rng.permutation(len(x))

    def cost(scale, rotation, translation):
        return float(weights @ ((scale * x @ rotation.T + translation - y) ** 2).sum(1))

    best = align_similarity(x, y, weights)
    assert np.linalg.det(best.rotation) == pytest.approx(1)
    least = cost(best.scale, best.rotation, best.translation)
    for size in (1e-4, 1e-2):
        for sign in (-size, size):
            for axis in np.eye(3):
                assert cost(best.scale, so3_exp(sign * axis) @ best.rotation, best.translation) >= least - 1e-12
                assert cost(best.scale, best.rotation, best.translation + sign * axis) >= least
            assert cost(best.scale * (1 + sign), best.rotation, best.translation) >= least
    shuffled = align_similarity(x[order], y[order], weights[order])
    assert_same(shuffled.apply(x), best.apply(x), 1e-9)


@law
@given(pose=rigids, x=spread_points(5), scale=st.floats(0.5, 2.0))
def test_alignment_without_scale_is_rigid(pose, x, scale):
    found = align_similarity(x, pose.apply(scale * x), with_scale=False)
    assert found.scale == 1.0
    assert_same(found.rotation, pose.rotation, 1e-9)
