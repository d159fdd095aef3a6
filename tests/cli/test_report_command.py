"""skytrace report: the page with the truth on it, and pictures for papers."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

from .command import Result, contents, skytrace
from .conftest import Finished


def test_the_truth_is_added_to_the_page_of_the_run(finished: Finished, tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(finished.run, run)
    before = contents(run)
    assert skytrace("report", run, "--flight", finished.flight) == Result(0, f"{run / 'report.html'}\n", "")
    after = contents(run)
    assert {name for name in after if after[name] != before.get(name)} == {"report.html"}
    page = after["report.html"].decode()
    for words in ("Against the truth", "Error along the track", "camera orientation, aligned", "velocity, in cm/s"):
        assert words in page, words
        assert words not in before["report.html"].decode()


def test_another_page_and_pictures_leave_the_run_as_it_is(finished: Finished, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    before = contents(finished.run)
    page, folder, truth = tmp_path / "page.html", tmp_path / "a" / "b", finished.flight / "truth"
    options = ("--truth", truth / "trajectory.txt", "--rate", 5, "-o", page, "--png", folder)
    result = skytrace("report", finished.run, *options)
    assert (result.code, result.err) == (0, "")
    names = ("overview", "trajectory", "residuals", "clocks", "error")
    assert result.out.splitlines() == [str(page), *(str(folder / f"{name}.png") for name in names)]
    assert set(contents(folder)) == {f"{name}.png" for name in names}
    assert "Against the truth" in page.read_text(encoding="utf-8")
    assert contents(finished.run) == before


def test_what_is_missing_is_said(finished: Finished, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = tmp_path / "run"
    shutil.copytree(finished.run, run)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    result = skytrace("report", run, "--png", tmp_path / "pictures")
    assert result.code == 3
    assert "skytrace[png]" in result.message
    assert not (tmp_path / "pictures").exists()
    (tmp_path / "file").write_text("")
    assert "expected a folder" in skytrace("report", run, "--png", tmp_path / "file").message
    assert "no [truth]" in skytrace("report", run, "--flight", _without_truth(finished, tmp_path)).message
    (run / "report.html").write_text("<p>something else</p>")
    result = skytrace("report", run, "--flight", finished.flight)
    assert result.code == 3
    assert "not a page of skytrace" in result.message
    (run / "report.html").unlink()
    assert "report of a run does not exist" in skytrace("report", run).message


def _without_truth(finished: Finished, folder: Path) -> Path:
    flight = folder / "flight"
    shutil.copytree(finished.flight, flight)
    text = (flight / "flight.toml").read_text()
    (flight / "flight.toml").write_text(text[: text.index("[truth]")])
    return flight
