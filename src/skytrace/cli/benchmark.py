"""`skytrace benchmark`: the paper's experiments on the public recordings."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path

import typer

from skytrace.benchmark import synchronisation_table as table
from skytrace.benchmark.synchronisation import SHIFTS, count, measure_all
from skytrace.cli.files import write_text
from skytrace.datasets import Labels
from skytrace.errors import InputError
from skytrace.io.run_folder import json_text
from skytrace.pipeline.config import Config


def sync_benchmark_command(
    data: Path | None, shifts: str | None, seed: int, json_file: Path | None, markdown_file: Path | None
) -> None:
    """Measure, tell of every measurement when it is done, print and write the table."""
    chosen = SHIFTS if shifts is None else parse_shifts(shifts)
    data = _checked(data, json_file, markdown_file)
    rows = []
    for row in measure_all(data, chosen, seed):
        rows.append(row)
        words = "  ".join(filter(None, (*table.cells(row), table.failures(row))))
        print(f"{len(rows):>2}/{count(chosen)} {words}", file=sys.stderr, flush=True)
    print(table.as_text(rows), end="")
    _write_all(
        (json_file, json_text(table.as_document(rows)) + "\n"),
        (markdown_file, table.as_markdown(rows)),
    )


def calibration_benchmark_command(
    data: Path | None, seed: int, json_file: Path | None, markdown_file: Path | None
) -> None:
    """Measure, tell of every measurement when it is done, print and write the tables."""
    from skytrace.benchmark import calibration
    from skytrace.benchmark import calibration_table as tables

    data = _checked(data, json_file, markdown_file)
    rows = []
    for row in calibration.measure_all(data, seed):
        rows.append(row)
        print(f"{len(rows):>2}/{calibration.count()} {'  '.join(tables.cells(row))}", file=sys.stderr, flush=True)
    print(tables.as_text(rows), end="")
    _write_all(
        (json_file, json_text(tables.as_document(rows)) + "\n"),
        (markdown_file, tables.as_markdown(rows)),
    )


def ablation_benchmark_command(
    flights: Sequence[Path],
    data: Path | None,
    labels: Labels,
    seed: int,
    json_file: Path | None,
    markdown_file: Path | None,
) -> None:
    """Measure every variant on every flight, tell of each when it is done, print and write the table."""
    from skytrace.benchmark import ablation, ablation_table

    config, rows = Config(seed=seed), []
    names: Sequence[str] = ()
    if flights:
        _check_outputs(json_file, markdown_file)
    else:
        data = _checked(data, json_file, markdown_file)
        names = ablation.recordings_with_truth(data)
    judged = [ablation.read_judged(path, config) for path in flights]
    judged += [ablation.read_recording(name, labels, data, config) for name in names if data is not None]
    total = len(judged) * len(ablation.VARIANTS)
    for flight in judged:
        for row in ablation.measure_flight(flight, config):
            rows.append(row)
            words = "  ".join(filter(None, (*ablation_table.cells(row), row.failure)))
            print(f"{len(rows):>3}/{total} {words}", file=sys.stderr, flush=True)
    print(ablation_table.as_text(rows), end="")
    _write_all(
        (json_file, json_text(ablation_table.as_document(rows)) + "\n"),
        (markdown_file, ablation_table.as_markdown(rows)),
    )


def _write_all(*outputs: tuple[Path | None, str]) -> None:
    """Write the texts of those outputs that were asked for."""
    for path, text in outputs:
        if path is not None:
            write_text(path, text)


def _checked(data: Path | None, *outputs: Path | None) -> Path:
    """The folder of the recordings, before any work is done."""
    if data is None:
        raise InputError(
            "--data", "say where the recordings lie (or set SKYTRACE_DATA): a folder with drone-tracking/ inside"
        )
    _check_outputs(*outputs)
    return data


def _check_outputs(*outputs: Path | None) -> None:
    for path in outputs:
        if path is not None and path.is_dir():
            raise InputError(path, "expected a file to write, got a folder")


def parse_shifts(text: str) -> Sequence[float]:
    """Numbers of frames separated by commas. Raises typer.BadParameter, a usage error, for anything else."""
    try:
        shifts = [float(part) for part in text.split(",")]
    except ValueError:
        shifts = []
    if not shifts or not all(math.isfinite(s) and s >= 0 for s in shifts):
        message = f"expected numbers of frames from 0 such as 5,50,500, got {text!r}"
        raise typer.BadParameter(message, param_hint="--shifts")
    return tuple(dict.fromkeys(shifts))


def recordings_benchmark_command(
    data: Path | None,
    json_file: Path | None,
    csv_file: Path | None,
    markdown_file: Path | None,
    baseline_file: Path | None,
    save_baseline: Path | None,
    strict: bool,
) -> None:
    """Measure, tell of every recording when it is done, print and write the table, and say what got worse."""
    from skytrace.benchmark import recordings, recordings_baseline
    from skytrace.benchmark import recordings_table as tables

    data = _checked(data, json_file, csv_file, markdown_file, save_baseline)
    baseline = recordings_baseline.read_baseline(baseline_file)
    chosen = recordings.recordings_at_hand(data)
    rows = []
    for row in recordings.measure_all(data, chosen):
        rows.append(row)
        words = f"{row.cpu_s:.1f} CPU s{f', fails: {row.failure}' if row.failure else ''}"
        print(f"{len(rows):>2}/{len(chosen)} {row.name}: {words}", file=sys.stderr, flush=True)
    rows.sort(key=lambda row: chosen.index((row.recording, row.labels)))
    print(tables.as_text(rows), end="")
    worse = recordings_baseline.compare(rows, baseline)
    print("\nNothing is worse than the baseline beyond noise." if not worse else "\nWorse than the baseline:")
    print("".join(f"  {sentence}\n" for sentence in worse), end="")
    _write_all(
        (json_file, json_text(tables.as_document(rows)) + "\n"),
        (csv_file, tables.as_csv(rows)),
        (markdown_file, tables.as_markdown(rows)),
        (save_baseline, json_text(recordings_baseline.document(rows)) + "\n"),
    )
    if strict and worse:
        raise typer.Exit(1)
