"""The 3D picture stands upright whatever frame the world has and however the cameras are held."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_scene import DOWN, look_at, make_reconstruction

from skytrace.geometry.rigid import Rigid, Similarity, so3_exp
from skytrace.model.reconstruction import Reconstruction
from skytrace.report.picture import frustum_lines, picture_from_world, up_in_world


def with_poses(poses: list[Rigid]) -> Reconstruction:
    whole = make_reconstruction([f"cam{i}" for i in range(len(poses))], duration_s=2.0, n_segments=1)
    cameras = {
        camera_id: replace(camera, camera_from_world=pose)
        for (camera_id, camera), pose in zip(whole.cameras.items(), poses, strict=True)
    }
    return Reconstruction("cam0", cameras, whole.trajectory)


def on_an_arc(n: int, arc_rad: float, tilt: float) -> list[Rigid]:
    poses = []
    for angle in np.linspace(0, arc_rad, n):
        centre = np.array([np.sin(angle), 0.0, -np.cos(angle)])
        poses.append(look_at(centre, np.array([0.0, -tilt, 0.0])))
    return poses


def roll(pose: Rigid, angle_rad: float) -> Rigid:
    return Rigid.from_centre(so3_exp(np.array([0, 0, angle_rad])) @ pose.rotation, pose.centre)


def angle_deg(a, b) -> float:
    return float(np.degrees(np.arccos(np.clip(np.dot(a, b), -1, 1))))


@given(st.tuples(*[st.floats(-3, 3)] * 3), st.floats(0.0, 1.0))
def test_up_is_found_in_any_world_from_tilted_cameras(omega_rad, tilt):
    turn = Similarity(1.0, so3_exp(np.array(omega_rad)), np.zeros(3))
    poses = [turn.apply_to_pose(pose) for pose in on_an_arc(4, 2.0, tilt)]
    assert angle_deg(up_in_world(with_poses(poses)), turn.rotation @ -DOWN) < 2.0


def test_one_phone_on_edge_does_not_tip_the_picture_over(rng):
    poses = on_an_arc(5, 2.5, 0.4)
    poses[2] = roll(poses[2], np.pi / 2)
    poses = [roll(pose, rng.normal(0, 0.02)) for pose in poses]
    assert angle_deg(up_in_world(with_poses(poses)), -DOWN) < 5.0


def test_parallel_cameras_fall_back_on_their_own_up():
    poses = [Rigid.from_centre(np.eye(3), np.array([x, 0.0, 0.0])) for x in (0.0, 1.0, 2.0)]
    assert angle_deg(up_in_world(with_poses(poses)), [0, -1, 0]) < 1e-6


def test_cameras_that_contradict_each_other_leave_the_reference_to_decide():
    poses = [Rigid.identity(), roll(Rigid.identity(), np.pi)]
    assert angle_deg(up_in_world(with_poses(poses)), [0, -1, 0]) < 1e-6


def test_picture_looks_along_the_reference_camera_and_keeps_lengths():
    reconstruction = make_reconstruction()
    picture = picture_from_world(reconstruction)
    forward = reconstruction.cameras["cam0"].camera_from_world.rotation[2]
    seen = picture.apply(forward)
    assert seen[0] == pytest.approx(0, abs=1e-9)
    assert seen[1] > 0.8
    assert seen[2] > 0.1  # it is tilted upwards
    assert angle_deg(picture.apply(-DOWN), [0, 0, 1]) < 2.0


def test_picture_of_a_camera_that_looks_straight_up_has_a_forward_direction():
    straight_up = Rigid(np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]), np.zeros(3))
    picture = picture_from_world(with_poses([straight_up, *on_an_arc(5, 2.5, 0.1)]))
    assert angle_deg(picture.apply(-DOWN), [0, 0, 1]) < 15.0


def test_frustum_corners_project_onto_the_corners_of_the_image():
    camera = make_reconstruction().cameras["cam1"]
    lines = frustum_lines(camera.camera_from_world, camera.refined, depth=0.5)
    in_camera = camera.camera_from_world.apply(lines[:4])
    np.testing.assert_allclose(in_camera[:, 2], 0.5)
    width, height = camera.refined.size_px
    corners = [[0, 0], [width, 0], [width, height], [0, height]]
    np.testing.assert_allclose(camera.refined.project(in_camera), corners, atol=1e-6)
