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
from skytrace.errors import InputError
from skytrace.io.run_folder import json_text


def sync_benchmark_command(
    data: Path | None, shifts: str | None, seed: int, json_file: Path | None, markdown_file: Path | None
) -> None:
    """Measure, tell of every measurement when it is done, print and write the table."""
    chosen = SHIFTS if shifts is None else parse_shifts(shifts)
    if data is None:
        raise InputError(
            "--data", "say where the recordings lie (or set SKYTRACE_DATA): a folder with drone-tracking/ inside"
        )
    for path in (json_file, markdown_file):
        if path is not None and path.is_dir():
            raise InputError(path, "expected a file to write, got a folder")
    rows = []
    for row in measure_all(data, chosen, seed):
        rows.append(row)
        words = "  ".join(filter(None, (*table.cells(row), table.failures(row))))
        print(f"{len(rows):>2}/{count(chosen)} {words}", file=sys.stderr, flush=True)
    print(table.as_text(rows), end="")
    if json_file is not None:
        write_text(json_file, json_text(table.as_document(rows)) + "\n")
    if markdown_file is not None:
        write_text(markdown_file, table.as_markdown(rows))


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
