"""Two views: true correspondences obey the essential matrix, and the pose can be read back from it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from law_strategies import law, seeds

from skytrace.geometry.epipolar import (
    choose_pose,
    decompose_essential,
    essential_matrix,
    homogeneous,
    relative_depths,
    sampson_error,
)
from skytrace.geometry.rigid import Rigid, so3_exp, so3_log


def two_cameras(seed, n=30):
    """camera1_from_camera0 with unit baseline, and points (n, 3) in camera 0 that both have in front."""
    rng = np.random.default_rng(seed)
    point = np.column_stack([rng.uniform(-2, 2, (n, 2)), rng.uniform(4, 8, n)])
    centre = rng.normal(size=3) * [1, 1, 0.3]
    centre /= np.linalg.norm(centre)
    rotation = so3_exp(rng.normal(0, 0.25, 3))
    return Rigid.from_centre(rotation, centre), point


def views(pose, point):
    moved = pose.apply(point)
    return point[:, :2] / point[:, 2:], moved[:, :2] / moved[:, 2:], moved[:, 2]


@law
@given(seed=seeds)
def test_true_correspondences_obey_the_constraint(seed):
    pose, point = two_cameras(seed)
    xy0, xy1, _ = views(pose, point)
    E = essential_matrix(pose)
    np.testing.assert_allclose(sampson_error(E, xy0, xy1), 0, rtol=0, atol=1e-13)
    np.testing.assert_allclose(sampson_error(np.stack([E, 5 * E]), xy0, xy1), 0, rtol=0, atol=1e-13)
    wrong = essential_matrix(Rigid(so3_exp(np.array([0.05, 0.05, 0.0])) @ pose.rotation, pose.translation))
    assert np.abs(sampson_error(wrong, xy0, xy1)).max() > 1e-3


@law
@given(seed=seeds)
def test_sampson_error_is_the_distance_to_first_order(seed):
    """Step off the constraint's surface along its normal in the four coordinates: the step is the distance."""
    pose, point = two_cameras(seed)
    xy0, xy1, _ = views(pose, point)
    E = essential_matrix(pose)
    normal = np.column_stack([(homogeneous(xy1) @ E)[:, :2], (homogeneous(xy0) @ E.T)[:, :2]])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    for distance, tolerance in ((1e-3, 2e-3), (1e-5, 2e-5)):
        moved = distance * normal
        error = sampson_error(E, xy0 + moved[:, :2], xy1 + moved[:, 2:])
        np.testing.assert_allclose(error / distance, 1, rtol=0, atol=tolerance * 20)
        np.testing.assert_allclose(
            sampson_error(E, xy0 - moved[:, :2], xy1 - moved[:, 2:]) / distance, -1, rtol=0, atol=tolerance * 20
        )


@law
@given(seed=seeds, factor=st.floats(1e-3, 1e3))
def test_sampson_error_does_not_depend_on_the_scale_of_the_matrix(seed, factor):
    pose, point = two_cameras(seed)
    xy0, xy1, _ = views(pose, point)
    E = essential_matrix(pose)
    np.testing.assert_allclose(sampson_error(factor * E, xy0, xy1 + 0.01), sampson_error(E, xy0, xy1 + 0.01), rtol=1e-9)


@law
@given(seed=seeds, sign=st.sampled_from([-1.0, 1.0]))
def test_decomposition_contains_the_truth_and_points_in_front_tell_which(seed, sign):
    pose, point = two_cameras(seed)
    candidates = decompose_essential(sign * essential_matrix(pose))
    assert len(candidates) == 4
    distance = [
        np.linalg.norm(so3_log(c.rotation @ pose.rotation.T)) + np.linalg.norm(c.translation - pose.translation)
        for c in candidates
    ]
    assert sorted(distance)[0] < 1e-7
    assert sorted(distance)[1] > 0.1
    for c in candidates:
        E = essential_matrix(c) * np.linalg.norm(essential_matrix(pose)) / np.linalg.norm(essential_matrix(c))
        assert min(np.abs(E - essential_matrix(pose)).max(), np.abs(E + essential_matrix(pose)).max()) < 1e-10
    xy0, xy1, _ = views(pose, point)
    best, in_front = choose_pose(candidates, xy0, xy1)
    assert best is candidates[int(np.argmin(distance))]
    assert in_front == 1.0


@law
@given(seed=seeds)
def test_depths_are_those_of_the_points(seed):
    pose, point = two_cameras(seed)
    xy0, xy1, depth1 = views(pose, point)
    found0, found1 = relative_depths(pose, xy0, xy1)
    np.testing.assert_allclose(found0, point[:, 2], rtol=1e-8)
    np.testing.assert_allclose(found1, depth1, rtol=1e-8)
    behind = Rigid(pose.rotation, -pose.translation)
    assert (relative_depths(behind, xy0, xy1)[0] < 0).all()


def test_the_scenes_of_these_laws_have_all_points_in_front():
    for seed in range(200):
        pose, point = two_cameras(seed)
        assert (pose.apply(point)[:, 2] > 0.5).all()
    assert pose.translation @ pose.translation == pytest.approx(1)
