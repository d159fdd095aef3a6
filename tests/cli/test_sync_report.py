"""`skytrace sync --report`: the page beside the JSON, above all where there is no solution."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

from .command import skytrace
from .conftest import Finished


def test_the_page_comes_beside_the_same_document(flight: Path, tmp_path: Path) -> None:
    plain = skytrace("sync", flight, "-o", tmp_path / "plain.json", "--json")
    page = tmp_path / "pages" / "sync.html"
    result = skytrace("sync", flight, "-o", tmp_path / "sync.json", "--report", page, "--json")
    assert (result.code, result.out) == (0, plain.out)
    assert (tmp_path / "sync.json").read_bytes() == (tmp_path / "plain.json").read_bytes()
    assert [path.name for path in page.parent.iterdir()] == ["sync.html"]
    html = page.read_text(encoding="utf-8")
    assert "All 3 cameras are tied to the clock of cam0." in html
    document = json.loads(result.out)
    for pair in document["pairs"]:
        assert f"{pair['camera0']} – {pair['camera1']}" in html
    said = skytrace("sync", flight, "-o", tmp_path / "sync.json", "--report", page)
    assert said.out.splitlines()[-1] == f"report       {page}"
    assert page.read_text(encoding="utf-8") == html


def test_without_a_solution_the_page_shows_the_evidence(tmp_path: Path) -> None:
    """The two cameras filmed different flights."""
    for seed in (0, 1):
        options = ("--cameras", 2, "--duration", 60, "--seed", seed)
        assert skytrace("simulate", "-o", tmp_path / f"flight{seed}", *options).code == 0
    other = tmp_path / "flight1" / "detections" / "cam1.txt"
    shutil.copy(other, tmp_path / "flight0" / "detections" / "cam1.txt")
    shutil.rmtree(tmp_path / "flight1")
    words = "no time offset makes their tracks views of one flight"
    page = tmp_path / "sync.html"
    result = skytrace("sync", tmp_path / "flight0", "-o", tmp_path / "sync.json", "--report", page, "--json")
    assert (result.code, result.out) == (4, "")
    assert words in result.message
    assert result.message.endswith(f"{page} shows what the tracks say")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["flight0", "sync.html"]
    html = page.read_text(encoding="utf-8")
    assert "The cameras could not be synchronised" in html
    assert words in html
    assert '"score":{"data"' in html  # the search over all offsets, of some pair
    # Without the option the failure is the same, and leaves nothing.
    bare = skytrace("sync", tmp_path / "flight0", "-o", tmp_path / "sync.json")
    assert bare.code == 4
    assert result.message.startswith(bare.message)


def test_too_few_cameras_with_detections_is_shown_as_well(flight: Path, tmp_path: Path) -> None:
    described = (flight / "flight.toml").read_text().split("[truth]")[0]
    described = described.replace('= "calibration', f'= "{flight}/calibration')
    for k in (1, 2):
        described = described.replace(f'"detections/cam{k}.txt"', f'"{tmp_path}/none.txt"')
    (tmp_path / "flight.toml").write_text(described.replace('= "detections/', f'= "{flight}/detections/'))
    (tmp_path / "none.txt").write_text("".join(f"{frame} 0 0\n" for frame in range(9)))
    page = tmp_path / "sync.html"
    result = skytrace("sync", tmp_path, "-o", tmp_path / "sync.json", "--report", page)
    assert (result.code, result.out) == (4, "")
    assert "fewer than two cameras have usable detections" in result.message
    html = page.read_text(encoding="utf-8")
    assert "Fewer than two cameras have usable detections." in html
    assert "it has no usable detections" in html
    assert not (tmp_path / "sync.json").exists()


def test_where_the_page_cannot_be_is_said_before_anything_is_computed(flight: Path, tmp_path: Path) -> None:
    output = tmp_path / "sync.json"
    for page, words in ((tmp_path, "expected a file"), (output, "a name of its own")):
        result = skytrace("sync", flight, "-o", output, "--report", page)
        assert (result.code, result.out) == (3, "")
        assert words in result.message
        assert str(page) in result.message
    assert list(tmp_path.iterdir()) == []


def test_a_run_tells_how_sure_its_synchronisation_is(finished: Finished, tmp_path: Path) -> None:
    """What `skytrace sync` writes is in the run's summary and on its page."""
    found = json.loads((finished.run / "summary.json").read_text())["synchronisation"]
    assert set(found["cameras"]) == {"cam0", "cam1", "cam2"}
    for camera in found["cameras"].values():
        assert camera["tied"]
        assert 0.95 < camera["confidence"] <= 1
        assert 0 <= camera["offset_sd_s"] < 0.01
    assert [(p["camera0"], p["camera1"]) for p in found["pairs"]] == [
        ("cam0", "cam1"),
        ("cam0", "cam2"),
        ("cam1", "cam2"),
    ]
    for pair in found["pairs"]:
        assert pair["accepted"]
        assert 0.5 < pair["confidence"] <= 1
        assert 0 < pair["offset_sd_s"] < 0.05
        assert 0 < pair["support_s"] <= pair["overlap_s"]
    assert len(found["disagreement_s"]) == 3
    assert "warnings" not in found
    html = (finished.run / "report.html").read_text(encoding="utf-8")
    for words in ("Clocks of the cameras", "Pairs of cameras", "also plausible at [s]", "cam1 – cam2"):
        assert words in html
