"""The benchmark of the recordings: its tables, what counts as worse, and what a process used."""

from __future__ import annotations

import csv
import io
import json
import sys
from dataclasses import replace

import pytest

from skytrace.benchmark import recordings, recordings_baseline, recordings_table
from skytrace.benchmark.recordings import Errors, Measurement, run_process
from skytrace.cli import run
from skytrace.errors import InputError
from skytrace.io.run_folder import json_text

JUDGED = Measurement(
    "dataset1",
    "auto",
    4,
    4,
    107.2,
    0.97,
    Errors(5.9, 6.7, 5.1, 0.25, 530, 535, 6.3),
    None,
    16.0,
    cpu_s=2.2,
    wall_s=2.5,
    peak_mib=233.0,
)
UNJUDGED = Measurement("dataset4", "manual", 7, 7, 433.0, 1.4, cpu_s=20.0, wall_s=22.0, peak_mib=260.0)
FAILED = Measurement("dataset3", "auto", 6, cpu_s=1.0, failure="skytrace: synchronise: nothing in common")
ROWS = [JUDGED, UNJUDGED, FAILED]


def test_our_figures_stand_beside_the_papers():
    row = dict(zip(recordings_table.HEADER, recordings_table.cells(JUDGED), strict=True))
    assert (row["mean"], row["N"], row["mean of all"], row["N of all"]) == ("5.9", "530", "6.3", "535")
    assert (row["paper mean"], row["paper RMSE"], row["paper median"], row["paper N"]) == ("7.3", "8.5", "6.1", "519")
    assert row["cameras"] == "4 of 4"
    assert recordings_table.cells(UNJUDGED)[-1] == ""  # the paper has no manual detections


def test_the_table_is_written_as_text_markdown_csv_and_json():
    assert "nothing in common" in recordings_table.as_text(ROWS)
    markdown = [line for line in recordings_table.as_markdown(ROWS).splitlines() if line.startswith("|")]
    assert len(markdown) == 2 + len(ROWS)
    assert len({line.count("|") for line in markdown}) == 1
    rows = list(csv.DictReader(io.StringIO(recordings_table.as_csv(ROWS))))
    assert [row["recording"] for row in rows] == ["dataset1", "dataset4", "dataset3"]
    assert float(rows[0]["paper_rmse_cm"]) == 8.5
    assert rows[1]["mean_cm"] == ""
    document = json.loads(json_text(recordings_table.as_document(ROWS)))
    assert document["rows"][0]["errors"]["n"] == 530
    assert document["rows"][0]["paper"]["mean_cm"] == 7.3


def test_only_what_is_worse_beyond_noise_is_told():
    baseline = recordings_baseline.document([JUDGED, UNJUDGED])
    assert recordings_baseline.compare([JUDGED, UNJUDGED], baseline) == []
    better = replace(JUDGED, errors=replace(JUDGED.errors, mean_of_all_cm=3.0, n_covered=600), cpu_s=1.0)
    noisy = replace(JUDGED, errors=replace(JUDGED.errors, mean_of_all_cm=6.6, n_covered=530), cpu_s=5.0)
    assert recordings_baseline.compare([better], baseline) == []
    assert recordings_baseline.compare([noisy], baseline) == []
    worse = replace(JUDGED, errors=replace(JUDGED.errors, mean_of_all_cm=7.0, n_covered=500), n_registered=3)
    told = recordings_baseline.compare([worse], baseline)
    assert told == [
        "dataset1 auto: cameras registered was 4 and is 3",
        "dataset1 auto: N of all was 535 and is 500",
        "dataset1 auto: mean of all, cm was 6.3 and is 7",
    ]


def test_what_fails_or_is_missing_is_worse_and_what_is_new_is_not():
    baseline = recordings_baseline.document([JUDGED])
    told = recordings_baseline.compare([replace(JUDGED, errors=None), FAILED, UNJUDGED], baseline)
    assert "dataset1 auto: N of all was 535 and is not known any more" in told
    assert "dataset3 auto: fails: skytrace: synchronise: nothing in common" in told
    assert not [sentence for sentence in told if "dataset4" in sentence]


def test_the_committed_baseline_tells_of_every_recording_of_the_paper():
    committed = recordings_baseline.read_baseline(None)
    assert {f"{name} auto" for name in recordings.PAPER} <= set(committed)
    for name, paper in recordings.PAPER.items():
        mean = committed[f"{name} auto"].get("mean_cm")
        assert mean is None or mean < paper.mean_cm
    known = {tolerance.figure for tolerance in recordings_baseline.TOLERANCES}
    assert {figure for figures in committed.values() for figure in figures} <= known


@pytest.mark.parametrize("text", ["[1]", "{", '{"dataset1 auto": {"n": "many"}}'])
def test_another_file_is_no_baseline(text, tmp_path):
    file = tmp_path / "baseline.json"
    file.write_text(text)
    with pytest.raises(InputError, match="not a baseline"):
        recordings_baseline.read_baseline(file)


def test_what_a_process_used_is_counted_by_itself():
    busy = "import time, sys\nx = b'x' * 60_000_000\nwhile time.process_time() < 0.3: pass\nsys.exit('no luck')"
    ended = run_process([sys.executable, "-c", busy])
    assert (ended.status, ended.complaint.strip()) == (1, "no luck")
    assert 0.3 <= ended.cpu_s < 2
    assert 60 < ended.peak_mib < 100
    light = run_process([sys.executable, "-c", "pass"])
    assert light.status == 0
    assert light.peak_mib < 40  # neither that of other processes nor that of this one


@pytest.fixture
def measured(monkeypatch, tmp_path):
    """A benchmark whose measurements are made up."""
    chosen = [(row.recording, row.labels) for row in ROWS]
    monkeypatch.setattr(recordings, "recordings_at_hand", lambda data: chosen)
    monkeypatch.setattr(recordings, "measure_all", lambda data, chosen: iter(ROWS[::-1]))
    return tmp_path


def test_the_command_prints_writes_and_compares(measured, capsys):
    baseline = measured / "before.json"
    baseline.write_text(json_text(recordings_baseline.document([replace(JUDGED, covered_s=300.0)])))
    files = [str(measured / name) for name in ("a.json", "a.csv", "a.md", "now.json")]
    options = ["--json", files[0], "--csv", files[1], "--markdown", files[2], "--save-baseline", files[3]]
    command = ["benchmark", "recordings", "--data", str(measured), "--baseline", str(baseline), *options]
    assert run(command) == 0
    printed = capsys.readouterr().out
    assert printed.index("dataset1 auto") < printed.index("dataset4 manual")
    assert "dataset1 auto: covered s was 300 and is 107.2" in printed
    assert "dataset3 auto: fails" in printed
    assert all((measured / name).is_file() for name in ("a.json", "a.csv", "a.md"))
    assert run([*command, "--strict"]) == 1
    assert recordings_baseline.read_baseline(measured / "now.json")["dataset1 auto"]["covered_s"] == 107.2


def test_without_a_command_the_recordings_are_measured(measured, monkeypatch, capsys):
    monkeypatch.setenv("SKYTRACE_DATA", str(measured))
    assert run(["benchmark"]) == 0
    assert "dataset1 auto" in capsys.readouterr().out
    monkeypatch.delenv("SKYTRACE_DATA")
    assert run(["benchmark"]) == 3
    assert "SKYTRACE_DATA" in capsys.readouterr().err


def test_a_folder_without_recordings_is_named(tmp_path):
    with pytest.raises(InputError, match="dataset1"):
        recordings.recordings_at_hand(tmp_path)
