"""The measurements of the synchronisation benchmark as a table: plain text, Markdown, and values for JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from textwrap import fill
from typing import Any

from skytrace.benchmark.known_offsets import OffsetErrors
from skytrace.benchmark.synchronisation import PIPELINES, RECORDING, Measurement

TITLE = f"Importance of pairwise synchronisation: {RECORDING}, automatic detections (Li et al., IROS 2020)"
NOTES = (
    "Rough offsets are the known ones (LED flashes) off by 0.5, -0.75, 1, -1.25 and 1.5 times the shift, that of cam2 "
    "being right: cameras with equal errors would be synchronised with each other. Here alone, and in judging the "
    "outcome, does truth enter; the blind row is told no offsets.",
    "Shifts and offset errors, before and after bundle adjustment, are in frames of cam2 (29.73 a second): the mean "
    "over the other cameras of the absolute error in the middle of the common view. Before is the outcome of the "
    "pairwise stage or, where there is none, what was given.",
    "Cameras that are left out fail; where cam2 is one of them, the others' errors are relative to the camera named.",
    "Mean trajectory error after a similarity, samples above 10 x the mean dropped; N: true samples covered.",
)
_WIDTH = 110
HEADER = ("pipeline", "shift", "before", "after", "mean cm", "N", "dropped", "CPU s")


def cells(m: Measurement) -> tuple[str, ...]:
    """One measurement, a cell for each column; what cannot be had, or not of all cameras, fails."""
    t = m.trajectory
    path = ("fails", "", "")
    if t is not None:
        path = (f"{t.mean_cm:.1f}{_of_cameras(m.after)}", f"{t.n_covered} of {t.n_total}", f"{t.n_dropped}")
    return (
        PIPELINES[m.pipeline],
        "any" if m.shift_frames is None else f"{m.shift_frames:g}",
        _errors(m.before),
        _errors(m.after),
        *path,
        f"{m.cpu_s:.0f}",
    )


def failures(m: Measurement) -> str:
    """What failed and why, in words; empty where nothing did."""
    said = [
        f"{name} fails for {', '.join(errors.missing)}"
        + ("" if errors.base == errors.reference else f", the error is relative to {errors.base}")
        for name, errors in (("before", m.before), ("after", m.after))
        if errors is not None and errors.missing
    ]
    return "; ".join([*said, *([f"fails: {m.failure}"] if m.failure else [])])


def _errors(errors: OffsetErrors | None) -> str:
    if errors is None:
        return "fails"
    failed = f" ({len(errors.missing)} fail)" if errors.missing else ""
    return f"{errors.mean_frames:.2f}{failed}"


def _of_cameras(errors: OffsetErrors | None) -> str:
    """How many cameras a path is of, where some are missing."""
    return f" ({len(errors.frames) + 1} cameras)" if errors is not None and errors.missing else ""


def as_text(rows: Sequence[Measurement]) -> str:
    """The table for a terminal, each failure below its row, with its notes."""
    table = [HEADER, *map(cells, rows)]
    widths = [max(len(row[k]) for row in table) for k in range(len(HEADER))]
    lines = []
    for row, why in zip(table, ["", *map(failures, rows)], strict=True):
        lines.append("  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip())
        lines += [f"    {why}"] if why else []
    notes = [fill(note, _WIDTH) for note in NOTES]
    return "\n".join([TITLE, "", *lines, "", *notes]) + "\n"


def as_markdown(rows: Sequence[Measurement]) -> str:
    """The table for a document, with its notes."""
    table = [(*HEADER, "what fails"), *((*cells(row), failures(row)) for row in rows)]
    lines = ["| " + " | ".join(row) + " |" for row in table]
    rule = "|" + " --- |" * len(table[0])
    return "\n".join([f"## {TITLE}", "", lines[0], rule, *lines[1:], "", *(f"- {note}" for note in NOTES)]) + "\n"


def as_document(rows: Sequence[Measurement]) -> dict[str, Any]:
    """Plain values: what was measured, in full."""
    return {"recording": RECORDING, "notes": list(NOTES), "rows": [asdict(row) for row in rows]}
