"""`skytrace demo`: see it work, from nothing to a report, in one command."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from skytrace.cli.evaluate import evaluate_truth
from skytrace.cli.reconstruct import describe, reconstruct_flight
from skytrace.evaluation.table import format_table
from skytrace.io.atomic import check_replaceable
from skytrace.io.flight import read_flight
from skytrace.pipeline.config import Config
from skytrace.simulation import presets, simulate, write_flight


def demo_command(output: Path, seed: int) -> None:
    """Simulate, reconstruct blind, evaluate, print."""
    flight_folder, run_folder = output / "flight", output / "run"
    check_replaceable(run_folder)
    if (flight_folder / "truth" / "scenario.json").is_file():  # an earlier demo's, not a user's recording
        shutil.rmtree(flight_folder)
    simulated = simulate(presets["demo"], np.random.default_rng(seed))
    flight = read_flight(write_flight(simulated, flight_folder, name="demo"))
    print(f"simulated    {len(flight.cameras)} unsynchronised cameras in {flight_folder}")
    print(describe(reconstruct_flight(flight, run_folder, Config()), run_folder))
    assert flight.truth is not None  # the simulator always writes it
    print("\nAgainst the truth, which the reconstruction never saw:")
    print(format_table(evaluate_truth(run_folder, flight.truth)))
