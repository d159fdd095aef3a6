"""From videos to a trajectory: three rendered films that start at different times, by one command."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from skytrace.io.detections import read_detections
from skytrace.io.tracks import read_about
from skytrace.io.video_writer import TICKS_PER_S
from skytrace.pipeline.videos import FLIGHT_TRACKS
from skytrace.simulation import presets, simulate, write_flight
from skytrace.simulation.filming import as_filmed
from skytrace.simulation.render import Film, render_videos

from .command import Result, contents, skytrace

# The flight's box is 60 m wide.
SCENE_M = 60.0


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three lenses, rates and rolling shutters, 640x480, unsynchronised by seconds; the target is 8 px wide."""
    scenario = replace(
        presets["demo"],
        n_cameras=3,
        duration_s=36.0,
        watched_fraction=0.8,
        resolutions_px=((640, 480),),
        frame_rates_hz=(15.0, 12.5, 14.985),
    )
    rng = np.random.default_rng(3)
    simulated = as_filmed(simulate(scenario, rng), TICKS_PER_S)
    film = Film(target_m=1.5, scenery=False)
    folder = tmp_path_factory.mktemp("filmed") / "flight"
    return write_flight(simulated, folder, write_videos=lambda root: render_videos(simulated, film, root, rng))


@pytest.fixture(scope="module")
def reconstructed(filmed: Path) -> Result:
    return skytrace("reconstruct", filmed, "-o", filmed.parent / "run")


def test_videos_become_a_trajectory(filmed: Path, reconstructed: Result) -> None:
    assert reconstructed.code == 0, reconstructed.err
    assert "frames" in reconstructed.err
    assert "warning" not in reconstructed.out
    result = skytrace("evaluate", filmed.parent / "run", "--flight", filmed, "--json")
    figures = json.loads(result.out)
    assert figures["trajectory"]["all"]["mean"] < 0.0005 * SCENE_M
    assert figures["synchronisation"]["max_s"] < 0.01


def test_targets_were_found_where_they_were(filmed: Path, reconstructed: Result) -> None:
    tracks = {read_about(path)["video"]: path for path in (filmed / FLIGHT_TRACKS).iterdir()}
    assert sorted(tracks) == ["cam0.mp4", "cam1.mp4", "cam2.mp4"]
    for name, path in tracks.items():
        truth = np.genfromtxt(filmed / "truth" / "frames" / name.replace("mp4", "csv"), delimiter=",", names=True)
        found = read_detections(path)
        true_px = np.column_stack([truth["x_px"], truth["y_px"]])[found.frame]
        error_px = np.hypot(*(found.xy_px - true_px).T)
        right = error_px < 4
        assert right.mean() > 0.99
        assert right.sum() / truth["visible"].sum() > 0.97
        assert np.median(error_px) < 0.15
        np.testing.assert_allclose(found.time_s, truth["time_s"][found.frame], atol=1e-6)


def test_nothing_is_found_twice(filmed: Path, reconstructed: Result, tmp_path: Path, monkeypatch) -> None:
    def refuse(*arguments: object) -> None:
        raise AssertionError("was found before")

    monkeypatch.setattr("skytrace.pipeline.videos.detect_to_file", refuse)
    before = contents(filmed)
    result = skytrace("reconstruct", filmed, "-o", tmp_path / "run")
    assert result.code == 0
    assert "frames" not in result.err
    run = filmed.parent / "run"
    assert (tmp_path / "run" / "trajectory.csv").read_bytes() == (run / "trajectory.csv").read_bytes()
    inputs = json.loads((run / "manifest.json").read_text())["inputs"]
    assert {Path(name).suffix for name in inputs} == {".toml", ".json", ".mp4", ".csv"}
    result = skytrace("sync", filmed, "-o", tmp_path / "sync.json")
    assert result.code == 0
    assert "frames" not in result.err
    assert contents(filmed) == before
