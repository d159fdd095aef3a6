"""What known positions of cameras are worth: phone GPS and survey, on simulated flights reconstructed otherwise blind.

    python -m benchmarks.known_positions [--seeds N] [--first-seed N] [--json FILE]

Calibrations, clocks and detections err as those of consumer cameras do (preset "realistic"). By what is known: the
shape's error (root mean square distance after the best similarity), the error in the frame of the known positions
(none fitted but the flight's time), that of the scale and of the camera centres, and errors over claimed deviations
(root mean square over flights; 1 if claims are right), of which the trajectory's is also given with its time as it is.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from skytrace.estimation.known import Known, KnownDistance, KnownPosition, KnownUp
from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import align_similarity
from skytrace.pipeline.config import Config
from skytrace.pipeline.offline import Outcome, outcome, run
from skytrace.pipeline.prepare import prepare_recordings
from skytrace.simulation import presets, simulate
from skytrace.simulation.simulator import SimulatedFlight

FLIGHT = replace(presets["realistic"], n_cameras=5, duration_s=60.0)
SAMPLES_HZ = 2.0


def positions(simulated: SimulatedFlight, sigma_m: float, rng: np.random.Generator) -> tuple[KnownPosition, ...]:
    """All cameras' positions, off by independent errors that are stated."""
    return tuple(
        KnownPosition(c, camera.camera_from_world.centre + sigma_m * rng.normal(size=3), np.full(3, sigma_m))
        for c, camera in simulated.truth.cameras.items()
    )


def distance(simulated: SimulatedFlight, one: str, other: str, share: float, rng: np.random.Generator) -> KnownDistance:
    """The distance between two cameras, off by a share of it."""
    at = [simulated.truth.cameras[c].camera_from_world.centre for c in (one, other)]
    metres = float(np.linalg.norm(at[1] - at[0]))
    return KnownDistance((one, other), metres * (1 + share * float(rng.normal())), share * metres)


def verticals(simulated: SimulatedFlight, sigma_rad: float, rng: np.random.Generator) -> tuple[KnownUp, ...]:
    """What points up in every camera, as accelerometers tell it."""
    return tuple(
        KnownUp(c, camera.camera_from_world.rotation @ ([0, 0, 1] + sigma_rad * rng.normal(size=3)), sigma_rad)
        for c, camera in simulated.truth.cameras.items()
    )


KNOWLEDGE: dict[str, Callable[[SimulatedFlight, np.random.Generator], Known | None]] = {
    "nothing": lambda simulated, rng: None,
    "GPS, 3 m": lambda simulated, rng: Known(positions=positions(simulated, 3.0, rng)),
    "survey, 5 cm": lambda simulated, rng: Known(positions=positions(simulated, 0.05, rng)),
    "survey, 5 cm, two cameras": lambda simulated, rng: Known(
        positions=positions(simulated, 0.05, rng)[:2], ups=verticals(simulated, np.radians(1.0), rng)
    ),
}


def reconstructed(simulated: SimulatedFlight, known: Known | None) -> Outcome:
    """The flight reconstructed with this knowledge and nothing else."""
    config = Config()
    return outcome(run(prepare_recordings(simulated.recordings, config.clean).recordings, config, known=known))


@dataclass(frozen=True, eq=False, slots=True)
class Errors:
    """Errors of a flight in metres, and over claimed deviations."""

    shape_m: float
    absolute_m: float  # where the frame is known
    scale: float  # true over found, less 1
    centre_m: float
    trajectory: float  # absolute, over the deviations
    trajectory_timed: float  # the same after the best shift of time, which deviations leave out
    centres: float
    up: FloatArray  # (3,) the world's z in the true frame


def errors(simulated: SimulatedFlight, found: Outcome) -> Errors:
    """A reconstruction beside the truth."""
    reconstruction, truth = found.reconstruction, simulated.truth
    true0, found0 = (
        truth.cameras[reconstruction.reference].clock,
        reconstruction.cameras[reconstruction.reference].clock,
    )
    time_s = reconstruction.trajectory.sample_times(SAMPLES_HZ)
    true_time_s = true0.offset_s + true0.period_s / found0.period_s * (time_s - found0.offset_s)
    flown = (true_time_s >= truth.motion.begin_s) & (true_time_s <= truth.motion.end_s)
    time_s, true_time_s = time_s[flown], true_time_s[flown]
    position, velocity = reconstruction.trajectory.position(time_s), reconstruction.trajectory.velocity(time_s)
    true, sigma = truth.motion.position(true_time_s), reconstruction.trajectory.sigma(time_s)
    similarity = align_similarity(position, true)
    off = position - true
    late = np.stack([velocity, velocity * (time_s - time_s.mean())[:, None]], axis=2)
    timed = off - late @ np.linalg.lstsq(late.reshape(-1, 2), off.ravel(), rcond=None)[0]
    centres = [
        (camera.camera_from_world.centre - truth.cameras[c].camera_from_world.centre, camera.centre_deviation)
        for c, camera in reconstruction.cameras.items()
    ]
    return Errors(
        _rms(similarity.apply(position) - true),
        _rms(off),
        similarity.scale - 1,
        _rms(np.array([e for e, _ in centres])),
        float(np.sqrt(np.mean((off**2).sum(axis=1) / sigma**2))),
        float(np.sqrt(np.mean((timed**2).sum(axis=1) / sigma**2))),
        float(np.sqrt(np.mean([np.square(e / np.maximum(s, 1e-12)) for e, s in centres]))),
        similarity.rotation[:, 2],
    )


def _rms(error: FloatArray) -> float:
    return float(np.sqrt((error**2).sum(axis=1).mean()))


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    rows: dict[str, list[Errors]] = {name: [] for name in KNOWLEDGE}
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        simulated = simulate(FLIGHT, np.random.default_rng((11, seed)))
        for k, (name, knowledge) in enumerate(KNOWLEDGE.items()):
            rows[name].append(
                errors(simulated, reconstructed(simulated, knowledge(simulated, np.random.default_rng((seed, k)))))
            )
    print(f"{options.seeds} flights, {FLIGHT.n_cameras} cameras, {FLIGHT.duration_s:g} s; root mean squares")
    header = ("shape m", "absolute m", "scale %", "centres m", "trajectory z", "timed z", "centres z")
    print(f"{'known':<28}" + "".join(f"{title:>14}" for title in header))
    table = {}
    for name, found in rows.items():
        metric = name != "nothing"
        values = [
            float(np.sqrt(np.mean(np.square([getattr(e, field) for e in found]))))
            for field in ("shape_m", "absolute_m", "scale", "centre_m", "trajectory", "trajectory_timed", "centres")
        ]
        table[name] = dict(zip(header, values if metric else [values[0]], strict=False))
        values[2] *= 100
        print(f"{name:<28}" + "".join(f"{v:>14.3f}" for v in (values if metric else values[:1])))
    if options.json is not None:
        options.json.write_text(json.dumps(table, indent=2) + "\n")


if __name__ == "__main__":
    main()
