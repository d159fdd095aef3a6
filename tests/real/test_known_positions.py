"""Surveyed camera positions of dataset3: four are given, the others and the trajectory's size are held out to judge."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from skytrace.cli.reconstruct import reconstruct_flight
from skytrace.datasets import write_dataset
from skytrace.io.flight import read_flight
from skytrace.io.run_folder import read_run
from skytrace.io.truth import read_true_positions
from skytrace.pipeline.config import Config
from skytrace.pipeline.judging import evaluate_files

pytestmark = pytest.mark.real

GIVEN = ("cam0", "cam1", "cam3", "cam5")


@pytest.fixture(scope="module")
def run(data_dir: Path, tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("known")
    flight = write_dataset("dataset3", "auto", data_dir, folder / "flight")
    surveyed = read_true_positions(flight.parent / "positions.csv")
    text = flight.read_text()
    for camera_id in GIVEN:
        line = f"position_m = {surveyed[camera_id].tolist()}\nposition_sigma_m = 0.05\n"
        text = text.replace(f'id = "{camera_id}"\n', f'id = "{camera_id}"\n{line}')
    flight.write_text(text)
    reconstruct_flight(flight, folder / "run", Config())
    return read_run(folder / "run"), surveyed, read_flight(flight).truth


def test_cameras_that_were_not_given_stand_where_they_were_surveyed(run):
    held, surveyed, _ = run
    assert (held.gauge, held.frame) == ("metric", "given")
    away = [np.array(held.cameras[c]["centre"]) - surveyed[c] for c in surveyed if c not in GIVEN]
    assert max(np.linalg.norm(a) for a in away) < 0.4
    deviations = [held.cameras[c]["centre_sd"] for c in surveyed if c not in GIVEN]
    assert 0.3 < np.sqrt(np.mean(np.square(np.array(away) / deviations))) < 2.5


def test_the_flight_has_its_true_size(run):
    """The truth is in a frame of its own, so that only its size can be compared, and its shape."""
    held, _, truth = run
    evaluation = evaluate_files(held, truth.trajectory, truth.rate_hz, None, None).trajectory
    assert evaluation is not None
    assert evaluation.complete.truth_from_world.scale == pytest.approx(1, abs=0.008)
    assert 100 * evaluation.complete.statistics.mean < 8.0
