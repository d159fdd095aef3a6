"""Every mistake a FLIGHT can hold ends in exit code 3 and one line that says where and what; nothing is left behind."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from .command import contents, skytrace

LENS = {"K-matrix": [[900, 0, 640], [0, 900, 360], [0, 0, 1]], "distCoeff": [0, 0, 0, 0], "resolution": [1280, 720]}
FLIGHT = """\
name = "two phones"

[[camera]]
id = "left"
calibration = "left.json"
detections = "left.txt"
detections_columns = "x y frame"
frame_rate_hz = 30

[[camera]]
id = "right"
calibration = "right.json"
detections = "right.txt"
detections_columns = "x y frame"
frame_rate_hz = 25
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A flight that is read without complaint, though it is far too short to reconstruct."""
    flight = tmp_path / "flight"
    flight.mkdir()
    (flight / "flight.toml").write_text(FLIGHT)
    for k, camera in enumerate(("left", "right")):
        (flight / f"{camera}.json").write_text(json.dumps(LENS, indent=1))
        rows = [f"{600 + 3 * (frame % 7)} {300 + 2 * (frame % 5) + k} {frame}\n" for frame in range(30)]
        (flight / f"{camera}.txt").write_text("".join(rows))
    return flight


def swap(name: str, old: str, new: str) -> Callable[[Path], None]:
    """Replace the first occurrence of a piece of a file."""

    def change(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new, 1))

    return change


def write(name: str, text: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        (folder / name).write_text(text)

    return change


def remove(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).unlink()


def keep_one_camera(folder: Path) -> None:
    (folder / "flight.toml").write_text(FLIGHT.rpartition("\n[[camera]]")[0])


# What is done to the flight, the file and line the message must name, and words it must hold.
MISTAKES = {
    "no flight.toml": (remove("flight.toml"), "flight.toml", None, ["does not exist"]),
    "not TOML": (swap("flight.toml", "= 30", "= 30 Hz"), "flight.toml", 8, ["TOML"]),
    "unknown key": (swap("flight.toml", "frame_rate_hz", "frame_rate"), "flight.toml", 8, ["'frame_rate'", "hz"]),
    "unknown table": (write("flight.toml", FLIGHT + "\n[truht]\n"), "flight.toml", 17, ["'truht'", "'truth'"]),
    "wrong type": (swap("flight.toml", "= 30", '= "30"'), "flight.toml", 8, ["frame_rate_hz", "a number"]),
    "no calibration key": (swap("flight.toml", 'calibration = "left.json"', ""), "flight.toml", 3, ["'calibration'"]),
    "no calibration file": (remove("right.json"), "flight.toml", 12, ["'right'", "no such file", "right.json"]),
    "no detections file": (remove("right.txt"), "flight.toml", 13, ["'right'", "no such file", "right.txt"]),
    "no detections key": (swap("flight.toml", 'detections = "left.txt"', ""), "flight.toml", 3, ["detections"]),
    "duplicate camera": (swap("flight.toml", '"right"', '"left"'), "flight.toml", 11, ["'left'", "camera 1"]),
    "one camera": (keep_one_camera, "flight.toml", 3, ["at least two", "got 1"]),
    "no frame rate": (swap("flight.toml", "frame_rate_hz = 25", ""), "flight.toml", 10, ["'right'", "frame rate"]),
    "negative frame rate": (swap("flight.toml", "= 25", "= -25"), "flight.toml", 15, ["positive", "-25"]),
    "unknown column": (swap("flight.toml", '"x y frame"', '"x y time"'), "flight.toml", 7, ["'time'", "frame"]),
    "column missing": (swap("flight.toml", '"x y frame"', '"x y"'), "flight.toml", 7, ["'frame'"]),
    "columns not declared": (
        swap("flight.toml", 'detections_columns = "x y frame"', ""),
        "left.txt",
        1,
        ["header", "detections_columns"],
    ),
    "columns swapped": (
        swap("flight.toml", '"x y frame"', '"frame x y"'),
        "left.txt",
        1,
        ["swapped", "detections_columns"],
    ),
    "header against declaration": (
        swap("left.txt", "600 300 0", "frame x y\n600 300 0"),
        "left.txt",
        1,
        ["'frame'", "'x'", "detections_columns"],
    ),
    "not a number": (swap("left.txt", "612 308 4", "612 3o8 4"), "left.txt", 5, ["3o8", "number"]),
    "too few columns": (swap("left.txt", "612 308 4", "612 308"), "left.txt", 5, ["3 columns"]),
    "broken frame number": (swap("left.txt", "612 308 4", "612 308 4.5"), "left.txt", 5, ["whole frame", "4.5"]),
    "no rows": (write("left.txt", ""), "left.txt", None, ["detections"]),
    "binary detections": (write("left.txt", "600 300 0\n\0\0\0"), "left.txt", 2, ["text"]),
    "calibration not JSON": (swap("left.json", '"distCoeff":', '"distCoeff"'), "left.json", 19, ["JSON"]),
    "calibration without matrix": (swap("left.json", "K-matrix", "K"), "left.json", None, ["K-matrix"]),
    "calibration transposed": (
        write("left.json", json.dumps(LENS | {"K-matrix": [[900, 0, 0], [0, 900, 0], [640, 360, 1]]})),
        "left.json",
        1,
        ["transposed"],
    ),
    "calibration of another size": (swap("left.json", "1280", "12"), "left.json", 2, ["12 px wide", "size"]),
    "unknown kind of calibration": (
        swap("flight.toml", '"left.json"', '"left.txt"'),
        "left.txt",
        None,
        [".json", ".yml", ".toml"],
    ),
    "a list of times that steps back": (
        lambda folder: (
            swap("flight.toml", "frame_rate_hz = 25", 'frame_rate_hz = 25\ntimestamps = "times.txt"')(folder),
            write("times.txt", "".join(f"{0.04 * (k % 25):.6f}\n" for k in range(50)))(folder),
        ),
        "times.txt",
        26,
        ["steps back", "one recording"],
    ),
    "times in milliseconds": (
        lambda folder: (
            swap("flight.toml", "frame_rate_hz = 25", 'frame_rate_hz = 25\ntimestamps = "times.txt"')(folder),
            write("times.txt", "".join(f"{k} {40 * k}\n" for k in range(30)))(folder),
        ),
        "flight.toml",
        16,
        ["'right'", "times.txt", "milliseconds", "expected seconds"],
    ),
    "a moment of an unknown camera": (
        write("flight.toml", FLIGHT + "\n[[simultaneous]]\nframes = { left = 3, rihgt = 5 }\n"),
        "flight.toml",
        18,
        ["[[simultaneous]] 1", "'rihgt'", "did you mean 'right'"],
    ),
    "start times with and without a zone": (
        write(
            "flight.toml",
            FLIGHT.replace("frame_rate_hz = 30", "frame_rate_hz = 30\nstart_time = 2024-05-03T10:15:00")
            + "start_time = 2024-05-03T10:15:00Z\n",
        ),
        "flight.toml",
        9,
        ["'left'", "start_time", "time zone"],
    ),
    "truth that is not there": (
        write("flight.toml", FLIGHT + '\n[truth]\ntrajectory = "rtk.txt"\n'),
        "flight.toml",
        18,
        ["no such file", "rtk.txt"],
    ),
}


@pytest.mark.parametrize(("change", "file", "line", "words"), MISTAKES.values(), ids=MISTAKES.keys())
def test_a_mistake_is_named(change, file: str, line: int | None, words: list[str], folder: Path) -> None:
    change(folder)
    before = contents(folder.parent)
    result = skytrace("reconstruct", folder, "-o", folder.parent / "run")
    assert (result.code, result.out) == (3, "")
    where = f"skytrace: {folder / file}" + (r":(\d+): " if line else ": ")
    match = re.match(where.replace(".", r"\."), result.message)
    assert match, result.message
    assert line is None or int(match[1]) == line, result.message
    assert [word for word in words if word not in result.message] == [], result.message
    assert contents(folder.parent) == before


def test_the_flight_is_read_where_nothing_is_wrong(folder: Path) -> None:
    """So that each mistake above is the only one."""
    result = skytrace("reconstruct", folder, "-o", folder.parent / "run")
    assert result.code == 4
    assert result.message.startswith("skytrace: synchronise: ")


def test_a_missing_flight(tmp_path: Path) -> None:
    result = skytrace("reconstruct", tmp_path / "nowhere", "-o", tmp_path / "run")
    assert result.code == 3
    assert str(tmp_path / "nowhere") in result.message
    assert "flight.toml" in result.message
    assert list(tmp_path.iterdir()) == []


def test_detections_outside_the_image(folder: Path) -> None:
    """The size of the calibrated image is not that of the filmed one: what was dropped is counted."""
    for camera in ("left", "right"):
        rows = [f"{3000 + 3 * frame} {1500 + frame % 5} {frame}\n" for frame in range(30)]
        (folder / f"{camera}.txt").write_text("".join(rows))
    before = contents(folder.parent)
    result = skytrace("reconstruct", folder, "-o", folder.parent / "run")
    assert (result.code, result.out) == (4, "")
    assert "usable detections" in result.message
    assert "left detections 30, left dropped as outside_image 30" in result.message
    assert "image size" in result.message
    assert contents(folder.parent) == before


def existing_file(parent: Path) -> Path:
    (parent / "notes").write_text("mine")
    return parent / "notes"


def below_a_file(parent: Path) -> Path:
    return existing_file(parent) / "run"


def foreign_folder(parent: Path) -> Path:
    (parent / "photos").mkdir()
    (parent / "photos" / "one.jpg").write_text("mine")
    return parent / "photos"


def foreign_manifest(parent: Path) -> Path:
    """A web application has a manifest.json too."""
    (foreign_folder(parent) / "manifest.json").write_text('{"name": "app"}')
    return parent / "photos"


def the_flight_itself(parent: Path) -> Path:
    return parent / "flight"


def mvus_config(folder: Path) -> Path:
    """A configuration of the paper's code that imports without complaint."""
    lists = {"path_cameras": ["lens.json", "lens.json"], "path_detections": ["left.txt", "right.txt"]}
    (folder / "lens.json").write_text(json.dumps(LENS | {"fps": 30}))
    (folder / "mvus.json").write_text(json.dumps({"necessary inputs": lists}))
    return folder / "mvus.json"


@pytest.mark.parametrize(
    "destination", [existing_file, below_a_file, foreign_folder, foreign_manifest, the_flight_itself]
)
@pytest.mark.parametrize("command", ["reconstruct", "simulate", "import mvus"])
def test_what_is_somebody_elses_is_not_overwritten(command: str, destination, folder: Path) -> None:
    given = {"reconstruct": [folder], "simulate": ["--duration", 5], "import mvus": [mvus_config(folder)]}[command]
    output = destination(folder.parent)
    before = contents(folder.parent)
    result = skytrace(*command.split(), *given, "-o", output)
    assert (result.code, result.out) == (3, "")
    assert str(output) in result.message
    assert result.err.count("\n") == 1  # said before any work was done
    assert contents(folder.parent) == before


@pytest.mark.parametrize("name", ["run", "flight"])
def test_the_demo_overwrites_nothing_of_somebody_elses(name: str, tmp_path: Path) -> None:
    foreign_folder(tmp_path).rename(tmp_path / name)
    before = contents(tmp_path)
    result = skytrace("demo", "-o", tmp_path)
    assert (result.code, result.out) == (3, "")
    assert str(tmp_path / name) in result.message
    assert contents(tmp_path) == before


def test_a_folder_that_may_not_be_written_is_refused_before_the_work(folder: Path, monkeypatch) -> None:
    locked = folder.parent / "locked"
    locked.mkdir()
    # The superuser, who runs tests in containers, may write anywhere.
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != locked)
    result = skytrace("reconstruct", folder / "nowhere", "-o", locked / "a" / "run")
    assert result.code == 3
    assert "permission" in result.message
    assert list(locked.iterdir()) == []


def test_an_unforeseen_trouble_with_a_file_needs_no_traceback(folder: Path) -> None:
    result = skytrace("reconstruct", folder / ("n" * 300), "-o", folder.parent / "run")
    assert result.code == 3
    assert "name too long" in result.message
