"""Blind synchronisation of simulated cameras: right or unsure, in groups where they are, hints found out."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from skytrace.cli import run as run_command
from skytrace.errors import ReconstructionError
from skytrace.estimation.clean import CleanSettings
from skytrace.estimation.correspond import image_path
from skytrace.estimation.hints import Hints, OffsetHint
from skytrace.estimation.synchronize import Synchronisation, SyncSettings, synchronize, weigh_offsets
from skytrace.model.track import Recording
from skytrace.pipeline.prepare import prepare_recordings
from skytrace.simulation import Scenario, SimulatedFlight, presets, simulate, write_flight

FRAME_S = 1 / 30
CLUTTERED = Scenario(n_cameras=3, duration_s=90.0, outlier_fraction=0.05, clustered_fraction=0.05)


def paths_of(recordings):
    prepared = prepare_recordings(recordings, CleanSettings()).recordings
    return {r.camera_id: image_path(r, 0.6) for r in prepared}


def find(recordings, hints: Hints | None = None) -> Synchronisation:
    return synchronize(paths_of(recordings), SyncSettings(), np.random.default_rng(0), hints)


def offsets(given_s: dict[str, float]) -> Hints:
    return Hints(tuple(OffsetHint(c, offset_s) for c, offset_s in given_s.items()))


def camera_time_s(flight: SimulatedFlight, recording: Recording, world_s: float) -> float:
    clock = flight.truth.cameras[recording.camera_id].clock
    frame = (world_s - clock.offset_s - 0.5 * clock.readout_s) / clock.period_s
    return (frame + 0.5 * 0.6) / recording.frame_rate_hz


def errors_s(flight: SimulatedFlight, recordings, found: Synchronisation) -> dict[str, float]:
    """How far each camera's clock is off in the middle of the flight."""
    middle_s = 0.5 * (flight.truth.motion.begin_s + flight.truth.motion.end_s)
    world = {
        r.camera_id: found.clocks[r.camera_id][0] + found.clocks[r.camera_id][1] * camera_time_s(flight, r, middle_s)
        for r in recordings
    }
    return {c: t - world[found.reference] for c, t in world.items()}


@pytest.mark.parametrize("seed", range(4))
def test_offsets_and_rates_through_clutter(seed: int) -> None:
    flight = simulate(CLUTTERED, np.random.default_rng(seed))
    # One camera's frame rate is stated 0.2 % wrong.
    recordings = [*flight.recordings[:2], replace(flight.recordings[2], frame_rate_hz=30.0 * 1.002)]
    found = find(recordings)
    assert max(abs(e) for e in errors_s(flight, recordings, found).values()) < FRAME_S
    assert min(found.confidence.values()) > 0.95
    assert all(0 < sigma_s < FRAME_S for c, (sigma_s, _) in found.deviations.items() if c != found.reference)
    assert not found.untied


def test_any_shift_of_a_camera_gives_the_same_result() -> None:
    flight = simulate(presets["demo"], np.random.default_rng(1))
    recordings = flight.recordings[:2]
    plain = find(recordings).clocks["cam1"]
    for frames in (5, 500, 10_000):
        (track,) = recordings[1].tracks
        moved = replace(recordings[1], tracks=(replace(track, frame=track.frame + frames),))
        offset_s, rate = find([recordings[0], moved]).clocks["cam1"]
        shift_s = frames / recordings[1].frame_rate_hz
        assert offset_s + rate * shift_s == pytest.approx(plain[0], abs=0.01 * FRAME_S)


@pytest.mark.parametrize("seed", range(3))
def test_cameras_of_different_flights_are_not_tied(seed: int) -> None:
    scenario = replace(CLUTTERED, n_cameras=2)
    one, other = (simulate(scenario, np.random.default_rng([seed, k])) for k in range(2))
    recordings = [one.recordings[0], other.recordings[1]]
    with pytest.raises(ReconstructionError, match="no two cameras can be tied together"):
        find(recordings)
    weighed = weigh_offsets(paths_of(recordings), SyncSettings(), np.random.default_rng(0))
    assert weighed.clocks == {}
    assert all(not p.accepted and p.confidence < 0.95 for p in weighed.evidence)


def test_two_groups_come_out_as_two_groups() -> None:
    scenario = replace(CLUTTERED, n_cameras=2, duration_s=80.0)
    one, other = (simulate(scenario, np.random.default_rng([7, k])) for k in range(2))
    names = iter("abcd")
    recordings = [replace(r, camera_id=next(names)) for flight in (one, other) for r in flight.recordings]
    found = find(recordings)
    assert [sorted(g) for g in found.groups] == [["a", "b"], ["c", "d"]]
    assert set(found.clocks) == {"a", "b"}
    assert "synchronised with d" in found.untied["c"]


def test_a_figure_flown_twice_is_said_to_be_ambiguous() -> None:
    """Camera 1 sees the figure once, camera 0 twice: either pass fits."""
    flight = simulate(Scenario(n_cameras=2, duration_s=45.0, frame_rates_hz=(30.0,)), np.random.default_rng(2))
    first, second = flight.recordings
    (track,) = first.tracks
    again = np.concatenate([track.frame, track.frame + 1800])
    twice = replace(first, tracks=(replace(track, frame=again, xy_px=np.concatenate([track.xy_px] * 2)),))
    weighed = weigh_offsets(paths_of([twice, second]), SyncSettings(), np.random.default_rng(0))
    (pair,) = weighed.evidence
    assert not pair.accepted
    assert pair.confidence < 0.95
    best_s = pair.offset_s + (pair.rate - 1) * track.frame.mean() / 30
    assert any(abs(abs(rival_s - best_s) - 60.0) < 0.5 for rival_s, _ in pair.rivals)


def test_wrong_hints_are_found_out_and_right_ones_are_not_blamed() -> None:
    flight = simulate(presets["demo"], np.random.default_rng(3))
    recordings = flight.recordings[:3]
    true_s = {r.camera_id: flight.truth.cameras[r.camera_id].clock.offset_s for r in recordings}
    assert find(recordings, offsets(true_s)).warnings == ()
    wrong = find(recordings, offsets({**true_s, "cam1": true_s["cam1"] + 12.0}))
    assert [w for w in wrong.warnings if "cam1" in w]
    assert len(wrong.warnings) == 1
    assert max(abs(e) for e in errors_s(flight, recordings, wrong).values()) < FRAME_S


def test_the_command_writes_what_it_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flight = simulate(replace(presets["demo"], n_cameras=3, duration_s=60.0), np.random.default_rng(4))
    write_flight(flight, tmp_path / "flight")
    assert run_command(["sync", str(tmp_path / "flight"), "-o", str(tmp_path / "sync.json"), "--json"]) == 0
    document = json.loads((tmp_path / "sync.json").read_text())
    assert json.loads(capsys.readouterr().out) == document
    assert set(document) == {"reference", "cameras", "groups", "pairs", "disagreement_s", "hints", "warnings"}
    assert len(document["pairs"]) == 3
    for camera in document["cameras"].values():
        assert camera["tied"]
        assert camera["confidence"] > 0.95
    assert sorted(p.name for p in tmp_path.iterdir()) == ["flight", "sync.json"]


@pytest.mark.parametrize("motion", ["hover", "straight"])
@pytest.mark.parametrize("seed", [0, 2, 3])
def test_flights_that_fix_no_offset_tie_nobody(motion: str, seed: int) -> None:
    flight = simulate(Scenario(motion=motion, duration_s=60.0), np.random.default_rng(seed))  # type: ignore[arg-type]
    paths = {r.camera_id: image_path(r, 0.6) for r in flight.recordings}
    with pytest.raises(ReconstructionError, match=r"hardly moves|straight line"):
        synchronize(paths, SyncSettings(), np.random.default_rng(0))
