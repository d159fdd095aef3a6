"""Tracks and recordings."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.model.camera import Intrinsics
from skytrace.model.track import Recording, Track

LENS = Intrinsics([1000.0, 1000.0], [640.0, 360.0], [0.0] * 5, (1280, 720))
XY = np.arange(8.0).reshape(4, 2)


def test_selection_keeps_rows_together():
    track = Track([3, 5, 6, 9], XY, sigma_px=[1, 2, 3, 4], time_s=[0.3, 0.5, 0.61, 0.9])
    for index in (slice(1, 3), np.array([False, True, True, False]), np.array([1, 2])):
        part = track.select(index)
        np.testing.assert_array_equal(part.frame, [5, 6])
        np.testing.assert_array_equal(part.xy_px, XY[1:3])
        np.testing.assert_array_equal(part.sigma_px, [2, 3])
        np.testing.assert_array_equal(part.time_s, [0.5, 0.61])
        assert len(part) == 2
    bare = Track([3, 5, 6, 9], XY).select(slice(0, 1))
    assert bare.sigma_px is None
    assert bare.time_s is None


def test_an_empty_track_is_allowed():
    track = Track([], np.zeros((0, 2)), sigma_px=[], time_s=[])
    assert len(track) == 0
    assert track.frame.dtype == np.int64


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"frame": [3, 5, 5, 9]}, "strictly increasing frame"),
        ({"frame": [3, 5, 4, 9]}, "strictly increasing frame"),
        ({"frame": [1, 2, 3]}, r"xy_px: expected shape \(3, 2\), got \(4, 2\)"),
        ({"xy_px": np.full((4, 2), np.nan)}, "xy_px: contains values that are not finite"),
        ({"sigma_px": [1, 1, 0, 1]}, "sigma_px: expected positive"),
        ({"sigma_px": [1, 1]}, "sigma_px: expected shape"),
        ({"time_s": [0.1, 0.2, 0.2, 0.3]}, "time_s: expected strictly increasing"),
        ({"time_s": [0.1, 0.2, np.nan, 0.3]}, "time_s: contains values that are not finite"),
    ],
)
def test_contradictory_tracks_are_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        Track(**{"frame": [3, 5, 6, 9], "xy_px": XY, **fields})


def test_camera_time_is_the_time_stamp_or_the_nominal_beat():
    plain = Track([30, 45], XY[:2])
    stamped = Track([50, 51], XY[:2], time_s=[1.7, 1.8])
    recording = Recording("cam0", LENS, 30.0, [plain, stamped])
    assert isinstance(recording.tracks, tuple)
    np.testing.assert_allclose(recording.camera_time_s(plain), [1.0, 1.5])
    np.testing.assert_array_equal(recording.camera_time_s(stamped), [1.7, 1.8])
    assert recording.n_detections == 4
    assert Recording("cam1", LENS, 30.0, ()).n_detections == 0


@pytest.mark.parametrize("rate", [0.0, -25.0, np.nan, np.inf])
def test_impossible_frame_rates_are_refused(rate):
    with pytest.raises(ValueError, match="frame_rate_hz: expected a positive number"):
        Recording("cam0", LENS, rate, ())


def test_the_line_through_frames_is_the_nominal_one_or_that_of_the_time_stamps():
    plain = Recording("cam0", LENS, 30.0, [Track([30, 45], XY[:2])])
    assert plain.frame_line() == (0.0, 1 / 30)
    assert not plain.stamped
    frame = np.array([30, 31, 60, 90])
    stamps = 1.7e9 + 0.04 * frame + [1e-3, -1e-3, 1e-3, -1e-3]
    stamped = Recording(
        "cam0", LENS, 30.0, [Track(frame[:2], XY[:2], time_s=stamps[:2]), Track(frame[2:], XY[2:], time_s=stamps[2:])]
    )
    assert stamped.stamped
    first_s, period_s = stamped.frame_line()
    assert period_s == pytest.approx(0.04, rel=2e-3)
    np.testing.assert_allclose(first_s + period_s * frame, stamps, rtol=0, atol=2e-3)
    one = Recording("cam0", LENS, 30.0, [Track([30], XY[:1], time_s=[5.0])])
    assert one.frame_line() == (0.0, 1 / 30)
    assert not Recording("cam0", LENS, 30.0, []).stamped
