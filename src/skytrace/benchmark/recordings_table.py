"""The table of the recordings beside the paper's: plain text, Markdown, CSV, and values for JSON."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from skytrace.benchmark.recordings import Errors, Measurement, Published
from skytrace.benchmark.table import markdown_table, text_table

TITLE = "The public recordings, blind, one configuration (beside the paper: Li et al., IROS 2020, table II)"
NOTES = (
    "Errors in cm after a similarity. Mean, RMSE, median, outliers (above 3 RMSE) and N leave out the samples that err "
    "by more than 10 x the mean, as the paper does; the mean of all does not, and N of all counts what it covers.",
    "Paper: the best of its six variants per recording, on the automatic detections, given near-exact synchronisation. "
    "dataset4 comes without its truth. Centres: camera centres aligned by themselves, in cm.",
    "CPU seconds, seconds and peak memory are those of the whole command in a process of its own, two at a time.",
)
_ERRORS = ("mean", "RMSE", "median", "outliers %", "N")
HEADER = (
    "recording",
    "cameras",
    *_ERRORS,
    "mean of all",
    "N of all",
    "centres",
    "covered s",
    "CPU s",
    "s",
    "peak MiB",
    *(f"paper {name}" for name in _ERRORS),
)


def cells(m: Measurement) -> tuple[str, ...]:
    """One measurement, a cell for each column."""
    all_of_them = ("", "") if m.errors is None else (f"{m.errors.mean_of_all_cm:.1f}", str(m.errors.n_covered))
    return (
        m.name,
        f"{m.n_registered} of {m.n_cameras}",
        *_errors(m.errors),
        *all_of_them,
        _number(m.centres_cm, 1),
        _number(m.covered_s, 0),
        f"{m.cpu_s:.1f}",
        f"{m.wall_s:.1f}",
        f"{m.peak_mib:.0f}",
        *_errors(m.paper),
    )


def _errors(errors: Errors | Published | None) -> tuple[str, ...]:
    if errors is None:
        return ("",) * len(_ERRORS)
    lengths = (errors.mean_cm, errors.rmse_cm, errors.median_cm)
    return (*(f"{value:.1f}" for value in lengths), f"{errors.outlier_percent:.1f}", str(errors.n))


def _number(value: float | None, decimals: int) -> str:
    return "" if value is None else f"{value:.{decimals}f}"


def as_text(rows: Sequence[Measurement]) -> str:
    """The table for a terminal, each failure below its row, with its notes."""
    return text_table(TITLE, HEADER, [cells(m) for m in rows], [m.failure for m in rows], NOTES)


def as_markdown(rows: Sequence[Measurement]) -> str:
    """The table for a document, with its notes."""
    notes = [*NOTES, *(f"{m.name} fails: {m.failure}" for m in rows if m.failure)]
    return markdown_table(TITLE, HEADER, [cells(m) for m in rows], notes)


def as_csv(rows: Sequence[Measurement]) -> str:
    """Every figure in full, a recording a row; empty where there is none."""
    flat = [_flat(m) for m in rows]
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, list(dict.fromkeys(key for row in flat for key in row)), lineterminator="\n")
    writer.writeheader()
    writer.writerows(flat)
    return text.getvalue()


def _flat(m: Measurement) -> dict[str, Any]:
    row = asdict(m)
    errors, failure = row.pop("errors") or dict.fromkeys(Errors.__slots__), row.pop("failure")
    paper = dict.fromkeys(Published.__slots__) if m.paper is None else asdict(m.paper)
    return {**row, **errors, **{f"paper_{key}": value for key, value in paper.items()}, "failure": failure}


def as_document(rows: Sequence[Measurement]) -> dict[str, Any]:
    """Plain values: what was measured, in full."""
    documents = [{**asdict(row), "paper": None if row.paper is None else asdict(row.paper)} for row in rows]
    return {"notes": list(NOTES), "rows": documents}
