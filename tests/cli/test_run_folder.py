"""`skytrace reconstruct` writes a complete RUN, prints what it found, and does both the same way every time."""

from __future__ import annotations

import hashlib
import json
import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from skytrace import __version__
from skytrace.cli.progress import STAGES
from skytrace.pipeline.config import Config

from .command import STAGE_LINE, contents, python, skytrace
from .conftest import Finished

HEADER = "time_s,x,y,z,vx,vy,vz,sigma,n_cameras,segment"


def read_json(path: Path) -> Any:
    def refuse(constant: str) -> None:
        raise AssertionError(f"{path}: {constant} is not JSON")

    return json.loads(path.read_text("utf-8"), parse_constant=refuse)


def is_numbers(value: object, *shape: int) -> bool:
    array = np.array(value, float)
    return array.shape == shape and bool(np.isfinite(array).all())


def trajectory(run: Path) -> tuple[list[str], np.ndarray]:
    lines = (run / "trajectory.csv").read_text("utf-8").splitlines()
    comments = [line for line in lines if line.startswith("#")]
    assert lines[: len(comments)] == comments
    assert lines[len(comments)] == HEADER
    return comments, np.array([[float(cell) for cell in line.split(",")] for line in lines[len(comments) + 1 :]])


def test_the_folder_is_complete(finished: Finished) -> None:
    files = {"trajectory.csv", "cameras.json", "summary.json", "report.html", "config.toml", "manifest.json"}
    assert set(contents(finished.run)) == files
    assert "<html" in (finished.run / "report.html").read_text("utf-8")[:500].lower()
    # A flight and a run lie there: no hidden rest of writing.
    assert {p.name for p in finished.run.parent.iterdir()} >= {"flight", "run"}
    assert not [p.name for p in finished.run.parent.iterdir() if p.name.startswith(".")]


def test_the_trajectory(finished: Finished) -> None:
    comments, rows = trajectory(finished.run)
    assert any("gauge: arbitrary" in c for c in comments)
    assert any("unit" in c for c in comments)
    assert any("frame" in c for c in comments)
    assert any("camera cam0" in c for c in comments)
    time_s, position, velocity, segment = rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 9]
    assert np.isfinite(rows).all()
    assert (np.diff(time_s) > 0).all()
    assert set(np.diff(segment)) <= {0, 1}
    assert segment[0] == 0
    inside = np.diff(segment) == 0
    assert np.diff(time_s)[inside].max() <= 1 / 25 + 1e-9
    steps = np.diff(position, axis=0)[inside] / np.diff(time_s)[inside, None]
    mean_velocity = (0.5 * (velocity[1:] + velocity[:-1]))[inside]
    assert np.abs(steps - mean_velocity).max() <= 0.02 * np.abs(velocity).max()
    assert (rows[:, 7] > 0).all()
    assert np.isin(rows[:, 8], (0, 1, 2, 3)).all()
    assert (rows[:, 8] >= 2).mean() > 0.9
    covered_s = sum(np.ptp(time_s[segment == k]) for k in set(segment))
    assert covered_s >= 0.9 * 40
    summary = read_json(finished.run / "summary.json")
    assert covered_s == pytest.approx(summary["covered_s"], abs=1e-6)
    assert len(summary["segments"]) == len(set(segment))


def test_the_cameras(finished: Finished) -> None:
    table = read_json(finished.run / "cameras.json")
    assert set(table) == {"reference", "gauge", "cameras"}
    assert table["reference"] == "cam0"
    assert list(table["cameras"]) == ["cam0", "cam1", "cam2"]
    for camera_id, camera in table["cameras"].items():
        designed = {
            "registered",
            "reason",
            "clock",
            "clock_sd",
            "rotation_camera_from_world",
            "centre",
            "centre_sd",
            "focal_px_calibrated",
            "focal_px_refined",
            "distortion",
            "reprojection_median_px",
            "n_used",
        }
        assert set(camera) == designed | {"principal_px", "size_px", "sigma_px", "n_inliers", "lens_model"}
        assert camera["registered"] is True
        assert camera["reason"] is None
        for clock in ("clock", "clock_sd"):
            assert set(camera[clock]) == {"offset_s", "period_s", "readout_s"}
            assert all(math.isfinite(v) and v >= 0 for v in camera[clock].values())
        rotation = np.array(camera["rotation_camera_from_world"])
        assert is_numbers(rotation, 3, 3)
        assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1)
        assert is_numbers(camera["centre"], 3)
        assert is_numbers(camera["centre_sd"], 3)
        for focal in ("focal_px_calibrated", "focal_px_refined"):
            assert is_numbers(camera[focal], 2)
        assert is_numbers(camera["distortion"], 5)
        assert 0 < camera["reprojection_median_px"] < 1
        assert isinstance(camera["n_used"], int)
        calibration = read_json(finished.flight / "calibration" / f"{camera_id}.json")
        assert camera["focal_px_calibrated"] == [calibration["K-matrix"][0][0], calibration["K-matrix"][1][1]]
        detections = (finished.flight / "detections" / f"{camera_id}.txt").read_text().splitlines()
        assert 0.8 * len(detections) < camera["n_inliers"] <= camera["n_used"] <= len(detections)


def test_the_summary(finished: Finished) -> None:
    summary = read_json(finished.run / "summary.json")
    assert (summary["gauge"], summary["reference"]) == ("arbitrary", "cam0")
    assert set(summary["timings_s"]) == set(STAGES) - {"write"}
    assert all(math.isfinite(t) and t >= 0 for t in summary["timings_s"].values())
    assert summary["timings_s"]["read"] > 1e-3
    assert set(summary["cameras"]) == {"cam0", "cam1", "cam2"}
    table = read_json(finished.run / "cameras.json")["cameras"]
    for camera_id, camera in summary["cameras"].items():
        assert camera["n_used"] == table[camera_id]["n_used"]
        assert camera["reprojection_median_px"] == table[camera_id]["reprojection_median_px"]
        assert camera["n_used"] + sum(camera["dropped"].values()) <= camera["n_detections"]
        assert sum(camera["dropped"].values()) > 0  # 3 % of the detections are false
        observed = summary["observability"][camera_id]
        assert {"rate", "readout_s", "focal_scale"} <= set(observed)
        for verdict in observed.values():
            assert {"value", "prior_sd", "posterior_sd", "determined"} <= set(verdict)
            assert isinstance(verdict["determined"], str)
    assert all(isinstance(text, str) for text in summary["warnings"])
    for segment in summary["segments"]:
        assert segment["end_s"] - segment["begin_s"] >= 1


def test_the_manifest_and_the_configuration(finished: Finished) -> None:
    manifest = read_json(finished.run / "manifest.json")
    assert manifest["seed"] == 0
    assert manifest["versions"]["skytrace"] == __version__
    assert {"python", "numpy", "scipy", "numba", "poselib"} <= set(manifest["versions"])
    read = [finished.flight / "flight.toml"]
    read += [finished.flight / f"{kind}/cam{k}.{end}" for k in range(3) for kind, end in READ_FILES]
    hashes = {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in read}
    assert manifest["inputs"] == hashes
    resolved = tomllib.loads((finished.run / "config.toml").read_text("utf-8"))
    expected = json.loads(json.dumps(Config().as_dict()))
    assert resolved == without_none(expected)


READ_FILES = (("calibration", "json"), ("detections", "txt"))


def without_none(value: Any) -> Any:
    return {k: without_none(v) for k, v in value.items() if v is not None} if isinstance(value, dict) else value


def test_what_is_printed(finished: Finished) -> None:
    out, err = finished.result.out, finished.result.err
    assert "in 1 segment\n" in out
    assert all(f"\ncam{k} " in out for k in range(3))
    assert f"written to   {finished.run}" in out
    matches = [STAGE_LINE.fullmatch(line) for line in err.splitlines()]
    assert all(matches), err
    assert [m[1] for m in matches if m] == list(STAGES)
    assert {m[1]: m[3] for m in matches if m}["synchronise"] == "3"
    assert all(m[2] and m[2] == m[3] for m in matches if m)
    assert not any(STAGE_LINE.search(line) for line in out.splitlines())


def test_the_same_seed_gives_the_same_bytes(finished: Finished, tmp_path: Path) -> None:
    """Another process, another hash seed, another working folder; at the same time: --json prints one document."""
    arguments = ("reconstruct", "flight", "-o", tmp_path / "again", "--seed", "0", "--json")
    result = python("-m", "skytrace", *arguments, cwd=finished.flight.parent, environment={"PYTHONHASHSEED": "2"})
    assert result.code == 0, result.err
    for name in ("trajectory.csv", "cameras.json", "config.toml"):
        assert (tmp_path / "again" / name).read_bytes() == (finished.run / name).read_bytes()
    assert result.out.endswith("}\n")
    assert json.loads(result.out) == read_json(tmp_path / "again" / "summary.json")
    assert all(STAGE_LINE.fullmatch(line) for line in result.err.splitlines()), result.err


def test_another_seed_replaces_the_run(finished: Finished, tmp_path: Path) -> None:
    run = tmp_path / "run"
    assert skytrace("reconstruct", finished.flight, "-o", run).code == 0
    assert skytrace("reconstruct", finished.flight / "flight.toml", "-o", run, "--seed", 7).code == 0
    assert read_json(run / "manifest.json")["seed"] == 7
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


def test_a_camera_that_cannot_be_used_is_named(flight: Path, tmp_path: Path) -> None:
    described = (flight / "flight.toml").read_text("utf-8").split("[truth]")[0]
    described = described.replace('= "calibration', f'= "{flight}/calibration')
    described = described.replace('= "detections', f'= "{flight}/detections')
    rows = "".join(f"{frame} {5000 + frame} 300\n" for frame in range(200))
    (tmp_path / "astray.txt").write_text(rows)
    blind = {"id": "blind", "calibration": f"{flight}/calibration/cam0.json", "detections": "astray.txt"}
    blind["detections_columns"] = "frame x y"
    described += "\n[[camera]]\n" + "".join(f'{key} = "{value}"\n' for key, value in blind.items())
    (tmp_path / "flight.toml").write_text(described)
    result = skytrace("reconstruct", tmp_path, "-o", tmp_path / "run")
    assert result.code == 0, result.err
    row = read_json(tmp_path / "run" / "cameras.json")["cameras"]["blind"]
    assert row["registered"] is False
    assert "no usable detections" in row["reason"]
    summary = read_json(tmp_path / "run" / "summary.json")
    assert summary["cameras"]["blind"]["dropped"]["outside_image"] == 200
    assert any("blind" in text for text in summary["warnings"])
    assert f"left out: {row['reason']}" in result.out
