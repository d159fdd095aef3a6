"""Synchronisation with hints: they decide what tracks leave open, and do nothing to what tracks are sure of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import datetime, timedelta

import numpy as np
import pytest

from skytrace.estimation.clean import CleanSettings
from skytrace.estimation.correspond import image_path
from skytrace.estimation.hint_ties import HINT_CONFIDENCE
from skytrace.estimation.hints import Hints, OffsetHint, SimultaneousHint, from_start_times
from skytrace.estimation.synchronize import Synchronisation, SyncSettings, weigh_offsets
from skytrace.model.track import Recording
from skytrace.pipeline.prepare import prepare_recordings
from skytrace.simulation import Scenario, SimulatedFlight, presets, simulate

FRAME_S = 1 / 30
READOUT_FRACTION = 0.6


def weigh(recordings: Sequence[Recording], hints: Hints | None = None) -> Synchronisation:
    prepared = prepare_recordings(recordings, CleanSettings()).recordings
    paths = {r.camera_id: image_path(r, READOUT_FRACTION) for r in prepared}
    return weigh_offsets(paths, SyncSettings(), np.random.default_rng(0), hints)


def start_s(flight: SimulatedFlight, camera_id: str) -> float:
    return flight.truth.cameras[camera_id].clock.offset_s


def camera_time_s(flight: SimulatedFlight, recording: Recording, world_s: float) -> float:
    """A camera's own time when its middle row is exposed, as image paths have it."""
    clock = flight.truth.cameras[recording.camera_id].clock
    frame = (world_s - clock.offset_s - 0.5 * clock.readout_s) / clock.period_s
    return (frame + 0.5 * READOUT_FRACTION) / recording.frame_rate_hz


def moment(
    flight: SimulatedFlight, recordings: Sequence[Recording], after_s: float, error_s: Mapping[str, float] | None = None
) -> SimultaneousHint:
    """One moment of the flight on the cameras' clocks, in some of them wrong."""
    world_s = flight.truth.motion.begin_s + after_s
    errors = error_s or {}
    times = {r.camera_id: camera_time_s(flight, r, world_s) + errors.get(r.camera_id, 0.0) for r in recordings}
    return SimultaneousHint(f"[[simultaneous]] after {after_s:g} s", times, 0.5 * FRAME_S)


def worst_error_s(flight: SimulatedFlight, recordings: Sequence[Recording], found: Synchronisation) -> float:
    middle_s = 0.5 * (flight.truth.motion.begin_s + flight.truth.motion.end_s)
    world = []
    for r in recordings:
        offset_s, rate = found.clocks[r.camera_id]
        world.append(offset_s + rate * camera_time_s(flight, r, middle_s))
    return max(world) - min(world)


@pytest.fixture(scope="module")
def twice() -> tuple[SimulatedFlight, list[Recording]]:
    """Camera 0 sees a figure twice, a minute apart; camera 1 sees it once: the first time, to the simulation."""
    flight = simulate(Scenario(n_cameras=2, duration_s=45.0, frame_rates_hz=(30.0,)), np.random.default_rng(2))
    first, second = flight.recordings
    (track,) = first.tracks
    again = np.concatenate([track.frame, track.frame + 1800])
    return flight, [
        replace(first, tracks=(replace(track, frame=again, xy_px=np.concatenate([track.xy_px] * 2)),)),
        second,
    ]


@pytest.mark.parametrize(("kind", "which"), [("offset_s", 0), ("offset_s", 1), ("start_time", 0), ("simultaneous", 1)])
def test_a_figure_flown_twice_is_decided_by_a_hint(kind: str, which: int, twice) -> None:
    flight, recordings = twice
    starts = {"cam0": start_s(flight, "cam0") - 60.0 * which + 0.4, "cam1": start_s(flight, "cam1")}
    if kind == "offset_s":
        hints = Hints(tuple(OffsetHint(c, s) for c, s in starts.items()))
    elif kind == "start_time":
        day = datetime(2024, 5, 3)
        hints = Hints(from_start_times({c: day + timedelta(seconds=s) for c, s in starts.items()}))
    else:
        hints = Hints((), (moment(flight, recordings, 20.0, {"cam0": 60.0 * which}),))
    found = weigh(recordings, hints)
    middle_s = flight.truth.motion.begin_s + 22.0
    offset_s, rate = found.clocks["cam1"]
    seen_s = camera_time_s(flight, recordings[0], middle_s) + 60.0 * which
    assert offset_s + rate * camera_time_s(flight, recordings[1], middle_s) == pytest.approx(seen_s, abs=FRAME_S)
    (pair,) = found.evidence
    assert pair.blind_confidence == pytest.approx(0.5, abs=0.05)
    assert pair.confidence > 0.95
    assert len(pair.rivals) == 1
    (warning,) = found.warnings
    assert "rests on the hints: their tracks alone make it sure to 50 %" in warning
    assert {v.verdict for v in found.hints} == {"agrees"}


@pytest.mark.parametrize("seed", range(2))
def test_a_wrong_hint_does_not_win_and_is_found_out(seed: int) -> None:
    scenario = Scenario(n_cameras=2, duration_s=70.0, outlier_fraction=0.03, clustered_fraction=0.02)
    flight = simulate(scenario, np.random.default_rng(seed))
    recordings = flight.recordings
    blind = weigh(recordings)
    assert blind.clocks
    for wrong_s in (-25.0, 4.0, 17.0):
        wrong = Hints(
            (OffsetHint("cam0", start_s(flight, "cam0")), OffsetHint("cam1", start_s(flight, "cam1") + wrong_s))
        )
        found = weigh(recordings, wrong)
        assert found.clocks == blind.clocks
        (warning,) = found.warnings
        assert f"that of cam1 is {abs(wrong_s):.1f}"[:-1] in warning
        assert {v.verdict for v in found.hints} == {"contradicted"}


def test_a_wrong_moment_is_found_out_beside_right_ones() -> None:
    flight = simulate(replace(presets["demo"], n_cameras=3), np.random.default_rng(3))
    recordings = flight.recordings
    right, wrong = (moment(flight, recordings, t, e) for t, e in ((20.0, None), (60.0, {"cam2": 0.5})))
    found = weigh(recordings, Hints((), (right, wrong)))
    assert [v.verdict for v in found.hints] == ["agrees", "contradicted"]
    (warning,) = found.warnings
    assert "after 60 s contradicts the tracks: by them cam2 took its frame 0.50 s later than cam0, cam1" in warning
    assert worst_error_s(flight, recordings, found) < FRAME_S


def test_moments_let_two_cameras_of_unknown_rate_be_tied() -> None:
    """Without hints two cameras alone are not searched over rates, and a rate eight times off is beyond any search."""
    flight = simulate(Scenario(n_cameras=2, duration_s=80.0), np.random.default_rng(5))
    first, second = flight.recordings
    recordings = [first, replace(second, frame_rate_hz=second.frame_rate_hz * 8)]
    assert weigh(recordings).clocks == {}
    found = weigh(recordings, Hints((), tuple(moment(flight, recordings, t) for t in (5.0, 60.0))))
    assert found.clocks["cam1"][1] == pytest.approx(8.0, rel=1e-3)
    assert worst_error_s(flight, recordings, found) < FRAME_S
    assert {v.verdict for v in found.hints} == {"agrees"}


def test_what_tracks_cannot_tell_is_taken_from_a_precise_hint_and_said() -> None:
    flight = simulate(replace(presets["straight"], n_cameras=3), np.random.default_rng(0))
    recordings = flight.recordings
    assert weigh(recordings).clocks == {}
    found = weigh(recordings, Hints((), (moment(flight, recordings, 10.0),)))
    assert set(found.clocks) == {"cam0", "cam1", "cam2"}
    assert worst_error_s(flight, recordings, found) < FRAME_S
    assert set(found.confidence.values()) == {HINT_CONFIDENCE}
    assert found.deviations["cam1"][0] == pytest.approx(np.sqrt(0.5) * FRAME_S, rel=0.2)
    assert len([w for w in found.warnings if "since their tracks do not tell the offset" in w]) == 2
    assert [v.verdict for v in found.hints] == ["relied on"]
    vague = Hints(tuple(OffsetHint(c, start_s(flight, c)) for c in ("cam0", "cam1", "cam2")))
    assert weigh(recordings, vague).clocks == {}


@pytest.mark.parametrize("seed", range(2))
def test_cameras_of_different_flights_are_not_tied_by_any_hint(seed: int) -> None:
    scenario = Scenario(n_cameras=2, duration_s=90.0)
    one, other = (simulate(scenario, np.random.default_rng([seed, k])) for k in range(2))
    recordings = [one.recordings[0], other.recordings[1]]
    middle = {r.camera_id: float(np.mean(r.tracks[0].frame)) / r.frame_rate_hz for r in recordings}
    found = weigh(recordings, Hints((), (SimultaneousHint("a flash", middle, 0.01),)))
    assert found.clocks == {}
    assert found.evidence == () or found.evidence[0].confidence < 0.95
    assert [v.verdict for v in found.hints] == ["contradicted"]
    assert "with it the tracks of cam0 and cam1 fit no geometry" in found.warnings[0]


def test_groups_without_a_common_view_are_joined_by_a_hint() -> None:
    scenario = Scenario(n_cameras=2, duration_s=60.0)
    one, other = (simulate(scenario, np.random.default_rng([7, k])) for k in range(2))
    late = [replace(r, camera_id=f"late{r.camera_id[-1]}") for r in other.recordings]
    recordings = [*one.recordings, *late]
    assert len(weigh(recordings).groups) == 2
    flash = SimultaneousHint("[[simultaneous]] 1", {"cam0": 500.0, "late1": 20.0}, 0.01)
    found = weigh(recordings, Hints((), (flash,)))
    (group,) = found.groups
    assert set(group) == {"cam0", "cam1", "late0", "late1"}
    offset_s, rate = group["late1"]
    assert offset_s + rate * 20.0 == pytest.approx(500.0, abs=1e-6)
    assert found.confidence["late0"] < 0.95 < found.confidence["cam1"]


def test_short_overlaps_become_usable_near_a_hint() -> None:
    """Twelve to eighteen seconds in common, which tracks alone never suffice for."""
    tied = 0
    for seed in range(4):
        scenario = Scenario(
            n_cameras=2, duration_s=105.0, watched_fraction=60.0 / 105.0, motion="smooth", speed_m_s=8.0
        )
        flight = simulate(scenario, np.random.default_rng(seed))
        assert weigh(flight.recordings).clocks == {}
        hints = Hints(tuple(OffsetHint(c, start_s(flight, c) + e, 0.3) for c, e in (("cam0", 0.2), ("cam1", -0.2))))
        found = weigh(flight.recordings, hints)
        if found.clocks:
            tied += 1
            assert worst_error_s(flight, flight.recordings, found) < FRAME_S
    assert tied >= 1
