"""Candidate offsets: windows of long recordings, what is screened, and what becomes of wrong frame rates."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from skytrace.estimation.candidates import likely_offsets, ranked_candidates, search_windows
from skytrace.estimation.correspond import ImagePath, image_path
from skytrace.estimation.pair_modes import find_modes
from skytrace.estimation.sync_settings import SyncSettings
from skytrace.simulation import Scenario, simulate

SETTINGS = SyncSettings()


def straight_path(begin_s, end_s, step_s=1.0):
    """A path that crosses the image evenly between two times."""
    breaks = np.arange(begin_s, end_s + step_s / 2, step_s)
    coefficients = np.zeros((4, len(breaks) - 1, 2))
    coefficients[2] = 1e-3
    coefficients[3] = 1e-3 * (breaks[:-1, None] - begin_s)
    return ImagePath(breaks, coefficients)


def paths_and_offset(duration_s, rate_error, seed=3):
    scenario = Scenario(
        n_cameras=2, duration_s=duration_s, frame_rates_hz=(20.0,), clock_drift=0.0, readout_fraction=0.0
    )
    flight = simulate(scenario, np.random.default_rng(seed))
    first, second = flight.recordings
    second = dataclasses.replace(second, frame_rate_hz=second.frame_rate_hz * (1 + rate_error))
    paths = [image_path(r, 0.0) for r in (first, second)]
    middle_s = 0.5 * duration_s
    frames = [(middle_s - c.clock.offset_s) / c.clock.period_s for c in flight.truth.cameras.values()]
    return paths, [f / r.frame_rate_hz for f, r in zip(frames, (first, second), strict=True)]


def test_short_recordings_are_searched_as_a_whole():
    path0, path1 = straight_path(10.0, 400.0), straight_path(0.0, 5000.0)
    assert search_windows(path0, path1, SETTINGS) == [(10.0, 400.0)]


def test_long_recordings_are_searched_in_a_bounded_number_of_windows_as_well():
    path0, path1 = straight_path(100.0, 7300.0), straight_path(0.0, 5000.0)
    whole, *windows = search_windows(path0, path1, SETTINGS)
    assert whole == (100.0, 7300.0)
    assert len(windows) == SETTINGS.most_windows
    assert windows[0][0] == 100.0
    assert windows[-1][1] == 7300.0
    assert all(end - begin == pytest.approx(SETTINGS.window_s) for begin, end in windows)


def test_windows_in_which_nothing_was_seen_are_left_out():
    before, after = straight_path(0.0, 1000.0), straight_path(2000.0, 2500.0)
    gap = np.full((4, 1, 2), np.nan)
    path = ImagePath(
        np.r_[before.breaks_s, after.breaks_s], np.concatenate([before.coefficients, gap, after.coefficients], axis=1)
    )
    windows = search_windows(path, straight_path(0.0, 3000.0), SETTINGS)[1:]
    assert windows
    assert all(path.clipped(*w).seen_s >= SETTINGS.min_overlap_s for w in windows)
    assert len(windows) < SETTINGS.most_windows


def test_a_thorough_search_tries_more_offsets_and_none_twice():
    (path0, path1), _ = paths_and_offset(60.0, 0.0)
    few = likely_offsets(path0, path1, SETTINGS, thorough=False)
    many = likely_offsets(path0, path1, SETTINGS, thorough=True)
    assert 0 < len(few) < len(many)
    verified = [c.offset_s for c in ranked_candidates(path0, path1, SETTINGS, thorough=True)]
    assert len(verified) <= SETTINGS.verified
    gaps = np.diff(np.sort(verified))
    assert gaps.min() >= 0.5 * SETTINGS.screen_separation_s - 1e-9


def test_tracks_that_hardly_overlap_have_no_candidates():
    path0, path1 = straight_path(0.0, 10.0), straight_path(0.0, 12.0)
    assert ranked_candidates(path0, path1, SETTINGS, thorough=True) == []


@pytest.mark.parametrize("rate_error", [2e-3, -4e-3])
def test_a_wrong_frame_rate_does_not_hide_the_offset_of_a_long_recording(rate_error):
    (path0, path1), (time0_s, time1_s) = paths_and_offset(900.0, rate_error)
    best = find_modes(path0, path1, SETTINGS)[0].geometry
    assert best.offset_s + best.rate * time0_s == pytest.approx(time1_s, abs=0.01)
    assert best.rate == pytest.approx(1 / (1 + rate_error), abs=2e-5)


def test_a_clipped_path_is_the_path_in_the_interval(rng):
    (path, _), _ = paths_and_offset(30.0, 0.0)
    begin, end = path.begin_s + 7.3, path.begin_s + 19.1
    clipped = path.clipped(begin, end)
    time = rng.uniform(begin, end, 200)
    np.testing.assert_array_equal(clipped.evaluate(time), path.evaluate(time))
    assert clipped.begin_s > path.begin_s
    assert clipped.end_s < path.end_s
    assert path.clipped(path.begin_s - 1, path.end_s + 1) is path
