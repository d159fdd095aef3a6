"""`skytrace datasets`: flights of the public recordings, from a local copy or fetched."""

from __future__ import annotations

from pathlib import Path

import pytest

from skytrace.datasets import DATASETS, download

from .command import Result, skytrace

CALIBRATION = (
    '{"K-matrix": [[1500, 0, 960], [0, 1500, 540], [0, 0, 1]], "distCoeff": [0, 0, 0, 0], "fps": 30, '
    '"resolution": [1920, 1080]}'
)


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A local copy of dataset1 and dataset4 with next to nothing in its files."""
    root = tmp_path / 'a "copy"' / "drone-tracking"
    (root / "calibration").mkdir(parents=True)
    for name in ("dataset1", "dataset4"):
        for k, device in enumerate(DATASETS[name].devices):
            (root / "calibration" / f"{device}.json").write_text(CALIBRATION)
            for kind, row in (("auto", "5 6 7\n"), ("manual", "7 5 6\n")):
                (root / name / f"detections_{kind}").mkdir(parents=True, exist_ok=True)
                (root / name / f"detections_{kind}" / f"cam{k}.txt").write_text(row)
    return root.parent


def test_a_local_copy_is_taken_where_there_is_one(copy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from skytrace.io.flight import read_flight

    monkeypatch.setenv("SKYTRACE_DATA", str(copy))
    monkeypatch.setattr("skytrace.cli.datasets.fetch_datasets", None)
    output = tmp_path / "flights"
    result = skytrace("datasets", "-o", output)
    names = [f"{name}_{kind}" for name in ("dataset1", "dataset4") for kind in ("auto", "manual")]
    assert result.code == 0
    assert result.out.splitlines() == [str(output / name / "flight.toml") for name in names]
    assert "CC BY-NC-SA 4.0" in result.err
    assert "dataset2, dataset3" in result.err
    assert [len(read_flight(output / name).cameras) for name in names] == [4, 4, 7, 7]


def test_one_recording_with_one_kind_of_labels(copy: Path, tmp_path: Path) -> None:
    output = tmp_path / "flights"
    result = skytrace("datasets", "dataset4", "--labels", "manual", "-o", output, "--data", copy)
    assert (result.code, result.out) == (0, f"{output}/dataset4_manual/flight.toml\n")
    assert [p.name for p in output.iterdir()] == ["dataset4_manual"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("dataset3", "--data", "COPY"), "dataset3: the recording is not there"),
        (("dataset9", "--data", "COPY"), "no such recording"),
        (("--data", "EMPTY"), "no recording is there"),
    ],
)
def test_what_is_not_there_is_said(copy: Path, tmp_path: Path, arguments: tuple[str, ...], words: str) -> None:
    places = {"COPY": str(copy), "EMPTY": str(tmp_path / "empty")}
    result = skytrace("datasets", "-o", tmp_path / "flights", *(places.get(a, a) for a in arguments))
    assert (result.code, result.out) == (3, "")
    assert words in result.err.splitlines()[-1]
    assert not (tmp_path / "flights").exists()


def test_without_a_copy_and_a_network_the_message_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pooch")
    monkeypatch.delenv("SKYTRACE_DATA", raising=False)
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    # Nothing listens on this port.
    monkeypatch.setattr(download, "BASE_URL", "http://127.0.0.1:9")
    monkeypatch.setattr(download, "_RETRIES", 0)
    result = skytrace("datasets", "-o", tmp_path / "flights", "--cache", tmp_path / "cache")
    assert (result.code, result.out) == (3, "")
    assert "SKYTRACE_DATA" in result.err.splitlines()[-1]
    assert not (tmp_path / "flights").exists()


def test_fetched_files_are_read_where_they_are_kept(
    copy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("SKYTRACE_DATA", raising=False)
    asked = []

    def fetch(names, labels, cache, progress) -> Path:
        asked.append((names, tuple(labels), cache))
        progress("LICENSE", 0, 9)
        return copy

    monkeypatch.setattr("skytrace.cli.datasets.fetch_datasets", fetch)
    output = tmp_path / "flights"
    result = skytrace("datasets", "dataset1", "-o", output, "--labels", "auto")
    assert asked == [(["dataset1"], ("auto",), None)]
    assert result == Result(0, f"{output}/dataset1_auto/flight.toml\n", result.err)
    assert "  1/9 LICENSE" in result.err
    assert f"files and licence in {copy}/drone-tracking" in result.err
