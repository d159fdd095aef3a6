"""The first pair of cameras: chosen by evidence, or refused for the degeneracy that it is."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from skytrace.errors import ReconstructionError
from skytrace.estimation.clean import CleanSettings, clean_detections
from skytrace.estimation.correspond import image_path
from skytrace.estimation.initialize import InitialSettings, flight_extent, initial_pairs, rotation_share
from skytrace.estimation.structure import Structure, StructureSettings
from skytrace.estimation.synchronize import Synchronisation
from skytrace.estimation.two_view import Correspondences
from skytrace.geometry.rigid import Rigid, align_similarity, so3_exp
from skytrace.model.reconstruction import TwoView
from skytrace.simulation import Scenario, simulate

BASE = Scenario(duration_s=30.0, n_cameras=2, noise_px=0.2, focal_error=0.0, readout_fraction=0.6, clock_drift=0.0)


def starting_point(scenario, seed=2, pairs=None):
    """A simulated flight with its true clocks and rough poses, as the synchronisation would hand them over."""
    flight = simulate(scenario, np.random.default_rng(seed))
    recordings, paths, clocks = {}, {}, {}
    for r in flight.recordings:
        (track,) = r.tracks
        cleaned = clean_detections(track.frame, track.xy_px, r.frame_rate_hz, r.intrinsics.size_px, CleanSettings())
        recordings[r.camera_id] = dataclasses.replace(r, tracks=cleaned.tracklets)
        paths[r.camera_id] = image_path(recordings[r.camera_id], 0.6)
        clock = flight.truth.cameras[r.camera_id].clock
        clocks[r.camera_id] = (clock.offset_s, clock.period_s * r.frame_rate_hz)
    views = []
    for a, b in pairs or [("cam0", "cam1")]:
        ca, cb = (flight.truth.cameras[c].camera_from_world for c in (a, b))
        pose = cb @ ca.inverse()
        length = np.linalg.norm(pose.translation)
        baseline = pose.translation / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])
        rough = Rigid(so3_exp(np.array([0.01, -0.01, 0.01])) @ pose.rotation, baseline)
        # Offset and rate of the pair are of no account: the joint clocks stand.
        views.append(TwoView(a, b, rough, 0.0, 1.0, 30.0, 10.0))
    return flight, Synchronisation("cam0", clocks, tuple(views), np.zeros(len(views)), {}), paths, recordings


def choose(synchronisation, paths, recordings, **settings):
    return initial_pairs(synchronisation, paths, recordings, InitialSettings(**settings), StructureSettings(), 0.6)


def test_a_good_pair_gives_poses_and_points():
    flight, *rest = starting_point(BASE)
    (pair,) = choose(*rest)
    scene = pair.scene
    assert scene.reference == "cam0"
    assert set(scene.cameras) == {"cam0", "cam1"}
    first, second = scene.cameras["cam0"], scene.cameras["cam1"]
    np.testing.assert_array_equal(first.camera_from_world.rotation, np.eye(3))
    np.testing.assert_array_equal(first.camera_from_world.translation, 0)
    assert np.linalg.norm(second.camera_from_world.centre) == pytest.approx(1)
    for camera_id, camera in scene.cameras.items():
        true = flight.truth.cameras[camera_id].clock
        assert camera.offset_s == true.offset_s
        assert camera.readout_s == pytest.approx(0.6 / flight.truth.cameras[camera_id].frame_rate_hz)
        assert not camera.lens.any()
    found = pair.structure
    truth = flight.truth.motion.position(found.time_s)
    aligned = align_similarity(found.point_in_world, truth).apply(found.point_in_world)
    assert np.median(np.linalg.norm(aligned - truth, axis=1)) < 0.2
    # Seconds of triangulated flight, the parallax being better than needed.
    assert pair.score == pytest.approx(len(found.time_s) / 15, rel=1e-6)
    assert pair.score > 25


def test_the_pair_with_more_parallax_and_time_comes_first():
    couples = [("cam0", "cam1"), ("cam0", "cam2"), ("cam1", "cam2")]
    _, synchronisation, paths, recordings = starting_point(dataclasses.replace(BASE, n_cameras=3), pairs=couples)
    found = choose(synchronisation, paths, recordings, good_angle_rad=3.0)
    assert len(found) == 3
    scores = [p.score for p in found]
    assert scores == sorted(scores, reverse=True)
    for p in found:
        expected = len(p.structure.time_s) / 15 * np.median(p.structure.angle_rad) / 3.0
        assert p.score == pytest.approx(expected)
    assert scores[0] > 1.05 * scores[-1]


@pytest.mark.parametrize(
    ("scenario", "words"),
    [
        (dataclasses.replace(BASE, motion="hover"), "hardly moves"),
        (dataclasses.replace(BASE, camera_layout="coincident"), "same direction"),
        (dataclasses.replace(BASE, motion="straight", speed_m_s=4.0, extent_m=120.0), "straight line"),
        (dataclasses.replace(BASE, duration_s=5.0), "enough common view"),
    ],
)
def test_degenerate_flights_are_named(scenario, words):
    _, *rest = starting_point(scenario)
    with pytest.raises(ReconstructionError, match=words) as caught:
        choose(*rest)
    error = caught.value
    assert error.stage == "initialise"
    assert error.hint
    assert error.threshold is not None
    assert all(name.startswith("cam0-cam1 ") for name in error.counts)
    assert len(error.counts) == 1


def test_one_sound_pair_is_enough():
    couples = [("cam0", "cam1"), ("cam0", "cam2"), ("cam1", "cam2")]
    scenario = dataclasses.replace(BASE, n_cameras=3, camera_layout="coincident")  # the first two in one place
    _, synchronisation, paths, recordings = starting_point(scenario, pairs=couples)
    found = choose(synchronisation, paths, recordings)
    assert sorted(tuple(p.scene.cameras) for p in found) == [("cam0", "cam2"), ("cam1", "cam2")]


def test_no_pairs_at_all_is_said():
    with pytest.raises(ReconstructionError, match="enough common view"):
        choose(Synchronisation("cam0", {}, (), np.zeros(0), {}), {}, {})


def test_the_pose_is_that_of_the_joint_clocks():
    """A clock that is one in a thousand off its nominal rate (29.97 for 30 frames a second) is known here already."""
    exact = dataclasses.replace(BASE, noise_px=0.0, frame_rates_hz=(60.0,), clock_drift=1e-3, readout_fraction=0.0,
                                duration_s=60.0, speed_m_s=4.0)  # fmt: skip
    flight, synchronisation, _, recordings = starting_point(exact, seed=1)
    paths = {c: image_path(r, 0.0) for c, r in recordings.items()}
    (pair,) = choose(synchronisation, paths, recordings)
    a, b = (c.camera_from_world for c in flight.truth.cameras.values())
    true = b @ a.inverse()
    found = pair.scene.cameras["cam1"].camera_from_world
    assert np.abs(found.rotation - true.rotation).max() < 1e-5
    assert np.abs(found.translation - true.translation / np.linalg.norm(true.translation)).max() < 1e-5


def test_flight_extent_is_second_over_first():
    rng = np.random.default_rng(0)

    def extent(axes):
        points = rng.uniform(-1, 1, (2000, 3)) * axes
        points[:10] *= 50  # outliers
        n = len(points)
        return flight_extent(Structure(np.arange(n), points, np.ones((n, 2), bool), np.ones(n), np.ones(n)))

    assert extent([1.0, 1.0, 1.0]) == pytest.approx(1.0, abs=0.1)
    assert extent([10.0, 1.0, 0.1]) == pytest.approx(0.1, abs=0.02)
    assert extent([10.0, 0.01, 0.0]) < 0.002


def test_rotation_share_tells_turned_cameras_from_moved_ones(rng):
    n = 200
    point = np.column_stack([rng.uniform(-3, 3, (n, 2)), rng.uniform(5, 12, n)])
    t = np.arange(float(n))

    def pairs(pose):
        moved = pose.apply(point)
        xy0, xy1 = point[:, :2] / point[:, 2:], moved[:, :2] / moved[:, 2:]
        return Correspondences(t, t, xy0, xy1, np.zeros((n, 2)))

    rotation = so3_exp(np.array([0.05, -0.2, 0.1]))
    turned = Rigid(rotation, 1e-6 * np.array([1.0, 0.0, 0.0]))
    moved = Rigid.from_centre(rotation, np.array([1.0, 0.2, 0.0]))
    assert rotation_share(pairs(turned), Rigid(rotation, np.array([1.0, 0.0, 0.0])), 0.009) > 0.95
    assert rotation_share(pairs(moved), moved, 0.009) < 0.3
    few = Correspondences(t[:9], t[:9], *(np.zeros((9, 2)),) * 3)
    assert rotation_share(few, moved, 0.009) == 0.0
