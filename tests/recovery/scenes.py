"""Simulated flights reconstructed blind, and how far the outcome is from the truth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import align_similarity
from skytrace.model.reconstruction import Reconstruction
from skytrace.pipeline.config import Config
from skytrace.pipeline.offline import Outcome, outcome, run
from skytrace.pipeline.prepare import Prepared, prepare_recordings
from skytrace.simulation import Scenario, presets, simulate
from skytrace.simulation.simulator import SimulatedFlight


@dataclass(frozen=True, eq=False)
class Recovered:
    """A blind reconstruction beside its truth."""

    simulated: SimulatedFlight
    prepared: Prepared
    outcome: Outcome
    error_m: FloatArray  # (n,) at samples of the covered flight, after a similarity
    sigma_m: FloatArray  # (n,) claimed
    extent_m: float  # of the true flight

    @property
    def reconstruction(self) -> Reconstruction:
        return self.outcome.reconstruction


def recover(preset: str | Scenario, seed: int = 0, config: Config | None = None, **changes: Any) -> Recovered:
    """Simulate, reconstruct without any hint, compare."""
    scenario = presets[preset] if isinstance(preset, str) else preset
    simulated = simulate(replace(scenario, **changes), np.random.default_rng(seed))
    return compare(simulated, config or Config())


def compare(simulated: SimulatedFlight, config: Config) -> Recovered:
    prepared = prepare_recordings(simulated.recordings, config.clean)
    return judged(simulated, prepared, outcome(run(prepared.recordings, config)))


def judged(simulated: SimulatedFlight, prepared: Prepared, found: Outcome) -> Recovered:
    """An outcome beside the truth of its flight."""
    reconstruction, motion = found.reconstruction, simulated.truth.motion
    time = reconstruction.trajectory.sample_times(10.0)
    # The reconstruction's time is the reference camera's own; the truth knows when that is.
    true_clock = simulated.truth.cameras[reconstruction.reference].clock
    found_clock = reconstruction.cameras[reconstruction.reference].clock
    true_time = true_clock.offset_s + true_clock.period_s / found_clock.period_s * (time - found_clock.offset_s)
    flown = (true_time >= motion.begin_s) & (true_time <= motion.end_s)
    at, true = reconstruction.trajectory.position(time[flown]), motion.position(true_time[flown])
    truth_from_world = align_similarity(at, true)
    return Recovered(
        simulated,
        prepared,
        found,
        np.linalg.norm(truth_from_world.apply(at) - true, axis=1),
        truth_from_world.scale * reconstruction.trajectory.sigma(time[flown]),
        float(np.linalg.norm(np.ptp(true, axis=0))),
    )
