"""`skytrace demo`: see it work, from nothing to a report, in one command."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from skytrace.cli.evaluate import TruthFiles
from skytrace.cli.files import write_text
from skytrace.cli.reconstruct import describe, reconstruct_flight
from skytrace.cli.report import page_with_truth
from skytrace.evaluation.table import format_table
from skytrace.io.atomic import check_replaceable
from skytrace.io.flight import FLIGHT_FILE
from skytrace.io.run_folder import REPORT, read_run
from skytrace.pipeline.config import Config
from skytrace.simulation import presets, simulate, write_flight

_NAME = "skytrace demo"


def demo_command(output: Path, seed: int) -> None:
    """Simulate, reconstruct blind, evaluate, print."""
    flight_folder, run_folder = output / "flight", output / "run"
    check_replaceable(run_folder)
    if _is_demo_flight(flight_folder):
        shutil.rmtree(flight_folder)
    simulated = simulate(presets["demo"], np.random.default_rng(seed))
    write_flight(simulated, flight_folder, name=_NAME)
    print(f"simulated    {len(simulated.recordings)} unsynchronised cameras in {flight_folder}", flush=True)
    print(describe(reconstruct_flight(flight_folder, run_folder, Config()), run_folder))
    print("\nAgainst the truth, which the reconstruction never saw:")
    files = TruthFiles(flight=flight_folder).with_flight()
    evaluation = files.judge(read_run(run_folder))
    print(format_table(evaluation), end="")
    page = run_folder / REPORT
    write_text(page, page_with_truth(page, page.read_text(encoding="utf-8"), evaluation, files))
    print(f"\nOpen {page} in a browser.")


def _is_demo_flight(folder: Path) -> bool:
    """Whether an earlier demo wrote a folder: a user's recordings and other simulations are not replaced."""
    written = folder / FLIGHT_FILE, folder / "truth" / "scenario.json"
    return all(f.is_file() for f in written) and written[0].read_text("utf-8").startswith(f'name = "{_NAME}"\n')
