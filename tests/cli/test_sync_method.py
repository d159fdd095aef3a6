"""Where offsets come from: `sync --method`, `reconstruct --sync`, and `benchmark sync`."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from .command import skytrace


@pytest.fixture(scope="module")
def rough(flight: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The flight with the offsets that the exhaustive search finds, each off by some frames."""
    folder = tmp_path_factory.mktemp("rough") / "flight"
    shutil.copytree(flight, folder)
    found = folder.parent / "found.json"
    assert skytrace("sync", flight, "-o", found).code == 0
    cameras = json.loads(found.read_text())["cameras"]
    out, frames = [], iter((0, 6, -8))
    for line in (folder / "flight.toml").read_text().splitlines():
        out.append(line)
        if line.startswith("id = "):
            camera = cameras[line.split('"')[1]]
            out.append(f"offset_s = {camera['offset_s'] + next(frames) / 30!r}")
    (folder / "flight.toml").write_text("\n".join(out) + "\n")
    return folder


def without_offset(rough: Path, folder: Path, camera_id: str) -> Path:
    """A copy of the flight in which one camera has no offset_s."""
    shutil.copytree(rough, folder)
    lines = (folder / "flight.toml").read_text().splitlines()
    del lines[lines.index(f'id = "{camera_id}"') + 1]
    (folder / "flight.toml").write_text("\n".join(lines) + "\n")
    return folder


def test_the_papers_method_finds_what_the_search_finds(rough: Path, tmp_path: Path) -> None:
    result = skytrace("sync", rough, "-o", tmp_path / "sync.json", "--method", "paper")
    assert result.code == 0, result.err
    cameras = json.loads((tmp_path / "sync.json").read_text())["cameras"]
    searched = json.loads((rough.parent / "found.json").read_text())["cameras"]
    assert all(camera["tied"] for camera in cameras.values())
    for camera_id, camera in cameras.items():
        assert camera["offset_s"] == pytest.approx(searched[camera_id]["offset_s"], abs=0.02)


@pytest.mark.parametrize("method", ["paper", "given"])
def test_reconstruct_from_rough_offsets(rough: Path, tmp_path: Path, method: str) -> None:
    result = skytrace("reconstruct", rough, "-o", tmp_path / "run", "--sync", method)
    assert result.code == 0, result.err
    cameras = json.loads((tmp_path / "run" / "cameras.json").read_text())["cameras"]
    assert all(camera["registered"] for camera in cameras.values())
    searched = json.loads((rough.parent / "found.json").read_text())["cameras"]
    for camera_id, camera in cameras.items():
        assert camera["clock"]["offset_s"] == pytest.approx(searched[camera_id]["offset_s"], abs=0.02)
    assert ("those given" in result.out) == (method == "given")


@pytest.mark.parametrize(
    ("command", "option"),
    [("sync", "--method=paper"), ("reconstruct", "--sync=paper"), ("reconstruct", "--sync=given")],
)
def test_a_camera_without_an_offset_is_named_with_its_line(
    rough: Path, tmp_path: Path, command: str, option: str
) -> None:
    flight = without_offset(rough, tmp_path / "flight", "cam1")
    lines = (flight / "flight.toml").read_text().splitlines()
    line = max(k for k in range(lines.index('id = "cam1"') + 1) if lines[k] == "[[camera]]") + 1
    result = skytrace(command, flight, "-o", tmp_path / "out", option)
    assert result.code == 3
    assert result.message.startswith(f"skytrace: {flight / 'flight.toml'}:{line}: no offset_s of camera cam1: ")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("command", "option"), [("sync", "--method"), ("reconstruct", "--sync")])
def test_an_unknown_method_is_a_usage_error(flight: Path, tmp_path: Path, command: str, option: str) -> None:
    result = skytrace(command, flight, "-o", tmp_path / "out", option, "guess")
    assert result.code == 2
    assert "guess" in result.err
    assert "paper" in result.err
    assert not (tmp_path / "out").exists()


def test_sync_alone_searches(flight: Path, tmp_path: Path) -> None:
    assert skytrace("sync", flight, "-o", tmp_path / "out", "--method", "given").code == 2


def test_the_benchmark_says_what_it_needs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SKYTRACE_DATA", raising=False)
    nothing = skytrace("benchmark", "sync")
    assert nothing.code == 3
    assert "SKYTRACE_DATA" in nothing.message
    empty = skytrace("benchmark", "sync", "--data", tmp_path)
    assert empty.code == 3
    assert str(tmp_path / "drone-tracking" / "dataset3") in empty.message
    for shifts in ("five", "5,,10", "-3", "nan", ""):
        wrong = skytrace("benchmark", "sync", "--data", tmp_path, f"--shifts={shifts}")
        assert wrong.code == 2, shifts
        assert "--shifts" in wrong.err
    folder = skytrace("benchmark", "sync", "--data", tmp_path, "--json", tmp_path)
    assert folder.code == 3
    assert "expected a file to write" in folder.message
