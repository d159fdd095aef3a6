"""Simulated films: the target is where the truth says, row by row, and everything follows from the seed."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from skytrace.io.video import frame_times, open_video, read_frames
from skytrace.io.video_writer import TICKS_PER_S, VideoWriter
from skytrace.simulation import Scenario, presets, simulate, write_flight
from skytrace.simulation.filming import as_filmed, ticks
from skytrace.simulation.render import Film, Shot, render_videos
from skytrace.simulation.render_bodies import attitude, disc, multirotor
from skytrace.simulation.render_object import draw

SMALL = Scenario(duration_s=2.0, n_cameras=2, resolutions_px=((160, 120),), frame_rates_hz=(12.0, 15.0), speed_m_s=12.0)
# A sky without a cloud and a perfect sensor; as wide as a house, so that a small picture shows it as large as a drone.
PLAIN = Film(target_m=8.0, clouds=False, scenery=False, noise=0.0, exposure_drift=0.0)


def filmed(scenario, seed=0):
    return as_filmed(simulate(scenario, np.random.default_rng(seed)), TICKS_PER_S)


def shot_of(flight, film, camera_id="cam0", seed=0):
    truth = flight.truth
    camera, exposures = truth.cameras[camera_id], truth.exposures[camera_id]
    return Shot(camera, exposures, truth.motion, film, np.random.default_rng(seed))


def centroid(weight):
    y, x = np.mgrid[: weight.shape[0], : weight.shape[1]]
    return np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum()


def well_inside(shot, size_px):
    margin = 1.5 * shot.target.size_px[:, None]
    return np.flatnonzero(((shot.target.xy_px > margin) & (shot.target.xy_px < np.array(size_px) - margin)).all(1))


class TestPlace:
    @pytest.mark.parametrize(("size_px", "target_m"), [((160, 120), 2.0), ((160, 120), 8.0), ((640, 480), 8.0)])
    def test_centroid_is_the_truth(self, size_px, target_m):
        scenario = dataclasses.replace(SMALL, resolutions_px=(size_px,), readout_fraction=1.0)
        shot = shot_of(filmed(scenario), dataclasses.replace(PLAIN, target_m=target_m))
        frames = well_inside(shot, size_px)[::3]
        assert len(frames) >= 3
        clear = shot_of(filmed(scenario), dataclasses.replace(PLAIN, target_m=0.01)).scene(0)[0]
        for k in frames:
            shadow = clear.astype(float) - shot.scene(k)[0]
            shadow /= clear - 50.0  # covered share: the sky is brighter towards the horizon
            x, y = np.rint(shot.target.xy_px[k]).astype(int)
            reach = int(shot.target.size_px[k]) + 6
            window = np.zeros_like(shadow)
            window[max(0, y - reach) : y + reach, max(0, x - reach) : x + reach] = 1
            np.testing.assert_allclose(centroid(shadow * window), shot.target.xy_px[k], atol=0.02)

    def test_rows_and_times_agree_with_the_clock(self):
        flight = filmed(dataclasses.replace(SMALL, readout_fraction=1.0))
        truth = flight.truth
        for camera_id, camera in truth.cameras.items():
            target = shot_of(flight, PLAIN, camera_id).target
            seen = target.inside
            assert seen.any()
            beat, row = truth.exposures[camera_id].beat[seen], target.xy_px[seen, 1]
            np.testing.assert_allclose(target.time_s[seen], camera.clock.world_time(beat, row), atol=1e-9)
            position = camera.camera_from_world.apply(truth.motion.position(target.time_s[seen]))
            np.testing.assert_allclose(camera.intrinsics.project(position), target.xy_px[seen], atol=1e-6)

    def test_size_falls_with_distance(self):
        shot = shot_of(filmed(SMALL), PLAIN)
        camera = filmed(SMALL).truth.cameras["cam0"]
        point = camera.camera_from_world.apply(filmed(SMALL).truth.motion.position(shot.target.time_s))
        expected = 8.0 * np.sqrt(np.prod(camera.intrinsics.focal_px)) / point[:, 2]
        seen = shot.target.inside
        np.testing.assert_allclose(shot.target.size_px[seen], expected[seen], rtol=0.15)

    def test_a_target_that_is_leaving_is_still_half_there(self):
        flight = filmed(dataclasses.replace(SMALL, camera_distance=0.3, duration_s=6.0, extent_m=100.0))
        for camera_id in flight.truth.cameras:
            shot = shot_of(flight, PLAIN, camera_id)
            outside = np.flatnonzero(np.isfinite(shot.target.xy_px[:, 0]) & ~shot.target.inside)
            for k in outside:
                if (shot.target.size_px[k] > 6) and np.abs(shot.scene(k)[0] - shot._background(k)[0]).max() > 20:
                    return
        pytest.fail("no frame shows a part of a target whose centre is outside")


class TestDrawing:
    def draw_disc(self, velocity_px_s, readout_s, exposure_s=1e-6, diameter_px=24.0):
        picture = np.full((200, 300), 150.0, np.float32)
        look = disc(1.0, 50.0).seen(diameter_px * np.eye(2, 3))
        centre = np.array([150.3, 100.6])

        def path_px(time_s):
            return centre + np.outer(time_s, velocity_px_s)

        draw(picture, look, path_px, lambda row: (row - centre[1]) / 200 * readout_s, exposure_s, centre)
        return 150.0 - picture.astype(float), centre

    @pytest.mark.parametrize("speed_px_s", [0.0, 1500.0, -1500.0])
    def test_every_row_shows_its_own_time(self, speed_px_s):
        shadow, centre = self.draw_disc([speed_px_s, 0.0], readout_s=0.02)
        rows = np.arange(93, 109)
        x = (shadow[rows] * np.arange(300)).sum(1) / shadow[rows].sum(1)
        np.testing.assert_allclose(x, centre[0] + speed_px_s * (rows - centre[1]) / 200 * 0.02, atol=0.03)

    def test_flying_with_the_readout_stretches(self):
        def height(velocity):
            shadow, centre = self.draw_disc([0.0, velocity], readout_s=0.02)
            np.testing.assert_allclose(centroid(shadow), centre, atol=0.02)
            return shadow.sum() / shadow.max()

        # Rows are read at 10000 px/s: the disc meets them longer by 1 / (1 - v / 10000).
        assert height(2000.0) / height(0.0) == pytest.approx(1 / 0.8, rel=0.02)
        assert height(-2000.0) / height(0.0) == pytest.approx(1 / 1.2, rel=0.02)

    def test_motion_blurs_along_the_path(self):
        sharp, _ = self.draw_disc([0.0, 0.0], 0.0)
        blurred, centre = self.draw_disc([2000.0, 0.0], 0.0, exposure_s=0.01)
        assert blurred.sum() == pytest.approx(sharp.sum(), rel=1e-3)
        np.testing.assert_allclose(centroid(blurred), centre, atol=0.02)
        widths = [np.count_nonzero(s[100] > 1) for s in (sharp, blurred)]
        assert widths[1] - widths[0] == pytest.approx(20, abs=2)

    def test_thin_parts_keep_their_darkness(self):
        shadow, _ = self.draw_disc([0.0, 0.0], 0.0, diameter_px=0.5)
        assert shadow.sum() == pytest.approx(100 * np.pi / 4 * 0.25, rel=0.15)

    def test_what_is_elsewhere_is_not_drawn(self):
        picture = np.full((20, 20), 150.0, np.float32)
        look = disc(1.0, 50.0).seen(5 * np.eye(2, 3))
        for centre in ([-30.0, 10.0], [10.0, 60.0], [np.nan, 5.0]):
            place = np.array(centre)
            found = draw(picture, look, lambda t, c=place: np.tile(c, (len(t), 1)), np.zeros_like, 0.01, place)
            assert found is None
        assert (picture == 150).all()

    def test_attitude_carries_weight_and_acceleration(self):
        tilted = attitude(np.array([3.0, -1.0, 2.0]), 0.7)
        np.testing.assert_allclose(tilted @ tilted.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(tilted) == pytest.approx(1)
        np.testing.assert_allclose(np.cross(tilted[:, 2], [3.0, -1.0, 2.0 + 9.81]), 0, atol=1e-12)

    def test_multirotor_is_as_wide_as_one_and_symmetric(self):
        solid = multirotor(50.0)
        reach = np.abs(solid.offset).max(axis=1) + np.abs(solid.axes).max(axis=(1, 2))
        assert 2 * np.hypot(*(solid.offset[0, :2])) + 2 * 0.14 == pytest.approx(1.0, abs=0.01)
        assert reach.max() < 0.51
        for part in range(len(solid.offset)):
            opposite = np.abs(solid.offset + solid.offset[part]).max(1) < 1e-12
            assert (solid.tone[opposite] == solid.tone[part]).any()


class TestScene:
    def test_clouds_drift_and_trees_sway(self):
        scenario = dataclasses.replace(SMALL, n_cameras=4)
        for camera_id in scenario.camera_ids:
            shot = shot_of(filmed(scenario), Film(noise=0.0, exposure_drift=0.0, target_m=0.01), camera_id)
            change = np.abs(shot._background(0)[0] - shot._background(10)[0])
            assert 0 < np.percentile(change, 95) < 60
        clear = shot_of(filmed(scenario), dataclasses.replace(PLAIN, target_m=0.01))
        assert np.array_equal(clear._background(0)[0], clear._background(10)[0])

    def test_levels_are_those_of_video(self):
        for seed in range(4):
            luma, blue, red = shot_of(filmed(SMALL, seed), Film(distractors=True), seed=seed).frame(3)
            assert luma.dtype == blue.dtype == red.dtype == np.uint8
            assert blue.shape == red.shape == (60, 80)
            assert 60 < luma[:40].mean() < 225
            assert luma.std() > 3

    def test_noise_and_exposure(self):
        quiet = shot_of(filmed(SMALL), PLAIN)
        noisy = shot_of(filmed(SMALL), dataclasses.replace(PLAIN, noise=4.0))
        difference = noisy.frame(0)[0].astype(float) - quiet.frame(0)[0]
        assert difference.std() == pytest.approx(4.0, rel=0.1)
        assert not np.array_equal(noisy.frame(1)[0], noisy.frame(2)[0])
        long = filmed(dataclasses.replace(SMALL, duration_s=30.0))
        drifting = shot_of(long, dataclasses.replace(PLAIN, exposure_drift=0.1))
        brightness = [drifting.frame(k)[0].mean() for k in range(0, len(drifting.target.time_s), 30)]
        assert max(brightness) / min(brightness) > 1.02

    def test_distractors_come_and_go(self):
        flight = filmed(dataclasses.replace(SMALL, duration_s=10.0))
        shot = shot_of(flight, dataclasses.replace(PLAIN, distractors=True))
        n_things = [len(shot._things(k)) for k in range(len(shot.target.time_s))]
        assert len(set(n_things)) > 1


class TestFiles:
    @pytest.fixture(scope="class")
    @staticmethod
    def phones():
        scenario = dataclasses.replace(presets["phones"], duration_s=3.0, n_cameras=2, resolutions_px=((160, 120),))
        return filmed(scenario)

    def test_truth_has_a_row_a_frame(self, phones, tmp_path):
        progress = []
        render_videos(phones, Film(), tmp_path, np.random.default_rng(1), lambda *told: progress.append(told))
        for camera_id, camera in phones.truth.cameras.items():
            video = tmp_path / "video" / f"{camera_id}.mp4"
            rows = np.genfromtxt(tmp_path / "truth" / "frames" / f"{camera_id}.csv", delimiter=",", names=True)
            assert rows.dtype.names == ("frame", "time_s", "x_px", "y_px", "size_px", "visible", "contrast")
            n = sum(1 for _ in read_frames(video))
            assert len(rows) == n == len(phones.truth.exposures[camera_id].frame)
            assert rows["frame"].tolist() == list(range(n))
            times_s = frame_times(video)
            np.testing.assert_allclose(rows["time_s"], times_s, rtol=0, atol=1e-9)
            # The stamps are the very instants of exposure.
            exposed = phones.truth.exposures[camera_id].beat / camera.frame_rate_hz
            np.testing.assert_allclose(times_s, exposed, rtol=0, atol=1e-9)
            info = open_video(video)
            assert info.variable_rate
            assert info.size_px == (160, 120)
            assert info.nominal_rate_hz == pytest.approx(camera.frame_rate_hz, rel=0.1)
            inside = rows["visible"] == 1
            assert np.isfinite(rows["x_px"][inside]).all()
            assert (rows["contrast"][inside] > 1).all()
            assert (camera_id, n, n) in progress

    def test_a_detector_finds_the_target_where_the_truth_says(self, tmp_path):
        scenario = dataclasses.replace(SMALL, frame_rates_hz=(10.0,), resolutions_px=((320, 240),))
        flight = filmed(scenario)
        film = dataclasses.replace(PLAIN, quality=10, target_m=4.0)
        render_videos(flight, film, tmp_path, np.random.default_rng(0))
        shot = shot_of(flight, film)
        for frame in read_frames(tmp_path / "video" / "cam0.mp4"):
            if frame.index not in well_inside(shot, (320, 240)):
                continue
            x, y = np.rint(shot.target.xy_px[frame.index]).astype(int)
            window = frame.luma[y - 16 : y + 17, x - 16 : x + 17].astype(float)
            contrast = np.abs(window - np.median(window))
            contrast[contrast < 12] = 0
            np.testing.assert_allclose(centroid(contrast) + [x - 16, y - 16], shot.target.xy_px[frame.index], atol=0.3)

    def test_same_seed_same_files(self, phones, tmp_path):
        contents = {}
        for name, seed in (("a", 5), ("b", 5), ("c", 6)):
            render_videos(phones, Film(distractors=True), tmp_path / name, np.random.default_rng(seed))
            files = sorted(p for p in (tmp_path / name).rglob("*") if p.is_file())
            contents[name] = [p.read_bytes() for p in files]
            assert len(files) == 4
        assert contents["a"] == contents["b"]
        assert all(a != c for a, c in zip(contents["a"][2:], contents["c"][2:], strict=True))

    def test_flight_of_videos(self, tmp_path):
        flight = filmed(SMALL)
        made = []

        def write_videos(folder):
            made.append(folder)

        folder = write_flight(flight, tmp_path / "f", write_videos=write_videos)
        text = (folder / "flight.toml").read_text()
        assert 'video = "video/cam1.mp4"' in text
        assert "detections" not in text
        assert not (folder / "detections").exists()
        assert len(made) == 1


class TestFilming:
    def test_frames_count_from_the_first_and_keep_their_world_time(self):
        scenario = dataclasses.replace(
            SMALL, watched_fraction=0.5, variable_frame_rate=0.1, timestamps=True, duration_s=8.0
        )
        simulated = simulate(scenario, np.random.default_rng(3))
        moved = as_filmed(simulated, TICKS_PER_S)
        for before, after in zip(simulated.recordings, moved.recordings, strict=True):
            camera_id = before.camera_id
            old, new = simulated.truth.exposures[camera_id], moved.truth.exposures[camera_id]
            assert new.frame[0] == new.beat[0] == 0
            assert old.frame[0] > 0
            clocks = [t.cameras[camera_id].clock for t in (simulated.truth, moved.truth)]
            world_s = [clock.world_time(e.beat, 50.0) for clock, e in zip(clocks, (old, new), strict=True)]
            np.testing.assert_allclose(world_s[0], world_s[1], rtol=0, atol=0.51 / TICKS_PER_S)
            stamps = ticks(new, before.frame_rate_hz, TICKS_PER_S)
            np.testing.assert_allclose(stamps / TICKS_PER_S, new.beat / before.frame_rate_hz, rtol=0, atol=1e-9)
            assert (np.diff(stamps) > 0).all()
            (old_track,), (new_track,) = before.tracks, after.tracks
            assert (old_track.frame - new_track.frame == old.frame[0]).all()
            row = np.searchsorted(new.frame, new_track.frame)
            np.testing.assert_allclose(new_track.time_s, new.beat[row] / before.frame_rate_hz, atol=1 / TICKS_PER_S)

    def test_synchronisation_follows_the_new_numbers(self):
        scenario = dataclasses.replace(SMALL, watched_fraction=0.5, duration_s=8.0)
        simulated = simulate(scenario, np.random.default_rng(3))
        moved = as_filmed(simulated, TICKS_PER_S)
        first = [simulated.truth.exposures[c].frame[0] for c in ("cam0", "cam1")]
        slope, intercept = simulated.truth.synchronisation("cam1")
        new_slope, new_intercept = moved.truth.synchronisation("cam1")
        assert new_slope == pytest.approx(slope)
        assert new_intercept == pytest.approx(intercept + slope * first[0] - first[1], abs=1e-3)


def test_film_refuses_what_makes_no_sense():
    with pytest.raises(ValueError, match="noise: expected a value from 0 to 30, got -1"):
        Film(noise=-1)


def test_writer_refuses_odd_sizes(tmp_path):
    with pytest.raises(ValueError, match="even width and height"):
        VideoWriter(tmp_path / "v.mp4", (161, 120), 25.0)
