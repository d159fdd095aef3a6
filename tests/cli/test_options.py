"""The options of `skytrace reconstruct` change what they say, and nothing keeps them from reconstructing."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from skytrace.io.run_folder import read_run

from .command import skytrace
from .conftest import Finished


def reconstructed(flight: Path, run: Path, *options: str) -> dict[str, Any]:
    result = skytrace("reconstruct", flight, "-o", run, *options)
    assert result.code == 0, result.err
    cameras = json.loads((run / "cameras.json").read_text("utf-8"))["cameras"]
    assert all(camera["registered"] for camera in cameras.values())
    return cameras


def largest_change(a: Path, b: Path) -> float:
    """Between the positions of two runs of one flight, each in its own unit, away from their ends."""
    first, second = read_run(a), read_run(b)
    time_s = np.linspace(first.time_s[0] + 1, first.time_s[-1] - 1, 50)
    moved = [
        np.interp(time_s, first.time_s, first.position[:, k]) - np.interp(time_s, second.time_s, second.position[:, k])
        for k in range(3)
    ]
    return float(np.abs(moved).max())


def mean_error_m(flight: Path, run: Path) -> float:
    result = skytrace("evaluate", run, "--flight", flight, "--json")
    assert result.code == 0, result.err
    trajectory = json.loads(result.out)["trajectory"]["all"]
    assert trajectory["n"] >= 0.95 * trajectory["n_total"]
    return trajectory["mean"]


@pytest.mark.parametrize("prior", ["jerk", "force", "kinetic", "none"])
def test_motion_prior(finished: Finished, tmp_path: Path, prior: str) -> None:
    run = tmp_path / "run"
    reconstructed(finished.flight, run, "--motion-prior", prior)
    assert tomllib.loads((run / "config.toml").read_text())["adjust"]["motion_prior"] == prior
    # Not compared byte by byte: the other run's process may have used another number of threads in BLAS.
    assert (largest_change(finished.run, run) < 1e-6) == (prior == "jerk")
    assert mean_error_m(finished.flight, run) < 0.3


def test_no_rolling_shutter(finished: Finished, tmp_path: Path) -> None:
    cameras = reconstructed(finished.flight, tmp_path / "run", "--no-rolling-shutter")
    assert [c["clock_sd"]["readout_s"] for c in cameras.values()] == [0, 0, 0]
    for camera_id, camera in cameras.items():
        rate_hz = json.loads((finished.flight / "calibration" / f"{camera_id}.json").read_text())["fps"]
        assert camera["clock"]["readout_s"] == pytest.approx(0.6 / rate_hz, rel=1e-3)
    free = json.loads((finished.run / "cameras.json").read_text())["cameras"]
    assert all(c["clock_sd"]["readout_s"] > 0 for c in free.values())
    assert mean_error_m(finished.flight, tmp_path / "run") < 0.3


def test_fix_focal(finished: Finished, tmp_path: Path) -> None:
    cameras = reconstructed(finished.flight, tmp_path / "run", "--fix-focal")
    free = json.loads((finished.run / "cameras.json").read_text())["cameras"]
    for camera_id, camera in cameras.items():
        calibration = json.loads((finished.flight / "calibration" / f"{camera_id}.json").read_text())
        assert camera["focal_px_refined"] == camera["focal_px_calibrated"]
        assert camera["distortion"] == calibration["distCoeff"]
        assert camera["clock_sd"]["readout_s"] > 0
        assert free[camera_id]["focal_px_refined"] != free[camera_id]["focal_px_calibrated"]
    assert mean_error_m(finished.flight, tmp_path / "run") < 0.5
