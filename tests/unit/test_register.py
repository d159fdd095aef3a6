"""Adding a camera to a trajectory: its pose, or the reason why there is none."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from test_structure import SETTINGS, three_cameras, true_scene

from skytrace.estimation.register import RegisterSettings, register
from skytrace.estimation.scene import Scene
from skytrace.estimation.structure import fit_structure, triangulate_scene
from skytrace.geometry.rigid import Rigid, so3_log


@pytest.fixture(scope="module")
def known():
    """The scene of two cameras with its trajectory, all paths, the supported times and the third camera's truth."""
    scene, paths = true_scene(three_cameras())
    two = Scene("cam0", {c: scene.cameras[c] for c in ("cam0", "cam1")})
    found = triangulate_scene(two, paths, SETTINGS)
    return fit_structure(two, found, SETTINGS), paths["cam2"], found.time_s, scene.cameras["cam2"]


def attempt(known, path=None, offset_s=None, times=None, scene=None, **settings):
    two, own, supported, truth = known
    return register(
        scene or two, supported if times is None else times, path or own,
        truth.offset_s if offset_s is None else offset_s, truth.rate, 15.0, RegisterSettings(**settings), 0,
    )  # fmt: skip


def test_the_pose_of_a_third_camera_is_found(known):
    found = attempt(known)
    pose, truth = found.camera_from_world, known[3].camera_from_world
    assert np.linalg.norm(so3_log(pose.rotation @ truth.rotation.T)) < 1e-3
    np.testing.assert_allclose(pose.centre, truth.centre, rtol=0, atol=0.1)  # some 80 m away
    assert found.reason == ""
    assert found.inlier_s == pytest.approx(found.common_s)
    assert found.common_s == pytest.approx(len(known[2]) / 15, abs=1.0)


def test_the_unit_and_origin_of_the_world_do_not_matter(known):
    two, *_ = known
    scale, shift = 1e-3, np.array([1e3, -2e3, 5e2])
    tiny = dataclasses.replace(two, control=scale * two.control + shift)
    found = attempt(known, scene=tiny).camera_from_world
    np.testing.assert_allclose((found.centre - shift) / scale, known[3].camera_from_world.centre, rtol=0, atol=0.1)


def test_outliers_are_outvoted(known, rng):
    own = known[1]
    broken = np.array(own.coefficients)
    wrong = rng.uniform(size=broken.shape[1]) < 0.3
    broken[3, wrong] += rng.uniform(-0.4, 0.4, (int(wrong.sum()), 2))
    found = attempt(known, path=dataclasses.replace(own, coefficients=broken))
    np.testing.assert_allclose(found.camera_from_world.centre, known[3].camera_from_world.centre, rtol=0, atol=0.3)
    assert 0.5 < found.inlier_s / found.common_s < 0.9


def test_too_little_in_common_is_said(known):
    found = attempt(known, times=known[2][:30])
    assert found.camera_from_world is None
    assert found.common_s == pytest.approx(2.0)
    assert found.reason == "it sees only 2.0 s of the trajectory the other cameras support"
    far = attempt(known, offset_s=known[3].offset_s + 1000)
    assert far.camera_from_world is None
    assert far.common_s == 0


def test_a_camera_that_agrees_with_no_pose_is_refused(known, rng):
    own = known[1]
    noise = np.array(own.coefficients)
    noise[:3] = 0
    noise[3] = rng.uniform(-0.5, 0.5, noise[3].shape)
    found = attempt(known, path=dataclasses.replace(own, coefficients=noise))
    assert found.camera_from_world is None
    assert "pose explains" in found.reason
    strict = attempt(known, min_inlier_share=1.01)
    assert strict.camera_from_world is None
    assert strict.inlier_s > 10
    assert strict.reason.startswith("its best pose explains only")


def test_a_scene_without_trajectory_is_a_mistake(known):
    two = known[0]
    with pytest.raises(ValueError, match="expected a fitted trajectory"):
        attempt(known, scene=Scene(two.reference, two.cameras))


def test_the_pose_is_a_rigid_motion(known):
    assert isinstance(attempt(known).camera_from_world, Rigid)
