"""`skytrace export`: a RUN in the format of another program."""

from __future__ import annotations

import sys
from datetime import datetime
from pathlib import Path
from typing import Literal

from skytrace.errors import InputError
from skytrace.io.atomic import atomic_file, atomic_folder
from skytrace.io.export import Content
from skytrace.io.georeference import read_georeference
from skytrace.io.run_folder import read_run
from skytrace.pipeline.export import ExportOptions, export_run, find_format


def export_command(
    run_folder: Path,
    format_name: str,
    output: Path | None,
    rate_hz: float | None,
    frame: Literal["world", "enu"] | None,
    time_zero: str | None,
    with_gaps: bool,
    deviations: bool,
) -> None:
    """Read, convert, write; text without --output, or with -, goes to stdout."""
    chosen = find_format(format_name)
    zero = None if time_zero is None else parse_time_zero(time_zero)
    options = ExportOptions(rate_hz, frame, zero, with_gaps, deviations)
    content = export_run(read_run(run_folder), format_name, options, read_georeference(run_folder))
    if chosen.name == "kml" and not isinstance(zero, datetime):
        print("skytrace: dates count from 1970-01-01 in the KML: give --time-zero the true one", file=sys.stderr)
    if output is not None and str(output) != "-":
        write_content(output, content)
        print(output)
    elif isinstance(content, str):
        print(content, end="")
    else:
        what = "a binary file" if isinstance(content, bytes) else "a folder"
        raise InputError("--output", f"{chosen.name} is {what}: say where to write it")


def write_content(output: Path, content: Content) -> None:
    """Write a file, or a folder that is not there yet or empty, whole or not at all."""
    if isinstance(content, str | bytes):
        with atomic_file(output) as partial:
            partial.write_bytes(content.encode() if isinstance(content, str) else content)
        return
    with atomic_folder(output, replace_run=False) as folder:
        for name, text in content.items():
            (folder / name).write_text(text, encoding="utf-8")


def parse_time_zero(text: str) -> datetime | Literal["start"]:
    """`start`, or a date and time with its zone. Raises InputError."""
    if text == "start":
        return "start"
    expected = "expected start, or a date and time with its zone such as 2024-05-03T10:15:00Z"
    try:
        instant = datetime.fromisoformat(text)
    except ValueError:
        raise InputError("--time-zero", f"{expected}; got {text!r}") from None
    if instant.tzinfo is None:
        raise InputError("--time-zero", f"{expected}; got {text!r}, which has no zone")
    return instant
