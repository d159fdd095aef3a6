"""The whole chain on simulated flights: nothing given but tracks and calibrations, everything known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skytrace.errors import ReconstructionError
from skytrace.estimation.hints import Hints, OffsetHint
from skytrace.model.track import Recording
from skytrace.pipeline.config import Config
from skytrace.pipeline.offline import outcome, run
from skytrace.pipeline.prepare import prepare_recordings
from skytrace.pipeline.summary import summarise
from skytrace.simulation import presets, simulate
from tests.recovery.scenes import Recovered, compare, recover


def all_registered(found: Recovered) -> bool:
    return len(found.reconstruction.cameras) == len(found.simulated.recordings)


@pytest.mark.parametrize("seed", range(4))
def test_a_flight_of_the_spline_model_is_recovered_exactly(seed: int) -> None:
    found = recover("noise_free_spline", seed)
    assert all_registered(found)
    assert found.error_m.max() <= 1e-6 * found.extent_m
    flown = found.simulated.truth.motion.end_s - found.simulated.truth.motion.begin_s
    assert found.reconstruction.trajectory.covered_s >= 0.98 * flown


@pytest.mark.parametrize("seed", range(4))
def test_any_smooth_flight_is_recovered_to_a_ten_thousandth(seed: int) -> None:
    found = recover("noise_free_smooth", seed)
    assert all_registered(found)
    assert found.error_m.max() <= 1e-4 * found.extent_m


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("preset", ["demo", "hover_legs", "legs", "turns", "climbs"])
def test_realistic_flights_to_a_tenth_of_a_per_cent(preset: str, seed: int) -> None:
    """Half a pixel of noise, rolling shutters, drifting clocks, calibration errors and false detections."""
    found = recover(preset, seed)
    assert all_registered(found)
    assert found.error_m.mean() <= 1e-3 * found.extent_m
    assert found.error_m.max() <= 5e-3 * found.extent_m


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("preset", ["cluttered", "phones"])
def test_clutter_and_uneven_phones(preset: str, seed: int) -> None:
    found = recover(preset, seed)
    assert all_registered(found)
    assert found.error_m.mean() <= 1e-3 * found.extent_m


def test_claimed_deviations_are_not_smaller_than_the_errors() -> None:
    """Over many flights the squared error in claimed deviations must not exceed its expectation of three by much."""
    ratios = [np.mean((f.error_m / f.sigma_m) ** 2) / 1 for f in (recover("demo", seed) for seed in range(6))]
    assert 0.05 <= np.mean(ratios) <= 3


def test_clocks_and_readouts_are_recovered() -> None:
    found = recover("demo", 1)
    reference = found.reconstruction.reference
    true0, own0 = found.simulated.truth.cameras[reference].clock, found.reconstruction.cameras[reference].clock
    for camera_id, camera in found.reconstruction.cameras.items():
        true = found.simulated.truth.cameras[camera_id].clock
        frame = float(np.median(camera.residuals.frame))
        # The same moment on both worlds' clocks, read through the reference camera's middle row.
        row = 0.5 * true0.height_px
        when = own0.world_time(true0.frame_at(true.world_time(frame, 0.5 * true.height_px), row), row)
        assert camera.clock.world_time(frame, 0.5 * true.height_px) == pytest.approx(when, abs=2e-3)
        assert camera.clock.period_s / own0.period_s == pytest.approx(true.period_s / true0.period_s, rel=5e-5)


def test_a_tie_of_seeds() -> None:
    """Another seed of the random sampling ends in the same place."""
    simulated = simulate(presets["demo"], np.random.default_rng(3))
    a, b = (compare(simulated, replace(Config(), seed=seed)) for seed in (0, 1))
    assert a.error_m.mean() == pytest.approx(b.error_m.mean(), rel=0.02)


@pytest.mark.parametrize("seed", [5, 6])
def test_the_order_of_cameras_does_not_matter(seed: int) -> None:
    """Another reference camera ends in the same place, by a small part of the deviation claimed."""
    simulated = simulate(presets["demo"], np.random.default_rng(seed))
    turned = replace(simulated, recordings=simulated.recordings[::-1])
    a, b = compare(simulated, Config()), compare(turned, Config())
    assert b.reconstruction.reference == simulated.recordings[-1].camera_id
    assert abs(a.error_m.mean() - b.error_m.mean()) <= 0.1 * np.median(a.sigma_m)


@pytest.mark.parametrize(
    ("preset", "word"),
    [
        ("hover", "hardly moves"),
        ("straight", "straight line"),
        ("coincident", "same direction"),
        ("line", "same direction"),
    ],
)
def test_degenerate_flights_are_named(preset: str, word: str) -> None:
    with pytest.raises(ReconstructionError, match=word) as error:
        recover(preset, 0)
    assert error.value.exit_code == 4
    assert error.value.hint
    assert error.value.counts


@pytest.mark.parametrize("seed", range(3))
def test_too_little_common_view_is_refused(seed: int) -> None:
    with pytest.raises(ReconstructionError, match="tied together") as error:
        recover("short_overlap", seed)
    assert error.value.stage == "synchronise"


def test_a_camera_of_another_flight_is_left_out_and_the_rest_delivered() -> None:
    simulated = simulate(presets["demo"], np.random.default_rng(0))
    stranger = simulate(presets["turns"], np.random.default_rng(9)).recordings[1]
    mixed = replace(simulated, recordings=(*simulated.recordings[:3], replace(stranger, camera_id="stranger")))
    found = compare(mixed, Config())
    assert set(found.reconstruction.cameras) == {"cam0", "cam1", "cam2"}
    assert "stranger" in found.reconstruction.unregistered
    assert found.reconstruction.unregistered["stranger"]
    assert found.error_m.mean() <= 1e-3 * found.extent_m
    summary = summarise(found.outcome, found.prepared, {})
    assert any("stranger" in text for text in summary["warnings"])


def test_a_grossly_wrong_frame_rate_is_found_and_said() -> None:
    simulated = simulate(presets["demo"], np.random.default_rng(2))
    wrong = simulated.recordings[2]
    wrong = replace(wrong, frame_rate_hz=wrong.frame_rate_hz * 1.3)
    recordings = (*simulated.recordings[:2], wrong, *simulated.recordings[3:])
    found = compare(replace(simulated, recordings=recordings), Config())
    assert all_registered(found)
    assert found.error_m.mean() <= 1e-3 * found.extent_m
    summary = summarise(found.outcome, found.prepared, {})
    assert any("frames a second" in text and wrong.camera_id in text for text in summary["warnings"])


def test_uneven_frames_without_time_stamps_are_estimated() -> None:
    """A clock that sways by 40 ms over half a minute, as a warm phone's."""
    simulated = simulate(presets["demo"], np.random.default_rng(4))
    recording = simulated.recordings[1]
    track = recording.tracks[0]
    sway = 0.04 * np.sin(2 * np.pi * track.frame / recording.frame_rate_hz / 30)
    frame = np.round(track.frame + sway * recording.frame_rate_hz)
    late, index = np.unique(frame.astype(int), return_index=True)
    swayed = replace(recording, tracks=(replace(track.select(index), frame=late),))
    recordings = (simulated.recordings[0], swayed, *simulated.recordings[2:])
    found = compare(replace(simulated, recordings=recordings), Config())
    assert set(found.outcome.wander) == {recording.camera_id}
    assert found.error_m.mean() <= 2e-3 * found.extent_m


def test_false_hints_do_no_harm() -> None:
    simulated = simulate(presets["demo"], np.random.default_rng(6))
    prepared = prepare_recordings(simulated.recordings, Config().clean)
    ends = []
    for given in ({}, {"cam0": 0.0, "cam1": 77.0, "cam2": -5.0}):
        hints = Hints(tuple(OffsetHint(c, offset_s) for c, offset_s in given.items()))
        ends.append(outcome(run(prepared.recordings, Config(), hints=hints)).reconstruction)
    for camera_id, camera in ends[0].cameras.items():
        assert camera.clock.offset_s == pytest.approx(ends[1].cameras[camera_id].clock.offset_s, abs=1e-3)


def test_two_cameras_alone() -> None:
    found = recover("demo", 0, n_cameras=2, noise_px=0.2)
    assert len(found.reconstruction.cameras) == 2
    assert np.median(found.error_m) <= 2e-2 * found.extent_m


def test_an_empty_camera_is_reported() -> None:
    simulated = simulate(presets["demo"], np.random.default_rng(0))
    empty = Recording("blind", simulated.recordings[0].intrinsics, 30.0, ())
    found = compare(replace(simulated, recordings=(*simulated.recordings, empty)), Config())
    assert found.reconstruction.unregistered["blind"] == "it has no usable detections"
