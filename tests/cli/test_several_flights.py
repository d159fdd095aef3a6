"""`skytrace reconstruct FLIGHT1 FLIGHT2 -o RUN`: a run each, what they share, and what goes wrong."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from benchmarks.same_cameras import WEAK, filmed_by_the_same

from skytrace.io.run_folder import read_run
from skytrace.simulation.write import write_flight
from tests.cli.command import Result, contents, skytrace

RUN_FILES = {"cameras.json", "config.toml", "manifest.json", "report.html", "summary.json", "trajectory.csv"}


@dataclass(frozen=True)
class Together:
    """Two flights and their common run."""

    flights: tuple[Path, Path]
    run: Path
    result: Result

    @property
    def summary(self) -> dict:
        return json.loads((self.run / "summary.json").read_text("utf-8"))


@pytest.fixture(scope="module")
def together(tmp_path_factory: pytest.TempPathFactory) -> Together:
    folder = tmp_path_factory.mktemp("together")
    flights = tuple(
        write_flight(filmed_by_the_same(1, k), folder / name, name=f"{name} flight")
        for k, name in enumerate(("first", "second"))
    )
    result = skytrace("reconstruct", *flights, "-o", folder / "run")
    assert result.code == 0, result.err
    return Together((flights[0], flights[1]), folder / "run", result)


def test_a_run_each_and_a_summary(together: Together) -> None:
    names = {path.name for path in together.run.iterdir()}
    assert names == {"first flight", "second flight", "summary.json", "manifest.json"}
    for name in ("first flight", "second flight"):
        assert {path.name for path in (together.run / name).iterdir()} == RUN_FILES
        run = read_run(together.run / name)
        assert run.summary["covered_s"] > 30
        (other,) = {"first flight", "second flight"} - {name}
        shared = run.summary["shared_devices"]["cam1"]
        assert shared["with"] == {other: "cam1"}
        assert {"focal_scale", "readout_s"} <= set(shared["parameters"])
        assert name in (together.run / name / "report.html").read_text("utf-8")


def test_what_is_shared(together: Together) -> None:
    summary = together.summary
    assert summary["agreed"] is True
    assert summary["warnings"] == []
    assert summary["flights"]["first flight"]["reconstructed"] is True
    assert [d["name"] for d in summary["devices"]] == ["cam0", "cam1", "cam2"]
    focal = summary["devices"][1]["parameters"]["focal_scale"]
    assert set(focal["alone"]) == {"first flight", "second flight"}
    assert 0 < focal["joint"]["sd"] < min(e["sd"] for e in focal["alone"].values())
    for name in summary["flights"]:
        camera = read_run(together.run / name).cameras["cam1"]
        scale = camera["focal_px_refined"][0] / camera["focal_px_calibrated"][0]
        assert scale - 1 == pytest.approx(focal["joint"]["value"], abs=1e-3)


def test_what_is_printed(together: Together) -> None:
    assert re.search(r"^first flight\ncovered +\d", together.result.out, re.MULTILINE)
    assert re.search(r"^device +cam1: cam1 of first flight, cam1 of second flight$", together.result.out, re.MULTILINE)
    assert f"written to   {together.run}\n" in together.result.out
    stages = [line.rsplit("/", 1)[0].split() for line in together.result.err.splitlines()]
    assert ["first", "flight:", "adjust", "2"] in stages
    assert ["second", "flight:", "grow", "3"] in stages
    assert [words[0] for words in stages[-2:]] == ["share", "write"]


def test_each_run_is_evaluated_by_itself(together: Together) -> None:
    run = together.run / "second flight"
    result = skytrace("evaluate", run, "--flight", together.flights[1], "--json")
    assert result.code == 0, result.err
    result = skytrace("evaluate", together.run, "--flight", together.flights[1])
    assert result.code == 3
    assert "several flights" in result.message
    assert str(run) in result.message


def test_a_flight_given_twice(together: Together, tmp_path: Path) -> None:
    first = together.flights[0]
    result = skytrace("reconstruct", first, together.flights[1], first / "flight.toml", "-o", tmp_path / "run")
    assert result.code == 3
    assert "give each flight once" in result.message
    assert not (tmp_path / "run").exists()


def test_flights_of_one_name(together: Together, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    copy.mkdir()
    for file, content in contents(together.flights[0]).items():
        path = copy / file
        path.mkdir(exist_ok=True) if file.endswith("/") else path.write_bytes(content)
    result = skytrace("reconstruct", together.flights[0], copy, "-o", tmp_path / "run")
    assert result.code == 3
    assert 'name = "first flight"' in result.err
    assert "give the flight another name" in result.err
    assert not (tmp_path / "run").exists()


def test_one_flight_that_fails_does_not_keep_the_others_from_it(together: Together, tmp_path: Path) -> None:
    hover = ("--preset", "hover", "--duration", 20, "--cameras", 2)
    assert skytrace("simulate", "-o", tmp_path / "hover", *hover).code == 0
    result = skytrace("reconstruct", tmp_path / "hover", together.flights[0], "-o", tmp_path / "run", "--json")
    assert result.code == 4
    *_, message = result.err.splitlines()
    assert message.startswith("skytrace: hover: ")
    summary = json.loads(result.out)
    assert summary == json.loads((tmp_path / "run" / "summary.json").read_text("utf-8"))
    assert summary["flights"]["hover"]["reconstructed"] is False
    assert summary["devices"] == []
    assert read_run(tmp_path / "run" / "first flight").summary["shared_devices"] == {}
    # An earlier run of several flights is replaced, like any other.
    assert skytrace("reconstruct", tmp_path / "hover", tmp_path, "-o", tmp_path / "run").code == 3
    assert (tmp_path / "run" / "summary.json").exists()


def test_where_all_fail_nothing_is_written(tmp_path: Path) -> None:
    for k, name in enumerate("ab"):
        scenario = filmed_by_the_same(1, k, replace(WEAK, motion="hover", duration_s=20.0, n_cameras=2))
        write_flight(scenario, tmp_path / name, name=name)
    result = skytrace("reconstruct", tmp_path / "a", tmp_path / "b", "-o", tmp_path / "run")
    assert (result.code, result.out) == (4, "")
    assert result.err.splitlines()[-1].startswith("skytrace: a: ")
    assert "; b: " in result.err
    assert not (tmp_path / "run").exists()


def test_a_device_that_films_a_flight_twice(together: Together, tmp_path: Path) -> None:
    text = (together.flights[0] / "flight.toml").read_text("utf-8")
    text = text.replace('calibration = "', f'device = "phone"\ncalibration = "{together.flights[0]}/')
    text = text.replace('detections = "', f'detections = "{together.flights[0]}/')
    text = text[: text.index("[truth]")]
    (tmp_path / "flight.toml").write_text(text, "utf-8")
    result = skytrace("reconstruct", tmp_path, together.flights[1], "-o", tmp_path / "run")
    assert result.code == 3
    assert re.search(r"flight\.toml:\d+: camera 'cam1': device: 'phone' is camera 'cam0' already", result.message)
