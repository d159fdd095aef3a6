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


def test_fix_focal_keeps_focal_lengths_and_no_more(finished: Finished, tmp_path: Path) -> None:
    cameras = reconstructed(finished.flight, tmp_path / "run", "--fix-focal")
    summary = json.loads((tmp_path / "run" / "summary.json").read_text("utf-8"))
    for camera_id, camera in cameras.items():
        calibration = json.loads((finished.flight / "calibration" / f"{camera_id}.json").read_text())
        assert camera["focal_px_refined"][0] == camera["focal_px_calibrated"][0]
        assert camera["distortion"] != calibration["distCoeff"]
        rows = summary["observability"][camera_id]
        assert [name for name, row in rows.items() if row["determined"] == "fixed" and name not in CLOCK] == [
            "focal_scale"
        ]
    assert mean_error_m(finished.flight, tmp_path / "run") < 0.5


CLOCK = ("offset_s", "rate")


def test_fix_lens_keeps_everything_of_the_lenses(finished: Finished, tmp_path: Path) -> None:
    cameras = reconstructed(finished.flight, tmp_path / "run", "--fix-lens")
    free = json.loads((finished.run / "cameras.json").read_text())["cameras"]
    for camera_id, camera in cameras.items():
        calibration = json.loads((finished.flight / "calibration" / f"{camera_id}.json").read_text())
        assert camera["focal_px_refined"] == camera["focal_px_calibrated"]
        assert camera["distortion"] == calibration["distCoeff"]
        assert camera["clock_sd"]["readout_s"] > 0
        assert free[camera_id]["focal_px_refined"] != free[camera_id]["focal_px_calibrated"]
    assert mean_error_m(finished.flight, tmp_path / "run") < 0.5


def test_the_automatic_weight_may_be_given_back(finished: Finished, tmp_path: Path) -> None:
    """The weight that summary.json tells, given by hand, gives the same trajectory; thirty times it, another."""
    weight = json.loads((finished.run / "summary.json").read_text())["adjustment"]["motion_prior_weight_relative"]
    same, stiff = tmp_path / "same", tmp_path / "stiff"
    reconstructed(finished.flight, same, "--motion-prior-weight", repr(weight))
    assert tomllib.loads((same / "config.toml").read_text())["adjust"]["motion_prior_weight"] == weight
    reconstructed(finished.flight, stiff, "--motion-prior-weight", repr(30 * weight))
    assert largest_change(finished.run, same) < 0.1 * largest_change(finished.run, stiff)
    summary = json.loads((stiff / "summary.json").read_text())
    assert summary["adjustment"]["motion_prior_weight_relative"] == pytest.approx(30 * weight, rel=0.05)


def test_coverage_may_be_asked_to_be_stricter(finished: Finished, tmp_path: Path) -> None:
    run = tmp_path / "run"
    result = skytrace("reconstruct", finished.flight, "-o", run, "--min-cameras", "3", "--max-sigma-ratio", "1.5")
    assert result.code == 0, result.err
    strict, usual = (json.loads((r / "summary.json").read_text()) for r in (run, finished.run))
    assert strict["covered_s"] < usual["covered_s"]
    assert strict["not_covered"]["too_uncertain_s"] > usual["not_covered"]["too_uncertain_s"]
    assert strict["not_covered"]["too_few_cameras_s"] >= usual["not_covered"]["too_few_cameras_s"]
    assert (read_run(run).n_cameras >= 3).all()
    for summary in (strict, usual):
        told = summary["not_covered"]
        cut_s = sum(value for name, value in told.items() if name != "seen_s")
        assert told["seen_s"] == pytest.approx(summary["covered_s"] + cut_s, abs=0.05 * (1 + len(summary["segments"])))
    settings = tomllib.loads((run / "config.toml").read_text())["coverage"]
    assert (settings["min_cameras"], settings["max_sigma_ratio"]) == (3, 1.5)


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (("--motion-prior-weight", "0"), 2, "above 0"),
        (("--motion-prior-weight", "nan"), 2, "above 0"),
        (("--motion-prior-weight", "1", "--motion-prior", "none"), 2, "no prior to weigh"),
        (("--max-sigma-ratio", "0.5"), 2, "from 1"),
        (("--max-sigma-ratio", "nan"), 2, "from 1"),
        (("--min-cameras", "1"), 2, "--min-cameras"),
        (("--min-cameras", "4"), 3, "the flight has 3 cameras"),
    ],
)
def test_options_that_make_no_sense(
    finished: Finished, tmp_path: Path, options: tuple[str, ...], code: int, said: str
) -> None:
    result = skytrace("reconstruct", finished.flight, "-o", tmp_path / "run", *options)
    assert result.code == code
    assert said in " ".join(result.err.split())
    assert not (tmp_path / "run").exists()
