"""Hints and time stamps in a FLIGHT, from the file to what a user reads."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from .command import skytrace


@pytest.fixture
def hinted(flight: Path, tmp_path: Path) -> Path:
    """A copy of the flight, to be changed."""
    shutil.copytree(flight, tmp_path / "flight")
    return tmp_path / "flight"


def truth(folder: Path) -> dict[str, dict[str, float]]:
    cameras = json.loads((folder / "truth" / "cameras.json").read_text())["cameras"]
    return {camera_id: camera["clock"] for camera_id, camera in cameras.items()}


def frame_at(clock: dict[str, float], world_s: float) -> float:
    return (world_s - clock["offset_s"] - 0.5 * clock["readout_s"]) / clock["period_s"]


def give(folder: Path, per_camera: dict[str, str], end: str = "") -> None:
    """Add a line to each camera's table, and tables at the end."""
    text = (folder / "flight.toml").read_text()
    for camera_id, line in per_camera.items():
        head = f'id = "{camera_id}"\n'
        assert head in text
        text = text.replace(head, f"{head}{line}\n")
    (folder / "flight.toml").write_text(text + end)


def moments(folder: Path, errors: dict[str, float] | None = None) -> str:
    """Two [[simultaneous]] tables, the second one with errors in seconds."""
    clocks, tables = truth(folder), ""
    begin_s = json.loads((folder / "truth" / "cameras.json").read_text())["begin_s"]
    for after_s, wrong in ((10.0, {}), (30.0, errors or {})):
        frames = ", ".join(
            f"{c} = {frame_at(clock, begin_s + after_s) + wrong.get(c, 0.0) / clock['period_s']:.2f}"
            for c, clock in clocks.items()
        )
        tables += f"\n[[simultaneous]]\nframes = {{ {frames} }}\n"
    return tables


def test_every_hint_is_weighed_and_a_wrong_one_is_said(hinted: Path) -> None:
    clocks = truth(hinted)
    start = {
        c: f"start_time = 2024-05-03T10:{int(20 + k['offset_s'] // 60)}:{k['offset_s'] % 60:09.6f}"
        for c, k in clocks.items()
    }
    lines = {c: f"offset_s = {k['offset_s']:.3f}\noffset_sigma_s = 0.2\n{start[c]}" for c, k in clocks.items()}
    give(hinted, lines, moments(hinted, {"cam2": 0.4}))
    output = hinted.parent / "sync.json"
    result = skytrace("sync", hinted, "-o", output, "--json")
    assert result.code == 0, result.err
    document = json.loads(result.out)
    verdicts = {h["name"]: h["verdict"] for h in document["hints"]}
    assert verdicts == {
        **{f"{source} of {c}": "agrees" for source in ("offset_s", "start_time") for c in clocks},
        "[[simultaneous]] 1": "agrees",
        "[[simultaneous]] 2": "contradicted",
    }
    (warning,) = document["warnings"]
    assert "[[simultaneous]] 2 contradicts the tracks: by them cam2 took its frame 0.4" in warning
    assert warning in skytrace("sync", hinted, "-o", output).out


def test_a_run_keeps_what_became_of_the_hints(hinted: Path) -> None:
    clocks = truth(hinted)
    wrong = {c: f"offset_s = {k['offset_s'] + (9.0 if c == 'cam1' else 0.0):.2f}" for c, k in clocks.items()}
    give(hinted, wrong)
    run = hinted.parent / "run"
    result = skytrace("reconstruct", hinted, "-o", run)
    assert result.code == 0, result.err
    summary = json.loads((run / "summary.json").read_text())
    verdicts = {h["name"]: h["verdict"] for h in summary["synchronisation"]["hints"]}
    assert verdicts == {"offset_s of cam0": "agrees", "offset_s of cam1": "contradicted", "offset_s of cam2": "agrees"}
    (warning,) = [w for w in summary["warnings"] if "offset_s of cam1 contradicts the tracks" in w]
    assert f"warning      {warning}" in result.out


def test_times_by_ffprobe_instead_of_rows(hinted: Path) -> None:
    """A camera's frames listed as ffprobe lists packets: the same clocks, and a rate given wrong is overruled."""
    plain = json.loads(skytrace("sync", hinted, "-o", hinted.parent / "plain.json", "--json").out)
    frames = np.loadtxt(hinted / "detections" / "cam1.txt")[:, 0].astype(int)
    lens = json.loads((hinted / "calibration" / "cam1.json").read_text())
    stamps = np.arange(frames.max() + 1) / lens["fps"]
    order = np.arange(len(stamps))
    pairs = len(order) // 2
    order[: 2 * pairs] = order[: 2 * pairs].reshape(-1, 2)[:, ::-1].ravel()  # as if every other one were a B-frame
    (hinted / "cam1.txt").write_text("".join(f"{t:.6f},\n" for t in stamps[order]))
    give(hinted, {"cam1": 'timestamps = "cam1.txt"\nframe_rate_hz = 60'})
    result = skytrace("sync", hinted, "-o", hinted.parent / "sync.json", "--json")
    assert result.code == 0, result.err
    document = json.loads(result.out)
    assert document["cameras"]["cam1"]["offset_s"] == pytest.approx(plain["cameras"]["cam1"]["offset_s"], abs=2e-3)
    (warning,) = document["warnings"]
    assert warning.startswith("Camera cam1: its time stamps tell")


def test_without_hints_there_are_no_verdicts(finished) -> None:
    summary = json.loads((finished.run / "summary.json").read_text())
    assert summary["synchronisation"]["hints"] == []
