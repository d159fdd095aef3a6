"""Cameras stand, look and keep time as the scenario says, and observations obey the rolling-shutter model exactly."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from skytrace.geometry.projection import one_to_one_radius
from skytrace.geometry.rigid import Rigid
from skytrace.model.camera import Clock, Intrinsics
from skytrace.simulation.cameras import camera_centres, draw_cameras, draw_clocks, draw_lens, look_at
from skytrace.simulation.flight import build_motion
from skytrace.simulation.observe import observe
from skytrace.simulation.scenario import Scenario


def test_ring_cameras_stand_around_the_field_at_eye_height():
    centres = camera_centres(Scenario(n_cameras=4), np.random.default_rng(0))
    assert ((centres[:, 2] >= 1) & (centres[:, 2] <= 2)).all()
    neighbours = np.linalg.norm(centres - np.roll(centres, 1, axis=0), axis=1)
    assert ((neighbours > 50) & (neighbours < 170)).all()


def test_special_layouts():
    rng = np.random.default_rng(1)
    pair = camera_centres(Scenario(camera_layout="coincident"), rng)
    np.testing.assert_array_equal(pair[0], pair[1])
    assert np.linalg.norm(pair[2] - pair[0]) > 20
    scenario = Scenario(camera_layout="line", n_cameras=12)
    line = camera_centres(scenario, rng)
    rays = np.array([0, 0, scenario.altitude_m]) - line
    distance = np.linalg.norm(rays, axis=1)
    np.testing.assert_allclose(rays / distance[:, None], np.broadcast_to(rays[0] / distance[0], rays.shape), atol=1e-12)
    assert (np.diff(distance) < -1).all()
    assert distance.min() > 20


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32), roll=st.floats(-0.5, 0.5))
def test_look_at_puts_the_target_on_the_axis_and_the_sky_up(seed, roll):
    rng = np.random.default_rng(seed)
    centre, target = rng.uniform(-100, 100, 3), rng.uniform(-100, 100, 3) * [1, 1, 0.1]
    pose = look_at(centre, target, roll)
    np.testing.assert_allclose(pose.centre, centre, atol=1e-10)
    np.testing.assert_allclose(pose.apply(target), [0, 0, np.linalg.norm(target - centre)], atol=1e-9)
    assert pose.apply(centre + np.array([0, 0, 1]))[1] < 0  # y points down


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    size=st.sampled_from([(1280, 720), (1920, 1080), (3840, 2160), (1440, 1080)]),
    strength=st.floats(0, 2),
)
def test_lenses_can_be_inverted_over_their_whole_image(seed, size, strength):
    lens = draw_lens(size, strength, np.random.default_rng(seed))
    grid = np.stack(np.meshgrid(np.linspace(0, size[0] - 1, 9), np.linspace(0, size[1] - 1, 7)), -1).reshape(-1, 2)
    xy_norm, inverted = lens.undistort(grid)
    assert inverted.all()
    np.testing.assert_allclose(lens.project(np.column_stack([xy_norm, np.ones(len(grid))])), grid, atol=1e-6)
    aspect = lens.focal_px[0] / lens.focal_px[1]
    assert aspect == pytest.approx(0.75 if size == (1440, 1080) else 1.0)


def test_one_to_one_radius_is_where_the_lens_folds():
    assert one_to_one_radius(np.zeros(5)) == np.inf
    distortion = np.array([-0.3, 0.05, 0, 0, -0.01])
    limit = one_to_one_radius(distortion)
    k1, k2, _, _, k3 = distortion

    def image_radius(r):
        return r * (1 + k1 * r**2 + k2 * r**4 + k3 * r**6)

    r = np.linspace(0, limit, 1000)
    assert (np.diff(image_radius(r)) > 0).all()
    assert image_radius(limit * 1.01) < image_radius(limit)


def test_reference_clock_is_world_time():
    scenario = Scenario(n_cameras=5, clock_drift=1e-3, offset_range_s=200)
    clocks, begin_s = draw_clocks(scenario, np.random.default_rng(2))
    assert clocks[0].offset_s == 0
    assert clocks[0].period_s == 1 / scenario.frame_rates_hz[0]
    assert 0 <= begin_s <= 200
    assert all(clock.offset_s <= begin_s for clock in clocks)  # everyone films before the flight begins
    assert max(abs(clock.offset_s) for clock in clocks) > 30
    for clock, rate in zip(clocks[1:], scenario.frame_rates_hz[1:], strict=True):
        assert 0 < abs(clock.period_s * rate - 1) < 5e-3
        assert clock.readout_s == pytest.approx(0.6 / rate)


def test_without_reference_clock_world_time_starts_with_the_flight():
    clocks, begin_s = draw_clocks(Scenario(reference_clock=False), np.random.default_rng(3))
    assert begin_s == 0
    assert clocks[0].offset_s < 0
    assert clocks[0].period_s != 1 / 29.97


def test_focal_error_is_one_scale_per_camera_and_nothing_else():
    scenario = Scenario(n_cameras=12, focal_error=0.02)
    clocks, _ = draw_clocks(scenario, np.random.default_rng(4))
    ratios = []
    for camera in draw_cameras(scenario, clocks, np.random.default_rng(5)):
        ratio = camera.calibrated.focal_px / camera.intrinsics.focal_px
        assert ratio[0] == pytest.approx(ratio[1])
        np.testing.assert_array_equal(camera.calibrated.distortion, camera.intrinsics.distortion)
        np.testing.assert_array_equal(camera.calibrated.principal_px, camera.intrinsics.principal_px)
        ratios.append(ratio[0])
    assert 0.008 < np.std(ratios) < 0.04
    exact = draw_cameras(dataclasses.replace(scenario, focal_error=0.0), clocks, np.random.default_rng(5))
    np.testing.assert_array_equal(exact[0].calibrated.focal_px, exact[0].intrinsics.focal_px)


def test_rolling_shutter_agrees_with_a_root_finder():
    scenario = Scenario(motion="climbs", speed_m_s=40, altitude_m=40, readout_fraction=1.0)
    clocks, begin_s = draw_clocks(scenario, np.random.default_rng(6))
    motion = build_motion(scenario, begin_s, np.random.default_rng(7))
    camera = draw_cameras(scenario, clocks, np.random.default_rng(8))[0]
    frame = np.arange(np.ceil(begin_s * 29.97), np.floor((begin_s + 60) * 29.97), 7)
    xy_px, time_s = observe(motion, camera.camera_from_world, camera.clock, camera.intrinsics, frame)
    seen = np.flatnonzero(np.isfinite(xy_px[:, 0]))
    assert len(seen) > 50
    for k in seen[:50]:

        def gap(row, k=k):
            t = camera.clock.world_time(frame[k : k + 1], np.array([row]))
            point = camera.camera_from_world.apply(motion.position(t))
            return camera.intrinsics.project(point)[0, 1] - row

        row = brentq(gap, xy_px[k, 1] - 20, xy_px[k, 1] + 20, xtol=1e-12)
        assert xy_px[k, 1] == pytest.approx(row, abs=1e-8)
        assert time_s[k] == pytest.approx(float(camera.clock.world_time(frame[k], np.array(row))), abs=1e-12)


class _Parked:
    """A target that stays in one place."""

    begin_s, end_s = 0.0, 10.0

    def __init__(self, place):
        self.place = np.asarray(place, float)

    def position(self, time_s):
        return np.tile(self.place, (len(time_s), 1))

    def velocity(self, time_s):
        return np.zeros((len(time_s), 3))


@pytest.mark.parametrize(
    ("place", "distortion", "seen"),
    [
        ([0, 0, 10], [0, 0, 0, 0, 0], True),
        ([0, 0, -10], [0, 0, 0, 0, 0], False),  # behind
        ([9, 0, 10], [0, 0, 0, 0, 0], False),  # beside the image
        ([5, 0, 10], [0, 0, 0, 0, 0], True),
        ([5, 0, 10], [-1.5, 0, 0, 0, 0], False),  # the lens folds at 0.47, the image would show it all the same
        ([8, 0, 10], [-1.5, 0, 0, 0, 1.2], False),  # beyond the fold, where the lens rises again
    ],
)
def test_only_what_the_camera_can_show_is_observed(place, distortion, seen):
    lens = Intrinsics(np.array([1000.0, 1000.0]), np.array([639.5, 359.5]), np.array(distortion), (1280, 720))
    xy_px, _ = observe(_Parked(place), Rigid.identity(), Clock(0.0, 0.04, 0.02, 720), lens, np.arange(3))
    assert np.isfinite(xy_px).all() == seen
    assert np.isfinite(xy_px).any() == seen
