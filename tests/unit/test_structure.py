"""Triangulation of a whole scene on common times, and the spline through it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from skytrace.errors import ReconstructionError
from skytrace.estimation.correspond import ImagePath, image_path
from skytrace.estimation.scene import N_LENS, CameraState, Scene
from skytrace.estimation.structure import Structure, StructureSettings, fit_structure, triangulate_scene, world_rays
from skytrace.simulation import Scenario, simulate
from skytrace.simulation.cameras import look_at

SETTINGS = StructureSettings()


def three_cameras():
    scenario = Scenario(duration_s=20.0, n_cameras=3, noise_px=0.0, focal_error=0.0, speed_m_s=4.0, clock_drift=2e-4)
    return simulate(scenario, np.random.default_rng(3))


@pytest.fixture(scope="module")
def flight():
    return three_cameras()


def true_scene(flight):
    cameras, paths = {}, {}
    for r in flight.recordings:
        camera = flight.truth.cameras[r.camera_id]
        rate = camera.clock.period_s * r.frame_rate_hz
        cameras[r.camera_id] = CameraState(
            camera.camera_from_world, camera.clock.offset_s, rate, camera.clock.readout_s, np.zeros(N_LENS)
        )
        # The path takes up the readout delay in camera time.
        paths[r.camera_id] = image_path(r, camera.clock.readout_s / rate * r.frame_rate_hz)
    return Scene("cam0", cameras), paths


def test_true_cameras_triangulate_the_true_path(flight):
    scene, paths = true_scene(flight)
    found = triangulate_scene(scene, paths, SETTINGS)
    assert len(found.time_s) > 270  # nearly all of 20 s at 15 Hz
    np.testing.assert_allclose(found.time_s * 15, np.rint(found.time_s * 15), rtol=0, atol=1e-7)
    truth = flight.truth.motion.position(found.time_s)
    np.testing.assert_allclose(found.point_in_world, truth, rtol=0, atol=1e-3)
    assert found.inlier.sum(axis=1).min() >= 2
    assert found.inlier.shape == (len(found.time_s), 3)
    for name in ("angle_rad", "sigma"):
        assert getattr(found, name).shape == found.time_s.shape
    assert (found.angle_rad >= SETTINGS.min_angle_rad).all()


def test_the_order_of_cameras_does_not_hide_what_the_last_one_missed(flight):
    """Cameras' clocks differ by minutes: each one's span counts on its own."""
    scene, paths = true_scene(flight)
    whole = triangulate_scene(scene, paths, SETTINGS)
    late = paths["cam2"]
    pieces = len(late.breaks_s) // 4
    short = {**paths, "cam2": ImagePath(late.breaks_s[: pieces + 1], late.coefficients[:, :pieces])}
    found = triangulate_scene(scene, short, SETTINGS)
    assert found.time_s[-1] == pytest.approx(whole.time_s[-1], abs=1.0)


def test_rays_point_at_the_target_where_the_camera_sees_it(flight):
    scene, paths = true_scene(flight)
    motion = flight.truth.motion
    t = np.linspace(motion.begin_s - 5, motion.end_s + 5, 100)
    ray = world_rays(scene, "cam1", paths["cam1"], t)
    np.testing.assert_allclose(np.linalg.norm(ray, axis=1)[np.isfinite(ray[:, 0])], 1, rtol=0, atol=1e-12)
    outside = (t < motion.begin_s) | (t > motion.end_s + 0.05)
    assert np.isnan(ray[outside]).all()
    direction = motion.position(t) - scene.cameras["cam1"].camera_from_world.centre
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    seen = np.isfinite(ray[:, 0])
    assert seen.sum() > 50
    np.testing.assert_allclose(ray[seen], direction[seen], rtol=0, atol=1e-5)


def test_expected_deviations_grow_with_distance_and_shrink_with_the_angle(flight):
    scene, paths = true_scene(flight)
    two = Scene("cam0", {c: scene.cameras[c] for c in ("cam0", "cam1")})
    found = triangulate_scene(two, paths, SETTINGS)
    centre = np.stack([two.cameras[c].camera_from_world.centre for c in two.cameras])
    distance = np.linalg.norm(found.point_in_world[:, None] - centre, axis=2)
    np.testing.assert_allclose(found.sigma, distance.max(axis=1) / np.sin(found.angle_rad), rtol=1e-6)


def test_a_camera_with_a_wrong_clock_is_outvoted(flight):
    scene, paths = true_scene(flight)
    late = dataclasses.replace(scene.cameras["cam2"], offset_s=scene.cameras["cam2"].offset_s + 3.0)
    found = triangulate_scene(scene.with_camera("cam2", late), paths, SETTINGS)
    truth = flight.truth.motion.position(found.time_s)
    agree = found.inlier[:, 0] & found.inlier[:, 1] & ~found.inlier[:, 2]
    assert agree.mean() > 0.7
    np.testing.assert_allclose(found.point_in_world[agree], truth[agree], rtol=0, atol=1e-3)


def test_the_spline_follows_the_points(flight):
    scene, paths = true_scene(flight)
    found = triangulate_scene(scene, paths, SETTINGS)
    fitted = fit_structure(scene, found, SETTINGS)
    assert scene.grid is None
    assert fitted.cameras == scene.cameras
    t = np.linspace(found.time_s[0], found.time_s[-1], 500)
    error = fitted.grid.evaluate(fitted.control, t) - flight.truth.motion.position(t)
    assert np.abs(error).max() < 0.02


def test_without_points_there_is_no_trajectory(flight):
    scene, _ = true_scene(flight)
    nothing = Structure(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3), bool), np.zeros(0), np.zeros(0))
    with pytest.raises(ReconstructionError, match="no stretch of the flight can be triangulated") as caught:
        fit_structure(scene, nothing, SETTINGS)
    assert caught.value.stage == "triangulate"
    assert caught.value.hint


def test_a_third_camera_fixes_what_two_that_face_each_other_leave_open():
    still = np.zeros((4, 1, 2))
    cameras, paths = {}, {}
    point = np.array([0.0, 0.02, 0.0])
    for k, centre in enumerate(np.array([[-50.0, 0.0, 0.0], [50.0, 0.0, 0.0], [0.0, -50.0, 0.0]])):
        pose = look_at(centre, np.zeros(3))
        x, y, z = pose.apply(point)
        constant = still.copy()
        constant[3] = [x / z, y / z]
        cameras[f"cam{k}"] = CameraState(pose, 0.0, 1.0, 0.0, np.zeros(N_LENS))
        paths[f"cam{k}"] = ImagePath(np.array([0.0, 2.0]), constant)
    found = triangulate_scene(Scene("cam0", cameras), paths, SETTINGS)
    np.testing.assert_allclose(found.point_in_world, np.tile(point, (len(found.time_s), 1)), rtol=0, atol=1e-6)
    assert (found.sigma < 100).all()
