"""Whole simulated flights: the truth explains the recordings, and they are plausible."""

from __future__ import annotations

import dataclasses
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skytrace.simulation import Scenario, presets, simulate

SHORT = Scenario(duration_s=20.0)


def run(scenario, seed=0):
    return simulate(scenario, np.random.default_rng(seed))


def each_camera(flight):
    for recording in flight.recordings:
        (track,) = recording.tracks
        camera_id = recording.camera_id
        yield recording, track, flight.truth.cameras[camera_id], flight.truth.detections[camera_id]


def reprojected(flight, camera, time_s):
    point = camera.camera_from_world.apply(flight.truth.motion.position(time_s))
    return camera.intrinsics.project(point)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    motion=st.sampled_from(["smooth", "spline", "hover", "hover_legs", "straight", "legs", "turns", "climbs"]),
    layout=st.sampled_from(["ring", "line", "coincident"]),
    n_cameras=st.integers(2, 12),
    speed=st.floats(1, 30),
    readout=st.floats(0, 1),
    distortion=st.floats(0, 1.5),
    reference_clock=st.booleans(),
)
def test_noise_free_observations_obey_the_model(
    seed, motion, layout, n_cameras, speed, readout, distortion, reference_clock
):
    scenario = Scenario(
        motion=motion,
        camera_layout=layout,
        n_cameras=n_cameras,
        speed_m_s=speed,
        readout_fraction=readout,
        distortion=distortion,
        reference_clock=reference_clock,
        duration_s=10.0,
        # Late in a long recording one unit in the last place of a time alone moves a fast target by 1e-10 px.
        offset_range_s=5.0,
        noise_px=0.0,
    )
    flight = run(scenario, seed)
    assert sum(len(track) for _, track, *_ in each_camera(flight)) > 0
    assert_model_holds(flight)


def assert_model_holds(flight):
    for _, track, camera, truth in each_camera(flight):
        time_s = camera.clock.world_time(track.frame, track.xy_px[:, 1])
        np.testing.assert_allclose(reprojected(flight, camera, time_s), track.xy_px, rtol=0, atol=1e-10)
        np.testing.assert_array_equal(truth.xy_px, track.xy_px)
        np.testing.assert_allclose(truth.time_s, time_s, rtol=0, atol=1e-12)
        assert camera.intrinsics.undistort(track.xy_px)[1].all()
        width, height = camera.intrinsics.size_px
        assert ((track.xy_px >= 0) & (track.xy_px <= [width - 1, height - 1])).all()
        assert (track.frame >= 0).all()
        motion = flight.truth.motion
        assert ((time_s >= motion.begin_s) & (time_s <= motion.end_s)).all()


@pytest.mark.parametrize("name", ["noise_free_spline", "noise_free_smooth"])
def test_noise_free_presets_obey_the_model_minutes_into_the_recording(name):
    flight = run(presets[name])
    assert flight.truth.motion.begin_s > 60
    assert_model_holds(flight)


def test_rolling_shutter_is_visible_in_the_measurements():
    """Without it, the model check above could not fail on a simulator that ignores the row."""
    flight = run(dataclasses.replace(presets["noise_free_smooth"], speed_m_s=15.0))
    for _, track, camera, _ in each_camera(flight):
        middle = camera.clock.world_time(track.frame, np.array(0.5 * camera.intrinsics.height_px))
        assert np.abs(reprojected(flight, camera, middle) - track.xy_px).max() > 0.3


def test_variable_frame_rate_moves_exposures_and_time_stamps_alike():
    scenario = dataclasses.replace(SHORT, variable_frame_rate=0.3, timestamps=True, noise_px=0.0)
    flight = run(scenario)
    for recording, track, camera, truth in each_camera(flight):
        np.testing.assert_allclose(reprojected(flight, camera, truth.time_s), track.xy_px, rtol=0, atol=1e-9)
        regular = camera.clock.world_time(track.frame, track.xy_px[:, 1])
        deviation = (truth.time_s - regular) / camera.clock.period_s
        assert 0.1 < np.std(deviation) < 0.6
        assert track.time_s is not None
        stamped = camera.clock.world_time(track.time_s * recording.frame_rate_hz, track.xy_px[:, 1])
        np.testing.assert_allclose(stamped, truth.time_s, rtol=0, atol=1e-9)
    assert all(track.time_s is None for _, track, *_ in each_camera(run(SHORT)))


def test_a_sinking_frame_rate_and_dropped_frames_leave_the_numbering_without_gaps():
    scenario = dataclasses.replace(
        SHORT, rate_swing=0.5, dropped_frames=0.1, timestamps=True, noise_px=0.0, dropout_fraction=0.0
    )
    flight = run(scenario)
    for recording, track, camera, truth in each_camera(flight):
        np.testing.assert_allclose(reprojected(flight, camera, truth.time_s), track.xy_px, rtol=0, atol=1e-9)
        assert track.time_s is not None
        stamped = camera.clock.world_time(track.time_s * recording.frame_rate_hz, track.xy_px[:, 1])
        np.testing.assert_allclose(stamped, truth.time_s, rtol=0, atol=1e-9)
        step = np.diff(track.time_s)[np.diff(track.frame) == 1] * recording.frame_rate_hz
        assert step.min() >= 1 - 1e-9
        assert 1.05 < step.mean() < 2.4  # between 1 and 2 for the swing, over 0.9 for what was dropped
        assert step.max() > 1.9  # a dropped frame
        exposures = flight.truth.exposures[recording.camera_id]
        np.testing.assert_array_equal(np.diff(exposures.frame), 1)


def test_same_seed_same_flight_and_other_seed_another():
    a, b, c = run(presets["cluttered"], 3), run(presets["cluttered"], 3), run(presets["cluttered"], 4)
    for (_, track_a, camera_a, truth_a), (_, track_b, camera_b, truth_b) in zip(
        each_camera(a), each_camera(b), strict=True
    ):
        np.testing.assert_array_equal(track_a.frame, track_b.frame)
        np.testing.assert_array_equal(track_a.xy_px, track_b.xy_px)
        np.testing.assert_array_equal(truth_a.is_outlier, truth_b.is_outlier)
        assert camera_a.clock == camera_b.clock
    assert len(a.recordings[0].tracks[0]) != len(c.recordings[0].tracks[0])


def test_noise_changes_nothing_but_the_measurements():
    clean, noisy = run(dataclasses.replace(SHORT, noise_px=0.0)), run(dataclasses.replace(SHORT, noise_px=2.0))
    for (_, _, camera_a, truth_a), (_, _, camera_b, truth_b) in zip(
        each_camera(clean), each_camera(noisy), strict=True
    ):
        np.testing.assert_array_equal(camera_a.camera_from_world.translation, camera_b.camera_from_world.translation)
        # Noise may push a detection at the border out of the image, no more.
        assert len(truth_b.time_s) > 0.99 * len(truth_a.time_s)
        assert np.isin(truth_b.time_s, truth_a.time_s).all()


def test_cameras_that_watch_a_part_overlap_as_little_as_asked():
    flight = run(Scenario(n_cameras=2, watched_fraction=0.6, duration_s=100.0))
    motion = flight.truth.motion
    first, last = (truth.time_s - motion.begin_s for *_, truth in each_camera(flight))
    assert first.min() < 1
    assert last.max() > 99
    assert 59.9 < first.max() <= 60
    assert 40 <= last.min() < 40.1


@pytest.mark.parametrize("seed", range(5))
def test_demo_is_seen_well_enough_for_blind_synchronisation(seed):
    flight = run(presets["demo"], seed)
    motion = flight.truth.motion
    cells = np.zeros((4, int(4 * (motion.end_s - motion.begin_s))), bool)
    for k, (recording, track, _, truth) in enumerate(each_camera(flight)):
        seen_s = truth.time_s[~truth.is_outlier] - motion.begin_s
        cells[k, np.clip((4 * seen_s).astype(int), 0, cells.shape[1] - 1)] = True
        step = np.linalg.norm(np.diff(truth.xy_px, axis=0), axis=1)[np.diff(track.frame) == 1]
        assert 15 < np.nanmedian(step) * recording.frame_rate_hz < 800
        # The target crosses a good part of the image, or there is no geometry to see.
        assert (np.nanmax(truth.xy_px, axis=0) - np.nanmin(truth.xy_px, axis=0) > 0.15 * track.xy_px.max(0)).all()
    assert np.mean(cells.sum(0) >= 3) >= 0.6
    frames_apart = [abs(camera.clock.offset_s) for *_, camera, _ in each_camera(flight)]
    assert max(frames_apart) > 5


@pytest.mark.parametrize("name", sorted(presets))
def test_every_preset_gives_a_recording_per_camera(name):
    scenario = dataclasses.replace(presets[name], duration_s=min(presets[name].duration_s, 30.0))
    flight = run(scenario, 1)
    assert [r.camera_id for r in flight.recordings] == list(flight.truth.cameras) == list(scenario.camera_ids)
    assert all(len(track) > 100 for _, track, *_ in each_camera(flight))


def test_synchronisation_maps_simultaneous_frames():
    flight = run(Scenario(clock_drift=1e-3))
    truth = flight.truth
    reference = truth.cameras[truth.reference].clock
    frame = np.array([0.0, 1000.0, 5000.0])
    world_s = reference.world_time(frame, np.array(0.5 * reference.height_px))
    for camera_id, camera in truth.cameras.items():
        slope, intercept = truth.synchronisation(camera_id)
        expected = camera.clock.frame_at(world_s, np.array(0.5 * camera.clock.height_px))
        np.testing.assert_allclose(slope * frame + intercept, expected, rtol=0, atol=1e-8)
    assert truth.synchronisation(truth.reference) == (1.0, 0.0)


def test_simulation_is_fast():
    begin = time.process_time()
    run(presets["demo"])
    assert time.process_time() - begin < 0.3
