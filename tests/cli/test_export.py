"""`skytrace export`: a run in the formats of other programs, as a user asks for them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from skytrace.geometry.rigid import Similarity
from skytrace.io.export import FORMATS
from skytrace.io.georeference import write_georeference
from skytrace.io.run_folder import read_run
from skytrace.model.georeference import Georeference

from .command import Result, contents, skytrace
from .conftest import Finished


@pytest.fixture(scope="module")
def placed(finished: Finished, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run with a place on the earth."""
    folder = tmp_path_factory.mktemp("placed") / "run"
    shutil.copytree(finished.run, folder)
    similarity = Similarity(40.0, np.eye(3), np.zeros(3))
    write_georeference(folder, Georeference(np.radians(47.0), np.radians(8.0), 450.0, similarity))
    return folder


def test_text_goes_to_stdout(finished: Finished) -> None:
    before = contents(finished.run)
    result = skytrace("export", finished.run, "--to", "csv", "--rate", 10)
    assert (result.code, result.err) == (0, "")
    rows = [line for line in result.out.splitlines() if not line.startswith("#")]
    run = read_run(finished.run)
    covered_s = sum(s["end_s"] - s["begin_s"] for s in run.summary["segments"])
    assert abs(len(rows) - 1 - 10 * covered_s) <= 2 * len(run.summary["segments"])
    assert contents(finished.run) == before
    assert skytrace("export", finished.run, "--to", "csv", "--rate", 10, "-o", "-") == result


@pytest.mark.parametrize("name", [name for name, f in FORMATS.items() if f.suffix])
def test_every_file_format_is_written_whole(placed: Path, tmp_path: Path, name: str) -> None:
    if name == "parquet":
        pytest.importorskip("pyarrow")
    output = tmp_path / "deep" / f"track{FORMATS[name].suffix}"
    arguments = ("export", placed, "--to", name, "-o", output, "--time-zero", "2024-05-03T10:15:00Z")
    assert skytrace(*arguments) == Result(0, f"{output}\n", "")
    first = output.read_bytes()
    assert len(first) > 1000
    assert list(output.parent.iterdir()) == [output]
    assert skytrace(*arguments).code == 0
    assert output.read_bytes() == first


def test_colmap_is_a_folder(finished: Finished, tmp_path: Path) -> None:
    output = tmp_path / "model"
    assert skytrace("export", finished.run, "--to", "colmap", "-o", output) == Result(0, f"{output}\n", "")
    assert sorted(p.name for p in output.iterdir()) == ["cameras.txt", "images.txt", "points3D.txt"]
    again = skytrace("export", finished.run, "--to", "colmap", "-o", output)
    assert again.code == 3
    result = skytrace("export", finished.run, "--to", "colmap")
    assert (result.code, result.out) == (3, "")
    assert "--output: colmap is a folder" in result.message


def test_without_a_date_kml_says_so(placed: Path, tmp_path: Path) -> None:
    result = skytrace("export", placed, "--to", "kml", "-o", tmp_path / "a.kml")
    assert result.code == 0
    assert "1970-01-01" in result.message
    assert "--time-zero" in result.message


def test_frame_and_deviations(placed: Path) -> None:
    def table(*options: object) -> str:
        result = skytrace("export", placed, "--to", "geojson", "--rate", 1, *options)
        assert result.code == 0
        return result.out

    document = json.loads(table("--no-deviations", "--time-zero", "start"))
    properties = document["features"][0]["properties"]
    assert "sigma_m" not in properties
    assert min(properties["time_s"]) < 1.0
    world = skytrace("export", placed, "--to", "csv", "--frame", "world").out.splitlines()
    enu = skytrace("export", placed, "--to", "csv").out.splitlines()
    assert "# frame: right-handed world of the run" in world
    assert any(line.startswith("time_s,x_m,y_m,z_m") for line in enu)
    assert any(line.startswith("time_s,x,y,z,vx") for line in world)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--to", "gpx"), "gpx needs a place on the earth"),
        (("--to", "trc"), "trc needs metres"),
        (("--to", "csv", "--frame", "enu"), "place on the earth"),
        (("--to", "cvs"), "did you mean 'csv'"),
        (("--to", "tum", "--with-gaps"), "possible with csv"),
        (("--to", "csv", "--time-zero", "yesterday"), "--time-zero: expected start, or a date and time"),
        (("--to", "csv", "--time-zero", "2024-05-03T10:15:00"), "which has no zone"),
    ],
)
def test_what_cannot_be_is_refused(finished: Finished, tmp_path: Path, arguments: tuple[str, ...], words: str) -> None:
    result = skytrace("export", finished.run, *arguments, "-o", tmp_path / "out")
    assert (result.code, result.out) == (3, "")
    assert words in result.message
    assert list(tmp_path.iterdir()) == []


def test_a_folder_is_no_file_and_a_flight_no_run(finished: Finished, tmp_path: Path) -> None:
    result = skytrace("export", finished.run, "--to", "csv", "-o", tmp_path)
    assert result.code == 3
    assert "expected a file to write, got a folder" in result.message
    assert skytrace("export", finished.flight, "--to", "csv").code == 3


def test_the_help_names_every_format() -> None:
    words = skytrace("export", "--help").out
    assert all(name in words for name in FORMATS)
