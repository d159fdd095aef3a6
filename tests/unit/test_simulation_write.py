"""A written flight is a complete FLIGHT folder that reads back as simulated, with its truth."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from skytrace.errors import InputError
from skytrace.io.flight import read_flight
from skytrace.io.truth import (
    read_true_orientations,
    read_true_positions,
    read_true_synchronisation,
    read_truth_trajectory,
)
from skytrace.simulation import Scenario, presets, simulate, write_flight

SHORT = Scenario(duration_s=20.0)


def run(scenario, seed=0):
    return simulate(scenario, np.random.default_rng(seed))


def each_camera(flight):
    for recording in flight.recordings:
        (track,) = recording.tracks
        camera_id = recording.camera_id
        yield recording, track, flight.truth.cameras[camera_id], flight.truth.detections[camera_id]


@pytest.mark.parametrize("name", ["demo", "phones"])
def test_written_folder_reads_back_whole(tmp_path, name):
    simulated = run(dataclasses.replace(presets[name], duration_s=20.0))
    folder = write_flight(simulated, tmp_path / "flight", rate_hz=10.0)
    flight = read_flight(folder)
    assert flight.truth is not None
    assert flight.truth.rate_hz == 10.0
    for camera, (recording, track, truth, _) in zip(flight.cameras, each_camera(simulated), strict=True):
        assert camera.camera_id == recording.camera_id
        assert camera.frame_rate_hz == recording.frame_rate_hz
        np.testing.assert_array_equal(camera.intrinsics.focal_px, truth.calibrated.focal_px)
        np.testing.assert_array_equal(camera.intrinsics.distortion, truth.intrinsics.distortion)
        assert camera.intrinsics.size_px == truth.intrinsics.size_px
        np.testing.assert_array_equal(camera.detections.frame, track.frame)
        np.testing.assert_allclose(camera.detections.xy_px, track.xy_px, rtol=0, atol=1e-7)
        if track.time_s is None:
            assert camera.detections.time_s is None
        else:
            np.testing.assert_allclose(camera.detections.time_s, track.time_s, rtol=0, atol=1e-8)
    _check_truth(simulated, flight.truth, folder)


def _check_truth(simulated, written, folder):
    truth, motion = simulated.truth, simulated.truth.motion
    trajectory = read_truth_trajectory(written.trajectory)
    assert trajectory.time_s is None
    expected = motion.position(motion.begin_s + np.arange(201) / 10.0)
    np.testing.assert_allclose(trajectory.position_m, expected, rtol=0, atol=1e-8)
    positions = read_true_positions(written.positions)
    synchronisation = read_true_synchronisation(written.synchronisation)
    orientations = read_true_orientations(written.orientations)
    cameras = json.loads((folder / "truth" / "cameras.json").read_text())
    scenario = json.loads((folder / "truth" / "scenario.json").read_text())
    assert scenario["n_cameras"] == simulated.scenario.n_cameras
    assert cameras["reference"] == truth.reference
    for camera_id, camera in truth.cameras.items():
        np.testing.assert_array_equal(positions[camera_id], camera.camera_from_world.centre)
        np.testing.assert_array_equal(orientations[camera_id], camera.camera_from_world.rotation)
        assert synchronisation[camera_id] == truth.synchronisation(camera_id)
        assert cameras["cameras"][camera_id]["clock"]["offset_s"] == camera.clock.offset_s
        np.testing.assert_array_equal(cameras["cameras"][camera_id]["focal_px"], camera.intrinsics.focal_px)


def test_writing_refuses_what_it_would_overwrite(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="not empty"):
        write_flight(run(SHORT), tmp_path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["notes.txt"]


def test_writing_refuses_a_rate_without_meaning(tmp_path):
    with pytest.raises(ValueError, match="rate_hz"):
        write_flight(run(SHORT), tmp_path / "flight", rate_hz=0.0)
    assert not (tmp_path / "flight").exists()
