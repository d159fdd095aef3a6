"""The paper's synchronisation from rough offsets, and offsets taken as given, on simulated flights."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from skytrace.errors import ReconstructionError
from skytrace.estimation.adjust.settings import Freedom
from skytrace.estimation.clean import CleanSettings
from skytrace.estimation.correspond import ImagePath, image_path
from skytrace.estimation.given_offsets import given_synchronisation
from skytrace.estimation.growing_steps import GrowingSteps, synchronise_by_growing_steps
from skytrace.estimation.hints import Hints, OffsetHint
from skytrace.estimation.sync_settings import SyncSettings
from skytrace.estimation.synchronize import synchronize
from skytrace.pipeline.config import Config
from skytrace.pipeline.offline import Outcome, outcome, run
from skytrace.pipeline.prepare import prepare_recordings
from skytrace.simulation import Scenario, SimulatedFlight, simulate

FRAME_S = 1 / 30
MOTIONS = ("smooth", "legs", "turns", "climbs")
PAPER = replace(SyncSettings(), method="paper")


@cache
def flight(seed: int, n_cameras: int = 2) -> SimulatedFlight:
    scenario = Scenario(
        n_cameras=n_cameras,
        duration_s=60.0,
        motion=MOTIONS[seed % len(MOTIONS)],
        outlier_fraction=0.05,
        clustered_fraction=0.05,
    )
    return simulate(scenario, np.random.default_rng([3, seed]))


def prepared(simulated: SimulatedFlight):
    return prepare_recordings(simulated.recordings, CleanSettings()).recordings


@cache
def paths(seed: int, n_cameras: int = 2) -> dict[str, ImagePath]:
    return {r.camera_id: image_path(r, 0.6) for r in prepared(flight(seed, n_cameras))}


def middle_s(simulated: SimulatedFlight) -> dict[str, float]:
    """Every camera's own time in the middle of the flight."""
    motion = simulated.truth.motion
    world_s, out = 0.5 * (motion.begin_s + motion.end_s), {}
    for r in simulated.recordings:
        clock = simulated.truth.cameras[r.camera_id].clock
        frame = (world_s - clock.offset_s - 0.5 * clock.readout_s) / clock.period_s
        out[r.camera_id] = (frame + 0.5 * 0.6) / r.frame_rate_hz
    return out


def rough(simulated: SimulatedFlight, frames: dict[str, float]) -> Hints:
    """Offsets that are right in the middle of the flight but for so many frames."""
    time_s = middle_s(simulated)
    return Hints(tuple(OffsetHint(c, -t + frames.get(c, 0.0) * FRAME_S) for c, t in time_s.items()))


def pair(seed: int, frames: float) -> tuple[GrowingSteps, float]:
    """A pair from a rough offset, and by how many frames the outcome is wrong in the middle of the flight."""
    time0_s, time1_s = middle_s(flight(seed)).values()
    path0, path1 = paths(seed).values()
    offset_s = time1_s - time0_s + frames * FRAME_S
    found = synchronise_by_growing_steps(path0, path1, offset_s, PAPER, np.random.default_rng(0))
    g = found.geometry
    return found, np.inf if g is None else (g.offset_s + g.rate * time0_s - time1_s) / FRAME_S


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("frames", [0, 5, -10, 20, -35])
def test_a_shift_of_tens_of_frames_is_recovered(seed: int, frames: float) -> None:
    found, error_frames = pair(seed, frames)
    assert found.failure == ""
    assert abs(error_frames) < 1
    shares = [i.inlier_share for i in found.iterates]
    assert shares == sorted(shares)
    total_s = sum(i.shift_s for i in found.iterates)
    assert total_s == pytest.approx(-frames * FRAME_S, abs=3 * FRAME_S)


def test_a_larger_shift_takes_a_longer_step() -> None:
    steps = [abs(pair(1, frames)[0].iterates[0].step_s) for frames in (2, 10, 40)]
    assert steps == sorted(steps)
    assert steps[0] < steps[-1]


@pytest.mark.parametrize(("seed", "frames"), [(0, 600), (1, -600), (2, 1500)])
def test_a_far_shift_is_a_failure(seed: int, frames: float) -> None:
    found, _ = pair(seed, frames)
    assert found.geometry is None
    assert "rough offset" in found.failure or "in common view" in found.failure


def test_cameras_are_tied_from_rough_offsets() -> None:
    simulated = flight(0, 3)
    hints = rough(simulated, {"cam1": 12.0, "cam2": -15.0})
    found = synchronize(paths(0, 3), PAPER, np.random.default_rng(0), hints)
    time_s = middle_s(simulated)
    world_s = {c: found.clocks[c][0] + found.clocks[c][1] * time_s[c] for c in time_s}
    for c in ("cam1", "cam2"):
        assert world_s[c] - world_s["cam0"] == pytest.approx(0, abs=FRAME_S)
        assert found.confidence[c] > 0.95
    assert found.warnings == ()


def test_a_camera_out_of_reach_is_left_out_and_all_of_them_a_failure() -> None:
    simulated = flight(0, 3)
    found = synchronize(paths(0, 3), PAPER, np.random.default_rng(0), rough(simulated, {"cam2": 900.0}))
    assert set(found.clocks) == {"cam0", "cam1"}
    assert "its rough offset" in found.untied["cam2"]
    with pytest.raises(ReconstructionError, match="from the rough offsets"):
        synchronize(paths(0), PAPER, np.random.default_rng(0), rough(flight(0), {"cam1": 900.0}))


def test_a_camera_without_a_rough_offset_is_named() -> None:
    hints = Hints(rough(flight(0), {}).offsets[:1])
    with pytest.raises(ValueError, match="none of cam1"):
        synchronize(paths(0), PAPER, np.random.default_rng(0), hints)
    with pytest.raises(ValueError, match="none of cam1"):
        given_synchronisation(paths(0), hints, SyncSettings())
    with pytest.raises(ValueError, match="given_offsets"):
        synchronize(paths(0), replace(PAPER, method="given"), np.random.default_rng(0))


def reconstructed(freedom: Freedom, hints: Hints) -> Outcome:
    config = Config(synchronise=replace(SyncSettings(), method="given"), freedom=freedom)
    return outcome(run(prepared(flight(0, 3)), config, hints=hints))


def test_given_offsets_are_corrected_by_the_adjustment_only_where_clocks_are_free() -> None:
    simulated = flight(0, 3)
    hints = rough(simulated, {"cam1": 3.0})
    offset_s = hints.offsets_s
    time_s = middle_s(simulated)
    for free in (True, False):
        found = reconstructed(Freedom(clocks=free), hints)
        given = found.synchronisation.clocks
        assert given["cam1"] == (pytest.approx(offset_s["cam1"] - offset_s["cam0"], abs=1e-12), 1.0)
        assert "those given" in found.synchronisation.warnings[0]
        for recording in simulated.recordings:
            c = recording.camera_id
            clock = found.reconstruction.cameras[c].clock
            rate = clock.period_s * recording.frame_rate_hz
            moved_s = clock.offset_s + rate * time_s[c] - (given[c][0] + time_s[c])
            if not free:
                assert moved_s == pytest.approx(0, abs=1e-9)
                assert found.reconstruction.cameras[c].clock_deviation.offset_s == 0
            elif c == "cam1":
                assert moved_s == pytest.approx(-3 * FRAME_S, abs=0.5 * FRAME_S)


def test_given_offsets_that_leave_nothing_in_common_are_a_failure() -> None:
    hints = rough(flight(0), {"cam1": 9000.0})
    with pytest.raises(ReconstructionError, match="at the offsets given"):
        given_synchronisation(paths(0), hints, SyncSettings())
