"""Image paths: where a camera saw the target between its frames, and NaN where it did not."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.estimation.correspond import common_grid, image_path
from skytrace.model.camera import Intrinsics
from skytrace.model.track import Recording, Track
from skytrace.simulation import Scenario, simulate

PLAIN = Intrinsics([1000.0, 1000.0], [960.0, 540.0], [0.0] * 5, (1920, 1080))


def cubic_px(t):
    return np.column_stack([960 + 200 * t - 30 * t**2 + 4 * t**3, 540 - 100 * t + 20 * t**2 - 3 * t**3])


def on_plane(xy_px):
    return (xy_px - [960.0, 540.0]) / 1000.0


def recording_of(*frames, path=cubic_px, rate_hz=30.0):
    return Recording("cam0", PLAIN, rate_hz, tuple(Track(f, path(np.asarray(f) / rate_hz)) for f in frames))


@pytest.mark.parametrize("rate_hz", [25.0, 29.97, 59.94, 120.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_smooth_flight_is_interpolated_to_a_ten_thousandth_of_a_pixel(rate_hz, seed):
    scenario = Scenario(
        duration_s=20.0, n_cameras=2, frame_rates_hz=(rate_hz,), noise_px=0.0, focal_error=0.0, clock_drift=0.0,
        speed_m_s=5.0, readout_fraction=0.6,
    )  # fmt: skip
    flight = simulate(scenario, np.random.default_rng(seed))
    for recording in flight.recordings:
        camera = flight.truth.cameras[recording.camera_id]
        path = image_path(recording, 0.6)
        t = np.linspace(path.begin_s, path.end_s, 2000)
        point = camera.camera_from_world.apply(flight.truth.motion.position(camera.clock.offset_s + t))
        error = np.linalg.norm(path.evaluate(t) - point[:, :2] / point[:, 2:], axis=1) * camera.intrinsics.focal_px[0]
        assert error.max() < 1e-4  # a NaN would fail too


def test_a_cubic_path_is_reproduced_from_four_detections_on():
    for n in (4, 5, 6, 7, 40):
        path = image_path(recording_of(np.arange(n)), 0.0)
        t = np.linspace(0, (n - 1) / 30, 50)
        np.testing.assert_allclose(path.evaluate(t), on_plane(cubic_px(t)), rtol=0, atol=1e-9)


def test_missing_frames_inside_a_tracklet_are_bridged():
    path = image_path(recording_of(np.r_[0:20, 26:50]), 0.0)
    t = np.linspace(0, 49 / 30, 300)
    np.testing.assert_allclose(path.evaluate(t), on_plane(cubic_px(t)), rtol=0, atol=1e-9)


def test_nothing_is_claimed_outside_and_between_tracklets():
    path = image_path(recording_of(np.arange(0, 30), np.arange(60, 90), np.arange(120, 150)), 0.0)
    assert (path.begin_s, path.end_s) == (0.0, 149 / 30)
    seen = np.array([0.0, 0.5, 0.96, 2.0, 2.96, 4.0, 149 / 30])
    unseen = np.array([-10.0, -1e-9, 0.97, 1.0, 1.99, 2.98, 3.5, 3.99, 149 / 30 + 1e-9, 99.0])
    for order in (0, 1):
        assert np.isfinite(path.evaluate(seen, order)).all()
        assert np.isnan(path.evaluate(unseen, order)).all()
    np.testing.assert_allclose(path.evaluate(seen), on_plane(cubic_px(seen)), rtol=0, atol=1e-9)


def test_derivative_is_the_difference_quotient(rng):
    recording = recording_of(np.arange(200), path=lambda t: cubic_px(t) * 0.3 + 50 * np.sin(2 * t)[:, None])
    path = image_path(recording, 0.0)
    t, h = rng.uniform(0.1, 6.5, 100), 1e-6
    numeric = (path.evaluate(t + h) - path.evaluate(t - h)) / (2 * h)
    np.testing.assert_allclose(path.evaluate(t, 1), numeric, rtol=0, atol=1e-7)
    with pytest.raises(ValueError, match="derivative: expected 0 or 1, got 2"):
        path.evaluate(t, 2)


def test_fewer_than_four_detections_are_no_path():
    with pytest.raises(ValueError, match="recording cam0: no tracklet of at least four detections"):
        image_path(recording_of(np.arange(3)), 0.0)
    with pytest.raises(ValueError, match="cam0"):
        image_path(Recording("cam0", PLAIN, 30.0, ()), 0.0)
    path = image_path(recording_of(np.arange(3), np.arange(30, 60), np.arange(90, 93)), 0.0)
    assert (path.begin_s, path.end_s) == (1.0, 59 / 30)


def test_the_lens_is_undone_and_what_it_cannot_show_is_left_out():
    folding = Intrinsics(PLAIN.focal_px, PLAIN.principal_px, [-0.3, 0.0, 0.0, 0.0, 0.0], PLAIN.size_px)
    t = np.arange(40) / 30
    x = 0.05 + 0.2 * t
    xy = folding.project(np.column_stack([x, 0 * x, np.ones_like(x)]))
    xy[-5:, 0] = 1900.0  # at 0.94 on the plane z = 1; the lens reaches no further than 0.70
    path = image_path(Recording("cam0", folding, 30.0, (Track(np.arange(40), xy),)), 0.0)
    assert path.end_s == pytest.approx(34 / 30)
    np.testing.assert_allclose(path.evaluate(t[:35])[:, 0], x[:35], rtol=0, atol=1e-9)


def test_rows_are_read_out_one_after_another():
    recording = recording_of(np.arange(30))
    late = image_path(recording, 0.5)
    row = recording.tracks[0].xy_px[:, 1] / 1080
    assert late.begin_s == pytest.approx(0.5 / 30 * row[0])
    exposed = np.arange(30) / 30 + 0.5 / 30 * row
    np.testing.assert_allclose(late.evaluate(exposed), on_plane(cubic_px(np.arange(30) / 30)), rtol=0, atol=1e-5)


def test_time_stamps_take_the_place_of_the_nominal_beat(rng):
    stamps = np.cumsum(rng.uniform(0.02, 0.05, 60))
    recording = Recording("cam0", PLAIN, 30.0, (Track(np.arange(60), cubic_px(stamps), time_s=stamps),))
    path = image_path(recording, 0.0)
    t = np.linspace(stamps[0], stamps[-1], 100)
    np.testing.assert_allclose(path.evaluate(t), on_plane(cubic_px(t)), rtol=0, atol=1e-9)


def test_quantisation_is_averaged_at_high_frame_rates():
    def rounded(t):
        return np.rint(cubic_px(t / 4))

    deviation = []
    for rate_hz in (25.0, 240.0):
        path = image_path(recording_of(np.arange(int(8 * rate_hz)), path=rounded, rate_hz=rate_hz), 0.0)
        t = np.linspace(0.5, 7.5, 400)
        deviation.append(np.sqrt(np.mean((path.evaluate(t) - on_plane(cubic_px(t / 4))) ** 2)) * 1000)
    assert deviation[0] < 0.35
    assert deviation[1] < 0.6 * deviation[0]


def test_the_common_grid_lies_on_multiples_of_its_period():
    paths = [image_path(recording_of(np.arange(7, 100)), 0.0), image_path(recording_of(np.arange(0, 31)), 0.0)]
    for path, (first_s, xy) in zip(paths, common_grid(paths, 10.0), strict=True):
        assert first_s * 10 == pytest.approx(round(first_s * 10))
        assert path.begin_s <= first_s < path.begin_s + 0.1
        t = first_s + np.arange(len(xy)) / 10
        assert path.end_s - 0.1 < t[-1] <= path.end_s
        np.testing.assert_allclose(xy, path.evaluate(t), rtol=0, atol=1e-12)


def test_seconds_seen_leave_out_the_silences():
    path = image_path(recording_of(np.arange(0, 31), np.arange(60, 106)), 0.0)
    assert path.seen_s == pytest.approx(1.0 + 1.5)


def test_a_stretched_path_is_the_same_on_a_faster_clock():
    path = image_path(recording_of(np.arange(0, 31), np.arange(60, 106)), 0.0)
    fast = path.stretched(2.0)
    t = np.r_[np.linspace(0, 0.99, 20), 1.5, np.linspace(2.01, 3.49, 20)]
    np.testing.assert_allclose(fast.evaluate(2 * t), path.evaluate(t), rtol=0, atol=1e-12)
    np.testing.assert_allclose(fast.evaluate(2 * t, 1), path.evaluate(t, 1) / 2, rtol=0, atol=1e-12)
    assert fast.seen_s == pytest.approx(2 * path.seen_s)
