"""`import skytrace`: light, complete, and the same as the command line."""

from __future__ import annotations

import ast
import json
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import skytrace
from skytrace.estimation.hints import Hints

ROOT = Path(__file__).parents[2]
HEAVY = (
    "numpy",
    "scipy",
    "numba",
    "plotly",
    "poselib",
    "msgspec",
    "yaml",
    "typer",
    "rich",
    "pooch",
    "pyarrow",
    "cv2",
    "av",
)


@pytest.fixture(scope="module")
def simulated():
    return skytrace.simulate(skytrace.Scenario(n_cameras=3, duration_s=40.0), np.random.default_rng(1))


@pytest.fixture(scope="module")
def heard() -> list[tuple[str, int, int]]:
    return []


@pytest.fixture(scope="module")
def result(simulated, heard: list[tuple[str, int, int]]) -> skytrace.Result:
    return skytrace.reconstruct(simulated.recordings, progress=lambda *step: heard.append(step))


def true_positions(simulated) -> np.ndarray:
    motion = simulated.truth.motion
    return motion.position(np.arange(motion.begin_s, motion.end_s, 0.2))


def test_importing_it_costs_nothing() -> None:
    code = f"import json, sys, skytrace; print(json.dumps([m for m in {HEAVY!r} if m in sys.modules]))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == []


def test_every_name_is_there_and_told_to_type_checkers() -> None:
    assert set(skytrace.__all__) == set(skytrace._HOME)
    assert set(skytrace.__all__) <= set(dir(skytrace))
    for name in skytrace.__all__:
        assert getattr(skytrace, name).__doc__ or name == "presets", name
    tree = ast.parse(Path(skytrace.__file__).read_text("utf-8"))
    checked = next(node for node in tree.body if isinstance(node, ast.If))
    told = {(i.module, alias.name) for i in checked.body if isinstance(i, ast.ImportFrom) for alias in i.names}
    assert told == {(home, name) for home, names in skytrace._HOMES.items() for name in names}
    with pytest.raises(AttributeError, match="no attribute 'reconstuct'"):
        _ = skytrace.reconstuct  # type: ignore[attr-defined]


def test_a_flight_in_memory_is_reconstructed(simulated, result: skytrace.Result, heard) -> None:
    assert set(result.reconstruction.cameras) == {"cam0", "cam1", "cam2"}
    stages = list(dict.fromkeys(name for name, _, _ in heard))
    assert stages == ["clean", "synchronise", "initialise", "grow", "adjust", "cover"]
    assert list(result.timings_s) == stages
    assert all(done <= total for _, done, total in heard)
    errors = skytrace.evaluate(result.reconstruction, truth=true_positions(simulated), rate_hz=5.0)
    assert errors.trajectory is not None
    assert errors.trajectory.complete.statistics.mean < 0.1
    slope, intercept = simulated.truth.synchronisation("cam1")
    known = {"cam0": (1.0, 0.0), "cam1": (slope, intercept)}
    clocks = skytrace.evaluate(result.reconstruction, known_synchronisation=known).synchronisation
    assert clocks is not None
    assert clocks.max_s < 0.01


def test_detections_are_cleaned_as_by_the_command(simulated, monkeypatch: pytest.MonkeyPatch) -> None:
    """A detection outside the image is dropped and counted."""
    first = simulated.recordings[0]
    track = first.tracks[0]
    xy_px = track.xy_px.copy()
    xy_px[5] = [-50.0, 20.0]
    spoilt = skytrace.Recording(
        first.camera_id, first.intrinsics, first.frame_rate_hz, (skytrace.Track(track.frame, xy_px),)
    )
    seen = {}

    class StoppedError(Exception):
        pass

    def stop(recordings, config, **rest):
        seen.update({r.camera_id: np.concatenate([t.frame for t in r.tracks]) for r in recordings})
        raise StoppedError

    monkeypatch.setattr("skytrace.api.run", stop)
    with pytest.raises(StoppedError):
        skytrace.reconstruct((spoilt, *simulated.recordings[1:]))
    assert track.frame[5] not in seen["cam0"]
    assert track.frame[4] in seen["cam0"]


def test_too_little_is_refused_with_counts(simulated) -> None:
    first = simulated.recordings[0]
    silent = skytrace.Recording("cam1", first.intrinsics, 30.0, ())
    with pytest.raises(skytrace.ReconstructionError, match="fewer than two cameras") as caught:
        skytrace.reconstruct([first, silent])
    assert caught.value.counts["cam1 detections"] == 0


def test_what_it_writes_is_a_run(result: skytrace.Result, simulated, tmp_path: Path) -> None:
    summary = skytrace.write_run(tmp_path / "run", result)
    run = skytrace.read_run(tmp_path / "run")
    assert run.summary["covered_s"] == pytest.approx(result.reconstruction.trajectory.covered_s)
    assert set(run.summary) == set(summary)
    assert sorted(p.name for p in run.path.iterdir()) == sorted(
        ["cameras.json", "config.toml", "manifest.json", "report.html", "summary.json", "trajectory.csv"]
    )
    assert run.manifest["seed"] == 0
    again = skytrace.evaluate(run, truth=true_positions(simulated), rate_hz=5.0).as_dict()
    first = skytrace.evaluate(result.reconstruction, truth=true_positions(simulated), rate_hz=5.0).as_dict()
    assert again["trajectory"]["all"]["mean"] == pytest.approx(first["trajectory"]["all"]["mean"], rel=1e-3)
    assert "sigma" in str(skytrace.export_run(run, "csv"))
    skytrace.write_run(tmp_path / "run", result, report=False)
    assert not (tmp_path / "run" / "report.html").exists()


def test_a_flight_from_files_brings_its_hints(simulated, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = skytrace.write_flight(simulated, tmp_path / "flight")
    description = folder / "flight.toml"
    text = description.read_text().replace('id = "cam1"', 'id = "cam1"\noffset_s = 3.0\nreadout_s = 0.01', 1)
    description.write_text(text.replace('id = "cam0"', 'id = "cam0"\noffset_s = 0.0', 1))
    given = {}

    class StoppedError(Exception):
        pass

    def stop(recordings, config, *, hints, known, progress):
        given.update(hints=hints, known=known, cameras=[r.camera_id for r in recordings])
        raise StoppedError

    monkeypatch.setattr("skytrace.api.run", stop)
    flight = skytrace.read_flight(folder)
    with pytest.raises(StoppedError):
        skytrace.reconstruct(flight)
    assert given["cameras"] == ["cam0", "cam1", "cam2"]
    assert [h.offset_s for h in given["hints"].offsets] == [0.0, 3.0]
    assert [r.camera_id for r in given["known"].readouts] == ["cam1"]
    with pytest.raises(StoppedError):
        skytrace.reconstruct(flight, hints=Hints())
    assert given["hints"].offsets == ()


def test_a_path_is_judged_with_its_numbers_of_cameras(result: skytrace.Result, simulated) -> None:
    errors = skytrace.evaluate(result.reconstruction, truth=true_positions(simulated), rate_hz=5.0)
    assert errors.trajectory is not None
    groups = errors.trajectory.complete.by_n_cameras
    assert groups
    assert sum(g.statistics.n for g in groups) == errors.trajectory.complete.statistics.n


def test_the_example_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    script = ROOT / "examples" / "reconstruct_simulated.py"
    monkeypatch.setattr(sys, "argv", [str(script), str(tmp_path / "run")])
    runpy.run_path(str(script), run_name="__main__")
    out = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in out[:3]] == ["cam0", "cam1", "cam2"]
    assert float(out[3].split()[2]) < 10.0
    assert skytrace.read_run(tmp_path / "run").reference == "cam0"
    # The page shows what is run.
    page = (ROOT / "docs" / "api.md").read_text("utf-8")
    assert script.read_text("utf-8").strip() in page
