"""The simulated detector errs as often, and in the ways, it was told to."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skytrace.simulation import Scenario, presets, simulate
from skytrace.simulation.detector import random_spans

SHORT = Scenario(duration_s=20.0)


def run(scenario, seed=0):
    return simulate(scenario, np.random.default_rng(seed))


def each_camera(flight):
    for recording in flight.recordings:
        (track,) = recording.tracks
        camera_id = recording.camera_id
        yield recording, track, flight.truth.cameras[camera_id], flight.truth.detections[camera_id]


def test_noise_has_the_deviation_asked_for():
    flight = run(dataclasses.replace(presets["demo"], noise_px=0.8))
    errors = [(track.xy_px - truth.xy_px)[~truth.is_outlier] for _, track, _, truth in each_camera(flight)]
    np.testing.assert_allclose(np.std(np.concatenate(errors), axis=0), 0.8, rtol=0.05)
    np.testing.assert_allclose(np.mean(np.concatenate(errors), axis=0), 0.0, atol=0.05)


@pytest.mark.parametrize(("uniform", "clustered"), [(0.0, 0.0), (0.03, 0.0), (0.0, 0.1), (0.2, 0.1)])
def test_false_detections_have_the_share_asked_for(uniform, clustered):
    scenario = Scenario(
        duration_s=120.0, dropout_fraction=0.5, outlier_fraction=uniform, clustered_fraction=clustered, noise_px=0.0
    )
    for _, track, camera, truth in each_camera(run(scenario)):
        assert np.mean(truth.is_outlier) == pytest.approx(uniform + clustered, abs=0.015)
        error = np.linalg.norm(track.xy_px - truth.xy_px, axis=1)
        assert (error[~truth.is_outlier] == 0).all()
        false = truth.is_outlier & np.isfinite(error)
        if uniform or clustered:
            assert np.median(error[false]) > 0.02 * camera.intrinsics.size_px[0]


def test_clusters_are_stuck_or_fly_straight_for_about_a_second():
    scenario = Scenario(duration_s=120.0, clustered_fraction=0.15, noise_px=0.0)
    lengths, stuck = [], []
    for recording, track, _, truth in each_camera(run(scenario)):
        edge = np.flatnonzero(np.diff(truth.is_outlier.astype(int)))
        for begin, end in pairwise(edge):
            if truth.is_outlier[begin + 1] and end - begin > 8:
                xy = track.xy_px[begin + 1 : end + 1]
                jump = np.linalg.norm(np.diff(xy, n=2, axis=0), axis=1)
                lengths.append((end - begin) / recording.frame_rate_hz)
                if jump.max() < 1e-6:  # one blob, not two that touch
                    stuck.append(np.ptp(xy, axis=0).max() < 1e-9)
    assert 0.7 < np.median(lengths) < 1.6
    assert 0.2 < np.mean(stuck) < 0.8


def test_measurements_stay_in_the_image_whatever_the_noise():
    scenario = Scenario(duration_s=60.0, camera_distance=0.5, noise_px=60.0, clustered_fraction=0.3)
    for _, track, camera, _ in each_camera(run(scenario)):
        last = np.array(camera.intrinsics.size_px) - 1
        assert ((track.xy_px >= 0) & (track.xy_px <= last)).all()
        assert (track.xy_px.min(0) < 20).any() or (track.xy_px.max(0) > last - 20).any()


def test_quantised_detections_are_whole_pixels_next_to_the_truth():
    for _, track, _, truth in each_camera(run(dataclasses.replace(SHORT, quantise=True, noise_px=0.0))):
        np.testing.assert_array_equal(track.xy_px, np.round(track.xy_px))
        assert 0.4 < np.abs(track.xy_px - truth.xy_px).max() <= 0.5


@settings(max_examples=60, deadline=None)
@given(n=st.integers(0, 3000), share=st.floats(0, 0.9), length=st.floats(1, 100), seed=st.integers(0, 2**32))
def test_random_spans_cover_exactly_their_share(n, share, length, seed):
    label = random_spans(n, share, length, np.random.default_rng(seed))
    assert (label >= 0).sum() == round(share * n)
    counts = np.bincount(label[label >= 0])
    assert counts.max(initial=0) <= 1.5 * length + 1


def test_absences_remove_their_share_in_bursts():
    full, gappy = run(Scenario(noise_px=0.0)), run(Scenario(noise_px=0.0, dropout_fraction=0.3))
    for (_, track_full, *_), (_, track_gappy, *_) in zip(each_camera(full), each_camera(gappy), strict=True):
        assert len(track_gappy) == pytest.approx(0.7 * len(track_full), rel=0.05)
        assert (np.diff(track_gappy.frame) > 1).sum() < 0.05 * len(track_gappy)
