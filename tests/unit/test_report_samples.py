"""What is drawn in the report: thinned without losing ends, counted as the run folder counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_scene import make_reconstruction

from skytrace.io.run_folder import SUPPORT_S, supporting_cameras
from skytrace.model.reconstruction import Reconstruction, Residuals
from skytrace.report import samples


def make_residuals(time_s, error_px, inlier=None, measured_px=None) -> Residuals:
    n = len(time_s)
    inlier = np.ones(n, bool) if inlier is None else inlier
    measured_px = np.zeros((n, 2)) if measured_px is None else measured_px
    return Residuals(np.arange(n), time_s, measured_px, error_px, inlier)


def test_path_is_thinned_and_keeps_both_ends_of_every_segment():
    reconstruction = make_reconstruction(duration_s=600.0, frame_rate_hz=2.0, n_segments=40)
    path = samples.path_samples(reconstruction)
    assert 5000 < len(path.time_s) <= samples.MAX_PATH_SAMPLES
    for k, segment in enumerate(reconstruction.trajectory.segments):
        own = path.time_s[path.segment == k]
        assert own[0] == segment.begin_s
        assert own[-1] == segment.end_s
    np.testing.assert_allclose(path.position, reconstruction.trajectory.position(path.time_s))


def test_short_flight_is_sampled_at_the_highest_rate_only():
    path = samples.path_samples(make_reconstruction(duration_s=11.0, n_segments=1))
    assert len(path.time_s) == 1 + 10 * samples.MAX_PATH_RATE_HZ


def test_path_of_a_reconstruction_that_covers_nothing_is_empty():
    whole = make_reconstruction()
    empty = Reconstruction(whole.reference, whole.cameras, replace(whole.trajectory, segments=()))
    assert samples.path_samples(empty).position.shape == (0, 3)


@given(st.lists(st.floats(0, 20), max_size=40), st.lists(st.floats(-1, 21), min_size=1, max_size=30))
def test_sight_intervals_support_the_times_that_the_run_folder_counts(seen_s, asked_s):
    whole = make_reconstruction(["cam0", "cam1"], duration_s=4.0)
    # The edges are left to rounding: times on a grid of 0.01 s, questions halfway between.
    seen_s, asked_s = np.round(np.sort(seen_s), 2), np.round(asked_s, 2) + 0.005
    residuals = make_residuals(seen_s, np.zeros((len(seen_s), 2)))
    camera = replace(whole.cameras["cam0"], residuals=residuals)
    intervals = samples.sight_intervals(camera)
    inside = (intervals[:, 0] - SUPPORT_S <= asked_s[:, None]) & (asked_s[:, None] <= intervals[:, 1] + SUPPORT_S)
    alone = Reconstruction("cam0", {"cam0": camera}, whole.trajectory)
    np.testing.assert_array_equal(inside.any(axis=1), supporting_cameras(alone, asked_s) == 1)


def test_sight_intervals_bridge_half_a_second():
    whole = make_reconstruction(["cam0", "cam1"], duration_s=4.0)
    residuals = make_residuals(np.array([0.0, 0.4, 0.8, 1.4, 5.0]), np.zeros((5, 2)), np.array([1, 1, 1, 1, 0], bool))
    intervals = samples.sight_intervals(replace(whole.cameras["cam0"], residuals=residuals))
    np.testing.assert_array_equal(intervals, [[0.0, 0.8], [1.4, 1.4]])


@given(st.integers(0, 500), st.integers(2, 100))
def test_thin_spreads_evenly_over_all(n, most):
    index = samples.thin(n, most)
    assert len(index) == min(n, most)
    if n > most:
        steps = np.diff(index)
        assert (index[0], index[-1]) == (0, n - 1)
        assert steps.min() >= 1
        assert steps.max() - steps.min() <= 1


def test_running_median_ignores_disagreeing_detections_and_leaves_gaps():
    time_s = np.r_[np.linspace(0, 4, 200), np.linspace(8, 10, 100)]
    error_px = np.column_stack([np.full(300, 3.0), np.full(300, 4.0)])
    inlier = np.ones(300, bool)
    error_px[::7], inlier[::7] = 1e3, False
    middle_s, median_px = samples.running_median(make_residuals(time_s, error_px, inlier), n_bins=20)
    in_gap = (middle_s > 4.3) & (middle_s < 7.7)
    assert np.isnan(median_px[in_gap]).all()
    np.testing.assert_allclose(median_px[(middle_s < 3.7) | (middle_s > 8.3)], 5.0)


def test_histogram_holds_the_share_that_lies_within_reach(rng):
    error_px = np.column_stack([rng.normal(0, 1, 4000), np.r_[np.full(1000, 50.0), np.zeros(3000)]])
    centre, density = samples.error_histogram(make_residuals(np.arange(4000.0), error_px), reach_px=6.0)
    width = centre[1] - centre[0]
    np.testing.assert_allclose(density.sum(axis=0) * width, [1.0, 0.75], atol=1e-9)
    assert centre[np.argmax(density[:, 1])] == pytest.approx(0, abs=1e-9)


def test_error_field_finds_the_bias_of_each_part_of_the_image(rng):
    left = rng.uniform([0, 0], [900, 1080], (4000, 2))
    right = rng.uniform([1000, 0], [1920, 1080], (4000, 2))
    error_px = np.repeat([[1.0, 0.0], [0.0, -2.0]], 4000, axis=0)
    inlier = np.ones(8000, bool)
    error_px[::5], inlier[::5] = 500.0, False
    residuals = make_residuals(np.arange(8000.0), error_px, inlier, np.concatenate([left, right]))
    place, error = samples.error_field(residuals, (1920, 1080))
    assert len(place) > 40
    np.testing.assert_allclose(error[place[:, 0] < 900], np.tile([1.0, 0.0], ((place[:, 0] < 900).sum(), 1)))
    np.testing.assert_allclose(error[place[:, 0] > 1000], np.tile([0.0, -2.0], ((place[:, 0] > 1000).sum(), 1)))
    assert not len(samples.error_field(residuals, (1920, 1080), at_least=10_000)[0])
