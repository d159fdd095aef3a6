"""Frames that come when they come: time stamps are the time base of everything, as good as an even frame rate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import align_similarity
from skytrace.model.track import Recording, Track
from skytrace.pipeline.config import Config
from skytrace.pipeline.offline import Outcome, outcome, run
from skytrace.pipeline.prepare import prepare_recordings
from skytrace.pipeline.summary import summarise
from skytrace.simulation import SimulatedFlight, presets, simulate

UNEVEN = replace(presets["uneven"], duration_s=70.0, n_cameras=3)
EVEN = replace(UNEVEN, rate_swing=0.0, dropped_frames=0.0, variable_frame_rate=0.0, timestamps=False)


@cache
def simulated(seed: int, even: bool) -> SimulatedFlight:
    return simulate(EVEN if even else UNEVEN, np.random.default_rng(seed))


def reconstruct(recordings: tuple[Recording, ...]) -> tuple[Outcome, list[str]]:
    prepared = prepare_recordings(recordings, Config().clean)
    found = outcome(run(prepared.recordings, Config()))
    return found, summarise(found, prepared, {})["warnings"]


@cache
def reconstructed(seed: int, even: bool) -> tuple[Outcome, list[str]]:
    return reconstruct(simulated(seed, even).recordings)


def error_m(flight: SimulatedFlight, found: Outcome, zero_s: float = 0.0) -> FloatArray:
    """Errors of the trajectory, which runs on the reference camera's own clock: `zero_s` where the simulation has 0."""
    reconstruction, motion = found.reconstruction, flight.truth.motion
    camera = flight.truth.cameras[reconstruction.reference]
    time_s = reconstruction.trajectory.sample_times(10.0)
    true_s = camera.clock.offset_s + camera.clock.period_s * camera.frame_rate_hz * (time_s - zero_s)
    flown = (true_s >= motion.begin_s) & (true_s <= motion.end_s)
    at, true = reconstruction.trajectory.position(time_s[flown]), motion.position(true_s[flown])
    return np.linalg.norm(align_similarity(at, true).apply(at) - true, axis=1)


def retimed(recordings: tuple[Recording, ...], time: Callable[[int, FloatArray], FloatArray]) -> tuple[Recording, ...]:
    """The recordings with other time stamps: `time(k, stamps)` of camera k."""

    def moved(track: Track, k: int) -> Track:
        assert track.time_s is not None
        return replace(track, time_s=time(k, track.time_s))

    return tuple(replace(r, tracks=tuple(moved(t, k) for t in r.tracks)) for k, r in enumerate(recordings))


def test_the_frames_are_truly_uneven() -> None:
    for recording in simulated(0, even=False).recordings:
        (track,) = recording.tracks
        assert track.time_s is not None
        interval = np.diff(track.time_s) / np.diff(track.frame) * recording.frame_rate_hz
        low, high = np.percentile(interval, [5, 95])
        assert high > 1.7 * low
        _, residual, *_ = np.polyfit(track.frame, track.time_s, 1, full=True)
        assert np.sqrt(residual[0] / len(track)) > 0.3  # seconds off any constant frame rate


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_variable_frame_rate_with_time_stamps_is_as_good_as_a_constant_one(seed: int) -> None:
    errors = []
    for even in (True, False):
        flight = simulated(seed, even)
        found, warnings = reconstructed(seed, even)
        assert len(found.reconstruction.cameras) == len(flight.recordings)
        assert not found.wander
        assert warnings == []
        errors.append(error_m(flight, found))
    extent_m = float(np.linalg.norm(np.ptp(simulated(seed, True).truth.motion.position(np.arange(70.0)), axis=0)))
    assert errors[1].mean() <= 1e-3 * extent_m
    assert errors[1].mean() <= 1.5 * errors[0].mean()


def test_clocks_of_stamped_cameras_are_the_lines_through_their_stamps() -> None:
    flight = simulated(0, even=False)
    found, _ = reconstructed(0, even=False)
    true0 = flight.truth.cameras[found.reconstruction.reference].clock
    for recording in flight.recordings:
        clock = found.reconstruction.cameras[recording.camera_id].clock
        first_s, period_s = recording.frame_line()
        true = flight.truth.cameras[recording.camera_id].clock
        rate = true.period_s * recording.frame_rate_hz
        # World time is that of the reference's stamps, in its own seconds.
        rate0 = true0.period_s * flight.recordings[0].frame_rate_hz
        middle = float(np.median(recording.tracks[0].frame))
        expected_s = (true.offset_s + rate * (first_s + period_s * middle) - true0.offset_s) / rate0
        assert clock.offset_s + clock.period_s * middle == pytest.approx(expected_s, abs=0.02)
        assert clock.period_s == pytest.approx(period_s * rate / rate0, rel=1e-3)


def test_time_stamps_may_be_of_any_epoch() -> None:
    """Seconds since 1970 in one camera, since its own beginning in another: the same flight on the first's clock."""
    flight = simulated(0, even=False)
    plain, _ = reconstructed(0, even=False)
    epoch_s = 1.7e9
    found, warnings = reconstruct(retimed(flight.recordings, lambda k, t: t + (epoch_s if k % 2 == 0 else -50.0)))
    assert warnings == []
    reference = found.reconstruction.cameras[found.reconstruction.reference]
    assert reference.clock.offset_s == pytest.approx(epoch_s, abs=60.0)
    assert abs(error_m(flight, found, epoch_s).mean() / error_m(flight, plain).mean() - 1) < 0.1


def test_frames_that_share_a_time_are_counted_once() -> None:
    flight = simulated(1, even=False)
    first = flight.recordings[0]
    (track,) = first.tracks
    assert track.time_s is not None
    # Every fortieth frame twice in the file, with the same time: the frames after it count on.
    source = np.sort(np.r_[np.arange(len(track)), np.arange(0, len(track), 40)])
    extra = np.concatenate([[0], np.cumsum(np.diff(source) == 0)])
    from skytrace.estimation.clean import clean_detections

    settings = Config().clean
    stamps, pixels = track.time_s[source], track.xy_px[source]
    cleaned = clean_detections(
        track.frame[source] + extra, pixels, first.frame_rate_hz, first.intrinsics.size_px, settings, time_s=stamps
    )
    assert cleaned.dropped["repeated_time"] == len(source) - len(track)
    plain = clean_detections(
        track.frame, track.xy_px, first.frame_rate_hz, first.intrinsics.size_px, settings, time_s=track.time_s
    )
    assert [len(t) for t in cleaned.tracklets] == [len(t) for t in plain.tracklets]


def test_time_stamps_of_slowed_down_video_are_found_out() -> None:
    """One camera's file plays at half speed: its stamps are twice as far apart as the frames were."""
    flight = simulated(1, even=False)
    found, warnings = reconstruct(retimed(flight.recordings, lambda k, t: 2 * t if k == 2 else t))
    assert len(found.reconstruction.cameras) == len(flight.recordings)
    assert error_m(flight, found).mean() <= 0.02
    (warning,) = warnings
    assert warning.startswith("Camera cam2's time stamps say")
    assert "not slowed down" in warning


def test_without_time_stamps_an_uneven_clock_is_said_with_what_to_do() -> None:
    """A clock that sways by 40 ms over half a minute, as a warm phone's."""
    flight = simulate(presets["demo"], np.random.default_rng(4))
    recording = flight.recordings[1]
    (track,) = recording.tracks
    sway = 0.04 * np.sin(2 * np.pi * track.frame / recording.frame_rate_hz / 30)
    frame, index = np.unique(np.round(track.frame + sway * recording.frame_rate_hz).astype(int), return_index=True)
    swayed = replace(recording, tracks=(replace(track.select(index), frame=frame),))
    _, warnings = reconstruct((flight.recordings[0], swayed, *flight.recordings[2:]))
    (warning,) = [w for w in warnings if "not evenly spaced" in w]
    assert warning.startswith(f"Camera {recording.camera_id}'s frames")
    assert 'timestamps = "FILE"' in warning
    assert "ffprobe" in warning
