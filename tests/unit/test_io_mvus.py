"""Import of mvus configurations."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from skytrace.errors import InputError
from skytrace.io.flight import read_flight
from skytrace.io.mvus import import_mvus

LENS = {"K-matrix": [[900, 0, 640], [0, 900, 360], [0, 0, 1]], "distCoeff": [0, 0, 0, 0], "resolution": [1280, 720]}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A checkout as mvus has it: configurations in a folder beside the data, paths from the checkout's root."""
    for name in ("config", "data/tracks", "data/lens"):
        (tmp_path / name).mkdir(parents=True)
    for k, fps in enumerate((25, 50)):
        (tmp_path / f"data/lens/phone{k}.json").write_text(json.dumps(LENS | {"fps": fps}))
        (tmp_path / f"data/tracks/cam{k}.txt").write_text(f"10 2{k} 3 99\n11 2{k} 4 98\n")
    (tmp_path / "data/rtk.txt").write_text("# ENU\n1 2 3\n4 5 6\n")
    return tmp_path


def config(folder: Path, **changes: object) -> Path:
    values = {
        "comment": "a template",
        "necessary inputs": {
            "path_detections": ["./data/tracks/cam0.txt", "./data/tracks/cam1.txt"],
            "path_cameras": ["./data/lens/phone0.json", "./data/lens/phone1.json"],
            "corresponding_frames": [0, -15.134],
        },
        "optional inputs": {"ground_truth": {"filepath": "./data/rtk.txt", "frequency": 5}},
        "settings": {"rolling_shutter": True},
    }
    values |= {key.replace("_", " "): value for key, value in changes.items()}
    path = folder / "config" / "config.json"
    path.write_text(json.dumps(values, indent=1))
    return path


def necessary(**changes: object) -> dict[str, object]:
    paths = {
        "path_detections": ["data/tracks/cam0.txt", "data/tracks/cam1.txt"],
        "path_cameras": ["data/lens/phone0.json", "data/lens/phone1.json"],
    }
    return {"necessary_inputs": paths | changes}


def test_import(folder):
    written = import_mvus(config(folder), folder / "flight")
    assert written == folder / "flight" / "flight.toml"
    flight = read_flight(folder / "flight")
    assert flight.name == "flight"
    assert [c.camera_id for c in flight.cameras] == ["cam0", "cam1"]
    assert [c.frame_rate_hz for c in flight.cameras] == [25, 50]
    assert [c.offset_s for c in flight.cameras] == [None, None]
    assert flight.cameras[1].detections.xy_px.tolist() == [[10, 21], [11, 21]]
    assert flight.cameras[1].detections.frame.tolist() == [3, 4]
    assert flight.truth is not None
    assert flight.truth.rate_hz == 5
    assert flight.truth.trajectory.read_text() == (folder / "data/rtk.txt").read_text()
    assert all((folder / "flight") in path.parents for path in flight.input_files)
    comments = [line for line in written.read_text().split("\n") if line.startswith("#")]
    assert "# [0, -15.134]" in comments
    assert "phone1.json" in written.read_text()


def test_the_flight_stands_alone(folder):
    import_mvus(config(folder), folder / "flight")
    moved = (folder / "flight").rename(folder / "moved")
    (folder / "data").rename(folder / "gone")
    assert len(read_flight(moved).cameras) == 2


@pytest.mark.parametrize("base", ["config", ".", "elsewhere"])
def test_paths_are_looked_for_by_the_configuration_then_above_then_here(folder, base, monkeypatch):
    path = config(folder)
    (folder / "elsewhere").mkdir()
    if base != ".":
        (folder / "data").rename(folder / base / "data")
    monkeypatch.chdir(folder / "elsewhere")
    import_mvus(path, "flight")
    assert len(read_flight(folder / "elsewhere" / "flight").cameras) == 2


def test_the_configurations_own_folder_goes_first(folder):
    path = config(folder)
    (folder / "config/data/tracks").mkdir(parents=True)
    (folder / "config/data/tracks/cam0.txt").write_text("77 78 3\n")
    import_mvus(path, folder / "flight")
    assert read_flight(folder / "flight").cameras[0].detections.xy_px.tolist() == [[77, 78]]


def test_detections_of_one_name_in_many_folders(folder):
    for k in range(2):
        (folder / f"data/c{k}").mkdir()
        (folder / f"data/tracks/cam{k}.txt").rename(folder / f"data/c{k}/track.txt")
    path = config(folder, **necessary(path_detections=["data/c0/track.txt", "data/c1/track.txt"]))
    import_mvus(path, folder / "flight")
    flight = read_flight(folder / "flight")
    assert [(c.camera_id, c.detections.y[0]) for c in flight.cameras] == [("cam0", 20), ("cam1", 21)]


@pytest.mark.parametrize("truth", [{}, {"filepath": ""}, {"comment": "none", "filepath": None}])
def test_without_truth(folder, truth):
    import_mvus(config(folder, optional_inputs={"ground_truth": truth}), folder / "flight")
    assert read_flight(folder / "flight").truth is None


def test_names_that_need_escapes(folder):
    destination = folder / 'a "quoted" \\ name\x7f'
    import_mvus(config(folder), destination)
    assert read_flight(destination).name == destination.name


@pytest.mark.parametrize(
    ("changes", "key", "words"),
    [
        ({"necessary_inputs": {}}, None, "path_cameras: expected a list of paths"),
        ({"necessary_inputs": 3}, "necessary inputs", "expected an object"),
        (necessary(path_cameras=[]), "path_cameras", "expected a list of paths"),
        (necessary(path_cameras=["a", 3]), "path_cameras", "expected a list of paths"),
        (necessary(path_cameras="data/lens/phone0.json"), "path_cameras", "expected a list of paths"),
        (necessary(path_cameras=["data/lens/phone0.json"]), "path_detections", "2 files, but path_cameras names 1"),
        (
            necessary(path_cameras=["data/lens/phone0.json"], path_detections=["data/tracks/cam0.txt"]),
            "path_detections",
            "at least two cameras",
        ),
        (necessary(path_detections=["none.txt", "x"]), "path_detections", "no such file: none.txt (tried "),
        ({"optional_inputs": {"ground_truth": 3}}, "ground_truth", "expected an object"),
        ({"optional_inputs": {"ground_truth": {"filepath": "none.txt", "frequency": 5}}}, "filepath", "no such file"),
        ({"optional_inputs": {"ground_truth": {"filepath": 3, "frequency": 5}}}, "filepath", "expected a path"),
        ({"optional_inputs": {"ground_truth": {"filepath": "data/rtk.txt", "frequency": 0}}}, "frequency", "rate"),
        ({"optional_inputs": {"ground_truth": {"filepath": "data/rtk.txt"}}}, None, "frequency: expected"),
    ],
)
def test_bad_configurations(folder, changes, key, words):
    path = config(folder, **changes)
    with pytest.raises(InputError) as caught:
        import_mvus(path, folder / "flight")
    assert words in caught.value.message
    assert caught.value.path == str(path)
    lines = path.read_text().split("\n")
    assert caught.value.line == (None if key is None else 1 + next(k for k, s in enumerate(lines) if f'"{key}":' in s))
    assert not (folder / "flight").exists()


@pytest.mark.parametrize(
    ("name", "text", "line"),
    [
        ("config/config.json", "{\n,}", 2),
        ("config/config.json", "[]", None),
        ("data/lens/phone1.json", json.dumps(LENS), None),
        ("data/tracks/cam1.txt", "1 2 3\n1 2 3.5\n", 2),
        ("data/tracks/cam1.txt", "frame x y\n1 2 3\n", 1),
        ("data/rtk.txt", "1 2 3\n1 2 q\n", 2),
    ],
)
def test_bad_files_are_named_themselves(folder, name, text, line):
    path = config(folder)
    (folder / name).write_text(text)
    with pytest.raises(InputError) as caught:
        import_mvus(path, folder / "flight")
    assert Path(caught.value.path).resolve() == (folder / name).resolve()
    assert caught.value.line == line
    assert not (folder / "flight").exists()


def test_nothing_is_overwritten(folder):
    (folder / "flight").mkdir()
    import_mvus(config(folder), folder / "flight")
    with pytest.raises(InputError, match="exists and is not empty"):
        import_mvus(config(folder), folder / "flight")
    with pytest.raises(InputError, match="is a file"):
        import_mvus(config(folder), folder / "data/rtk.txt")
