"""simulate, evaluate, demo and import, as a user chains them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from skytrace.simulation import presets

from .command import contents, skytrace
from .conftest import Finished


def test_simulate_is_the_same_for_a_seed(flight: Path, tmp_path: Path) -> None:
    options = ("--cameras", 3, "--duration", 40)
    assert skytrace("simulate", "-o", tmp_path / "a", *options, "--seed", 0).code == 0
    assert contents(tmp_path / "a") == contents(flight)
    assert skytrace("simulate", "-o", tmp_path / "b", *options, "--seed", 1).code == 0
    assert contents(tmp_path / "b") != contents(flight)


def test_simulate_options(tmp_path: Path) -> None:
    result = skytrace(
        "simulate", "-o", tmp_path / "f", "--preset", "turns", "--cameras", 5, "--duration", 12, "--noise", 2
    )
    assert (result.code, result.out, result.err) == (0, f"{tmp_path / 'f'}\n", "")
    scenario = json.loads((tmp_path / "f" / "truth" / "scenario.json").read_text())
    assert (scenario["motion"], scenario["n_cameras"], scenario["duration_s"], scenario["noise_px"]) == (
        "turns",
        5,
        12,
        2,
    )
    assert len(list((tmp_path / "f" / "detections").iterdir())) == 5


def test_an_unknown_preset_lists_all(tmp_path: Path) -> None:
    result = skytrace("simulate", "-o", tmp_path / "f", "--preset", "loopings")
    assert (result.code, result.out) == (3, "")
    assert "'loopings'" in result.message
    assert all(name in result.message for name in presets)
    assert list(tmp_path.iterdir()) == []


def test_an_impossible_scenario_says_why(tmp_path: Path) -> None:
    result = skytrace("simulate", "-o", tmp_path / "f", "--duration", 1e9)
    assert (result.code, result.out) == (3, "")
    assert "14400" in result.message
    assert list(tmp_path.iterdir()) == []


def test_evaluate_prints_the_table(finished: Finished) -> None:
    result = skytrace("evaluate", finished.run, "--flight", finished.flight)
    assert (result.code, result.err) == (0, "")
    for words in ("mean", "RMSE", "median", "max", ">3 RMSE", "10 x mean", "Covered:", "Scale:"):
        assert words in result.out
    assert "Camera centres" in result.out
    assert "Synchronisation with cam0" in result.out
    assert result.out.endswith("\n")
    assert not result.out.endswith("\n\n")


def test_evaluate_for_machines(finished: Finished) -> None:
    truth = finished.flight / "truth"
    result = skytrace(
        *("evaluate", finished.run, "--truth", truth / "trajectory.txt", "--rate", 5, "--json"),
        *("--positions", truth / "positions.csv", "--synchronisation", truth / "synchronisation.csv"),
        *("--orientations", truth / "cameras.json"),
    )
    assert (result.code, result.err) == (0, "")
    found = json.loads(result.out)
    assert found == json.loads(skytrace("evaluate", finished.run, "--flight", finished.flight, "--json").out)
    errors = found["trajectory"]["all"]
    assert 0 < errors["median"] <= errors["mean"] <= errors["rmse"] <= errors["max"] < 1
    assert errors["n"] >= 0.95 * errors["n_total"]
    assert found["synchronisation"]["mean_s"] < 5e-3
    assert set(found["camera_centres_aligned"]["by_camera"]) == {"cam0", "cam1", "cam2"}


def test_a_truth_with_time_stamps_needs_no_rate(finished: Finished, tmp_path: Path) -> None:
    """Its stamps count, though they jitter and have a gap; rows alone would be wrong by the gap."""
    rows = np.loadtxt(finished.flight / "truth" / "trajectory.txt")
    time_s = np.arange(len(rows)) / 5
    kept = (time_s < 15) | (time_s > 21)
    stamped = tmp_path / "truth.csv"
    lines = [f"{1000 + t:.3f},{x},{y},{z}" for t, (x, y, z) in zip(time_s[kept], rows[kept], strict=True)]
    stamped.write_text("\n".join(["time_s,x,y,z", *lines]))
    plain = json.loads(skytrace("evaluate", finished.run, "--flight", finished.flight, "--json").out)
    result = skytrace("evaluate", finished.run, "--truth", stamped, "--json")
    assert result.code == 0, result.err
    errors = json.loads(result.out)["trajectory"]["all"]
    assert errors["mean"] == pytest.approx(plain["trajectory"]["all"]["mean"], rel=0.2)
    assert errors["n_total"] == kept.sum()


def test_evaluate_without_anything_to_compare_with(finished: Finished, tmp_path: Path) -> None:
    truth = finished.flight / "truth" / "trajectory.txt"
    described = (finished.flight / "flight.toml").read_text().split("[truth]")[0]
    described = described.replace('= "calibration', f'= "{finished.flight}/calibration')
    (tmp_path / "flight.toml").write_text(described.replace('= "detections/', f'= "{finished.flight}/detections/'))
    (tmp_path / "empty.csv").write_text("time_s,x,y,z\n1,nan,nan,nan\n2,nan,nan,nan\n")
    (tmp_path / "milliseconds.csv").write_text("time_s,x,y,z\n0,1,2,3\n1,1,2,3\n2,1,2,3\n900000,1,2,3\n")
    cases = {
        ("--json",): "--truth FILE",
        ("--truth", truth): "--rate",
        ("--truth", tmp_path / "none.txt", "--rate", 5): "none.txt",
        ("--truth", tmp_path / "empty.csv"): "empty.csv",
        ("--truth", tmp_path / "milliseconds.csv"): "milliseconds.csv",
        ("--flight", tmp_path): "[truth]",
        ("--positions", truth): "camera,x,y,z",
        ("--synchronisation", truth): "camera,slope,intercept",
    }
    for options, words in cases.items():
        result = skytrace("evaluate", finished.run, *options)
        assert (result.code, result.out) == (3, ""), options
        assert words in result.message
    for no_run in (tmp_path / "nowhere", finished.flight):
        result = skytrace("evaluate", no_run, "--flight", finished.flight)
        assert (result.code, result.out) == (3, "")
        assert f"skytrace: {no_run}: " in result.message
        assert "run" in result.message


def test_the_demo_twice(tmp_path: Path) -> None:
    folder = tmp_path / "demo"
    outputs = []
    for _ in range(2):
        result = skytrace("demo", "-o", folder)
        assert result.code == 0, result.err
        outputs.append(result.out)
        assert "4 unsynchronised cameras" in result.out
        assert "Trajectory error (cm)" in result.out
        assert str(folder / "run" / "report.html") in result.out
        assert {path.name for path in folder.iterdir()} == {"flight", "run"}
        assert "Against the truth" in (folder / "run" / "report.html").read_text(encoding="utf-8")
    assert outputs[0] == outputs[1]
    mean_cm = float(outputs[0].split("all covered samples")[1].split()[0])
    assert 0.1 < mean_cm < 5


def test_the_demo_replaces_only_its_own_flight(flight: Path, tmp_path: Path) -> None:
    assert skytrace("simulate", "-o", tmp_path / "flight", "--duration", 5).code == 0
    before = contents(tmp_path)
    result = skytrace("demo", "-o", tmp_path)
    assert (result.code, result.out) == (3, "")
    assert str(tmp_path / "flight") in result.message
    assert contents(tmp_path) == before


def test_import_mvus_then_reconstruct(flight: Path, tmp_path: Path) -> None:
    """The paper's code keeps `x y frame`, and its configuration lists files beside an offset for each camera."""
    for k in range(3):
        frame, x, y = np.loadtxt(flight / "detections" / f"cam{k}.txt").T
        np.savetxt(tmp_path / f"track{k}.txt", np.column_stack([x, y, frame]), fmt="%.6f %.6f %d")
    config = {
        "necessary inputs": {
            "path_detections": [f"track{k}.txt" for k in range(3)],
            "path_cameras": [str(flight / "calibration" / f"cam{k}.json") for k in range(3)],
            "corresponding_frames": [0, 999, -999],
        },
        "optional inputs": {
            "ground_truth": {"filepath": str(flight / "truth" / "trajectory.txt"), "frequency": 5},
        },
    }
    (tmp_path / "mvus.json").write_text(json.dumps(config))
    result = skytrace("import", "mvus", tmp_path / "mvus.json", "-o", tmp_path / "flight")
    assert (result.code, result.out, result.err) == (0, f"{tmp_path / 'flight' / 'flight.toml'}\n", "")
    assert skytrace("reconstruct", tmp_path / "flight", "-o", tmp_path / "run").code == 0
    result = skytrace("evaluate", tmp_path / "run", "--flight", tmp_path / "flight", "--json")
    errors = json.loads(result.out)["trajectory"]["all"]
    assert errors["mean"] < 0.3
    assert errors["n"] >= 0.95 * errors["n_total"]


def test_import_mvus_says_what_is_wrong(tmp_path: Path) -> None:
    (tmp_path / "mvus.json").write_text('{\n"necessary inputs": {\n"path_cameras": ["a.json"],\n}}')
    for config, words in ((tmp_path / "none.json", "none.json"), (tmp_path / "mvus.json", "mvus.json:4: not valid")):
        result = skytrace("import", "mvus", config, "-o", tmp_path / "flight")
        assert (result.code, result.out) == (3, "")
        assert words in result.message
        assert not (tmp_path / "flight").exists()
