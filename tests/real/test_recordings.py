"""Bands on the public recordings: blind, default configuration, the whole command in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from skytrace.datasets import DATASETS, Labels, write_dataset
from skytrace.evaluation.summary import Evaluation
from skytrace.io.flight import read_flight
from skytrace.io.run_folder import RunFolder, read_run
from skytrace.pipeline.judging import evaluate_files

pytestmark = pytest.mark.real

# (cpu seconds, peak MiB) that a whole command may take, start-up included.
BUDGET = {"dataset1": (30, 1024), "dataset3": (60, 1024), "dataset4": (60, 1024)}
# Mean error in cm with nothing dropped, covered samples of the truth.
ACCURACY = {
    ("dataset1", "auto"): (7.5, 519),
    ("dataset1", "manual"): (7.5, 519),
    ("dataset3", "auto"): (8.0, 2285),
    ("dataset3", "manual"): (8.0, 2285),
}


@dataclass(frozen=True)
class Command:
    """A finished `skytrace reconstruct`."""

    run: RunFolder
    evaluation: Evaluation | None
    cpu_s: float
    peak_mib: float

    @property
    def mean_cm(self) -> float:
        assert self.evaluation is not None
        assert self.evaluation.trajectory is not None
        return 100 * self.evaluation.trajectory.complete.statistics.mean

    @property
    def n_covered(self) -> int:
        assert self.evaluation is not None
        assert self.evaluation.trajectory is not None
        return self.evaluation.trajectory.complete.statistics.n


def reconstruct(flight: Path, output: Path, *options: str) -> Command:
    arguments = [sys.executable, "-m", "skytrace", "reconstruct", str(flight), "-o", str(output), *options]
    with open(output.with_suffix(".log"), "wb") as log:
        process = subprocess.Popen(arguments, stdout=log, stderr=log)
        _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0, output.with_suffix(".log").read_text()
    run, truth = read_run(output), read_flight(flight).truth
    evaluation = None
    if truth is not None:
        evaluation = evaluate_files(run, truth.trajectory, truth.rate_hz, truth.positions, truth.synchronisation)
    return Command(run, evaluation, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024)


@pytest.fixture(scope="module")
def commands(data_dir: Path, tmp_path_factory: pytest.TempPathFactory):
    """Runs each recording once and remembers it."""
    done: dict[tuple[Any, ...], Command] = {}
    folder = tmp_path_factory.mktemp("real")

    def get(dataset: str, labels: Labels, cameras: tuple[int, ...] | None = None, seed: int = 0) -> Command:
        key = (dataset, labels, cameras, seed)
        if key not in done:
            name = "_".join([dataset, labels, str(seed), *map(str, cameras or ())])
            flight = write_dataset(dataset, labels, data_dir, folder / name, cameras)
            done[key] = reconstruct(flight, folder / f"{name}_run", "--seed", str(seed))
        return done[key]

    return get


@pytest.mark.parametrize("labels", ["auto", "manual"])
@pytest.mark.parametrize("dataset", list(BUDGET))
def test_every_camera_is_registered_within_budget(commands, dataset: str, labels: Labels) -> None:
    done = commands(dataset, labels)
    cpu_s, peak_mib = BUDGET[dataset]
    assert all(camera["registered"] for camera in done.run.cameras.values())
    assert len(done.run.cameras) == len(DATASETS[dataset].devices)
    assert done.cpu_s <= cpu_s
    assert done.peak_mib <= peak_mib
    for camera_id, camera in done.run.cameras.items():
        assert camera["reprojection_median_px"] <= 2.0, camera_id


@pytest.mark.parametrize(("dataset", "labels"), list(ACCURACY))
def test_trajectory_is_accurate_where_it_is_claimed(commands, dataset: str, labels: Labels) -> None:
    done = commands(dataset, labels)
    mean_cm, n_covered = ACCURACY[dataset, labels]
    assert done.mean_cm <= mean_cm
    assert done.n_covered >= n_covered


@pytest.mark.parametrize("labels", ["auto", "manual"])
def test_dataset4_is_covered(commands, labels: Labels) -> None:
    segments = commands("dataset4", labels).run.summary["segments"]
    assert sum(s["end_s"] - s["begin_s"] for s in segments) >= 316


@pytest.mark.parametrize("labels", ["auto", "manual"])
def test_dataset3_camera_centres(commands, labels: Labels) -> None:
    evaluation = commands("dataset3", labels).evaluation
    assert evaluation.centres_aligned.mean <= 0.30
    assert evaluation.centres_aligned.max <= 0.60


def test_dataset3_clocks_agree_with_the_led_flashes(commands) -> None:
    """Within what remains of a readout: the flashes were read at the row of the LED."""
    errors = commands("dataset3", "auto").evaluation.synchronisation
    assert errors.mean_frames_30fps <= 0.6
    assert all(e.mean_frames_30fps <= 1.3 for e in errors.error.values())


@pytest.mark.parametrize("dataset", ["dataset1", "dataset3"])
def test_seeds_agree(commands, dataset: str) -> None:
    means = [commands(dataset, "auto", seed=seed).mean_cm for seed in (0, 1, 2)]
    assert np.ptp(means) <= 0.5
    assert max(means) <= ACCURACY[dataset, "auto"][0]


@pytest.mark.parametrize("left_out", range(6))
def test_dataset3_without_any_one_camera(commands, left_out: int) -> None:
    done = commands("dataset3", "auto", tuple(k for k in range(6) if k != left_out))
    assert all(camera["registered"] for camera in done.run.cameras.values())
    assert done.mean_cm <= 12
    assert done.n_covered >= 1500


# Ten of the twenty triples, drawn by numpy.random.default_rng(0).permutation(20).
TRIPLES = [(0, 2, 3), (3, 4, 5), (0, 2, 5), (0, 1, 4), (1, 3, 4), (2, 3, 4), (0, 1, 5), (1, 2, 4), (1, 2, 3), (0, 3, 5)]


@pytest.mark.parametrize("cameras", TRIPLES)
def test_dataset3_triples_are_accurate_or_say_that_they_are_not(commands, cameras: tuple[int, ...]) -> None:
    done = commands("dataset3", "auto", cameras)
    warned = any("geometry is weak" in text for text in done.run.summary["warnings"])
    assert done.mean_cm <= 25 or warned
    assert done.n_covered >= 1000


def test_most_triples_are_accurate(commands) -> None:
    means = [commands("dataset3", "auto", cameras).mean_cm for cameras in TRIPLES]
    assert sum(mean <= 25 for mean in means) >= 9


def test_outputs_say_what_they_are(commands) -> None:
    run = commands("dataset3", "auto").run
    assert run.reference == "cam0"
    assert json.loads((run.path / "cameras.json").read_text())["reference"] == "cam0"
    assert run.cameras["cam0"]["clock"]["offset_s"] == pytest.approx(0, abs=1e-9)
    assert np.allclose(run.cameras["cam0"]["centre"], 0, atol=1e-9)
    assert np.diff(run.time_s).max(initial=0) > 0
    within = np.diff(run.time_s)[np.diff(run.segment) == 0]
    assert within.max() <= 1 / 25 + 1e-9
    assert set(run.summary["timings_s"]) >= {"synchronise", "grow", "adjust"}
