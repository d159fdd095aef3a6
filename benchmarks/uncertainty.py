"""Claimed deviations beside true errors, on simulated flights reconstructed blind.

    python -m benchmarks.uncertainty [--seeds N] [--first-seed N] [--json FILE]

Calibrations, clocks and detections are as wrong as those of consumer cameras (preset "realistic"): every lens parameter
is off and detections drift for seconds. Positions are free up to a similarity and a clock, and deviations are claimed
for what remains after the best alignment of the whole trajectory in space and time: so the truth is aligned with the
estimate by least squares over the trajectory, and camera centres are compared under the same alignment. Clocks are
compared as told by the reference camera's, whose offset and rate are fixed.

For each quantity: the root mean square of error / claimed deviation (1 if claims are right), the median of its square
over that of the square of a normal deviate, and how many intervals of nominally 68 and 95 % hold the truth. A
position's error is its distance, its deviation the root of the summed variances; its square is compared with a
chi-square of three degrees of freedom over three.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from skytrace.errors import ReconstructionError
from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import align_similarity
from skytrace.pipeline.config import Config
from skytrace.pipeline.offline import Outcome, outcome, run
from skytrace.pipeline.prepare import prepare_recordings
from skytrace.simulation import Scenario, presets, simulate
from skytrace.simulation.cameras import TrueCamera
from skytrace.simulation.simulator import SimulatedFlight

_REALISTIC = presets["realistic"]
SCENARIOS: dict[str, Scenario] = {
    "smooth, 5 cameras": _REALISTIC,
    "legs, 4 cameras": replace(_REALISTIC, motion="legs", n_cameras=4, drift_px=0.7, drift_s=1.5),
    "turns, 3 cameras": replace(_REALISTIC, motion="turns", speed_m_s=9.0, n_cameras=3, drift_px=0.7),
    "climbs, 6 cameras": replace(_REALISTIC, motion="climbs", speed_m_s=8.0, altitude_m=35.0, n_cameras=6, drift_s=5.0),
    "smooth, 4 cameras, 2 px drift": replace(_REALISTIC, n_cameras=4, drift_px=2.0, drift_s=2.0),
    "smooth, 7 cameras": replace(_REALISTIC, n_cameras=7, drift_px=0.5, duration_s=200.0),
}
LENS = ("focal scale", "aspect", "principal point x", "principal point y", "k1", "k2", "k3")
QUANTITIES = ("trajectory", "camera centres", "clock offset", "clock period", "readout", *LENS)
SAMPLES_HZ = 2.0


def normalised_errors(simulated: SimulatedFlight, found: Outcome) -> dict[str, FloatArray]:
    """Errors over claimed deviations (n,) by quantity, of what is not held fixed."""
    reconstruction, truth = found.reconstruction, simulated.truth
    true0 = truth.cameras[reconstruction.reference].clock
    found0 = reconstruction.cameras[reconstruction.reference].clock
    slope = true0.period_s / found0.period_s  # seconds of true world time per second of the reconstruction's

    time_s = reconstruction.trajectory.sample_times(SAMPLES_HZ)
    true_time_s = true0.offset_s + slope * (time_s - found0.offset_s)
    flown = (true_time_s >= truth.motion.begin_s) & (true_time_s <= truth.motion.end_s)
    time_s, true_time_s = time_s[flown], true_time_s[flown]
    position, velocity = reconstruction.trajectory.position(time_s), reconstruction.trajectory.velocity(time_s)
    late = np.stack([velocity, velocity * (time_s - time_s.mean())[:, None]], axis=2)
    moved = np.zeros_like(position)
    for _ in range(3):
        world_from_truth = align_similarity(position - moved, truth.motion.position(true_time_s)).inverse()
        error = position - world_from_truth.apply(truth.motion.position(true_time_s))
        lag, drift = np.linalg.lstsq(late.reshape(-1, 2), error.ravel(), rcond=None)[0]
        moved = late @ [lag, drift]
    error = np.linalg.norm(error - moved, axis=1)
    out: dict[str, list[FloatArray]] = {name: [] for name in QUANTITIES}
    out["trajectory"].append(error / reconstruction.trajectory.sigma(time_s))
    for camera_id, camera in reconstruction.cameras.items():
        true_camera = truth.cameras[camera_id]
        centre = world_from_truth.apply(true_camera.camera_from_world.centre)
        out["camera centres"].append((camera.camera_from_world.centre - centre) / camera.centre_deviation)
        clock, deviation, true_clock = camera.clock, camera.clock_deviation, true_camera.clock
        true_offset_s = found0.offset_s + (true_clock.offset_s - true0.offset_s) / slope
        pairs = {
            "clock offset": (clock.offset_s - true_offset_s, deviation.offset_s),
            "clock period": (clock.period_s - true_clock.period_s / slope, deviation.period_s),
            "readout": (clock.readout_s - true_clock.readout_s / slope, deviation.readout_s),
        }
        index = found.adjusted.camera_ids.index(camera_id)
        lens_error = found.adjusted.state.lens[index] - true_lens_change(true_camera)
        pairs |= dict(zip(LENS, zip(lens_error, found.posterior.lens[index], strict=True), strict=True))
        for name, (wrong_by, claimed) in pairs.items():
            if claimed > 0:
                out[name].append(np.array([wrong_by / claimed]))
    return {name: np.concatenate(parts) if parts else np.zeros(0) for name, parts in out.items()}


def true_lens_change(camera: TrueCamera) -> FloatArray:
    """The change (7,) of the calibration that makes it true, in the adjustment's parameters (adjust.problem.LENS)."""
    true, given = camera.intrinsics, camera.calibrated
    focal, focal_y = np.log(true.focal_px / given.focal_px)
    principal = (true.principal_px - given.principal_px) / given.focal_px
    return np.array([focal, focal_y - focal, *principal, *(true.distortion - given.distortion)[[0, 1, 4]]])


def reconstructed(scenario: Scenario, seed: int | Sequence[int]) -> tuple[SimulatedFlight, Outcome]:
    """A simulated flight and its blind reconstruction."""
    simulated = simulate(scenario, np.random.default_rng(seed))
    config = Config()
    return simulated, outcome(run(prepare_recordings(simulated.recordings, config.clean).recordings, config))


def statistics(name: str, flights: list[FloatArray]) -> dict[str, float]:
    """Figures of the normalised errors of one quantity, every flight counting alike."""
    from scipy.stats import chi2

    degrees = 3 if name == "trajectory" else 1
    flights = [z for z in flights if len(z)]
    weight = np.concatenate([np.full(len(z), 1 / (len(z) * len(flights))) for z in flights])
    squared = np.concatenate(flights) ** 2
    order = np.argsort(squared)
    median = squared[order][np.searchsorted(np.cumsum(weight[order]), 0.5)]
    by_flight = np.array([np.mean(z**2) for z in flights])
    mean = float(by_flight.mean())
    return {
        "root mean square": np.sqrt(mean),
        "its standard error": float(by_flight.std(ddof=1) / np.sqrt(len(flights)) / (2 * np.sqrt(mean))),
        "median square / expected": float(median / (chi2.median(degrees) / degrees)),
        "in 68 %": 100 * float(weight[squared <= chi2.ppf(0.6827, degrees) / degrees].sum()),
        "in 95 %": 100 * float(weight[squared <= chi2.ppf(0.9545, degrees) / degrees].sum()),
        "flights": float(len(flights)),
    }


def flights(first_seed: int, seeds: int) -> Iterator[tuple[str, int, dict[str, FloatArray]]]:
    """(scenario, seed, normalised errors) of every flight that could be reconstructed."""
    for seed in range(first_seed, first_seed + seeds):
        for k, (name, scenario) in enumerate(SCENARIOS.items()):
            try:  # seeded apart, or all scenarios would have the same cameras
                yield name, seed, normalised_errors(*reconstructed(scenario, (seed, k)))
            except ReconstructionError as error:
                print(f"{name}, seed {seed}: {error}")


def print_table(rows: dict[str, dict[str, float]]) -> None:
    """A Markdown table of statistics by quantity."""
    headers = list(next(iter(rows.values())))
    print("| | " + " | ".join(headers) + " |\n" + "| --- " * (len(headers) + 1) + "|")
    for name, row in rows.items():
        print(f"| {name} | " + " | ".join(f"{row[key]:.3g}" for key in headers) + " |")


def main() -> None:
    """Reconstruct, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=6, help="flights of each scenario")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--json", type=Path, help="also write the figures here")
    arguments = parser.parse_args()
    found = list(flights(arguments.first_seed, arguments.seeds))
    rows = {name: statistics(name, [z[name] for _, _, z in found]) for name in QUANTITIES}
    print_table(rows)
    print("\nRoot mean square by scenario")
    by_scenario = {
        scenario: {
            name: statistics(name, [z[name] for s, _, z in found if s == scenario])["root mean square"]
            for name in QUANTITIES
        }
        for scenario in dict.fromkeys(s for s, _, _ in found)
    }
    print_table(by_scenario)
    if arguments.json:
        arguments.json.write_text(json.dumps({"all": rows, "by scenario": by_scenario}, indent=1) + "\n")


if __name__ == "__main__":
    main()
