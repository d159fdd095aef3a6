"""The measurements of the ablation as a table: plain text, Markdown, and values for JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from skytrace.benchmark.ablation import Measurement, Variant
from skytrace.benchmark.table import markdown_table, text_table

TITLE = "Motion priors, rolling shutter and lenses: what each is worth (Li et al., IROS 2020, table II)"
NOTES = (
    "Errors in cm after a similarity, blind. Mean, RMSE, median, outliers (above 3 RMSE) and N leave out the samples "
    "that err by more than 10 x the mean, as the paper does; the mean of all does not.",
    "Rolling shutter: none (rows are exposed together), estimated (the default), or assumed (readout times stay at 0.6 "
    "of a frame: --no-rolling-shutter). Lenses: calibrated is the paper's setting (--fix-lens), refined the default; "
    "focal only and all but focal keep the rest as calibrated.",
    "The synchronisation depends on the tracks, the hints, the seed and the readout assumed, not on what else the rows "
    "differ in: it is computed once for each readout. CPU seconds are those of everything after it.",
)
_WIDTH = 110
HEADER = (
    "flight",
    "motion prior",
    "rolling shutter",
    "lenses",
    "mean",
    "RMSE",
    "median",
    "outliers %",
    "N",
    "dropped",
    "mean of all",
    "CPU s",
)


def lenses(variant: Variant) -> str:
    """What of the lenses the flight refines."""
    if variant.focal:
        return "refined" if variant.lens else "focal only"
    return "all but focal" if variant.lens else "calibrated"


def cells(m: Measurement) -> tuple[str, ...]:
    """One measurement, a cell for each column."""
    variant = (m.flight, m.variant.motion, m.variant.shutter, lenses(m.variant))
    if m.errors is None or m.without_large is None:
        return (*variant, "fails", "", "", "", "", "", "", f"{m.cpu_s:.1f}")
    kept = m.without_large
    return (
        *variant,
        *(f"{100 * value:.1f}" for value in (kept.mean, kept.rmse, kept.median)),
        f"{kept.outlier_percent:.1f}",
        f"{kept.n}",
        f"{m.n_dropped}",
        f"{100 * m.errors.mean:.1f}",
        f"{m.cpu_s:.1f}",
    )


def as_text(rows: Sequence[Measurement]) -> str:
    """The table for a terminal, each failure below its row, with its notes."""
    return text_table(TITLE, HEADER, [cells(m) for m in rows], [m.failure for m in rows], NOTES)


def as_markdown(rows: Sequence[Measurement]) -> str:
    """The table for a document, with its notes."""
    return markdown_table(TITLE, (*HEADER, "what fails"), [(*cells(m), m.failure) for m in rows], NOTES)


def as_document(rows: Sequence[Measurement]) -> dict[str, Any]:
    """Plain values: what was measured, in full."""
    return {"notes": list(NOTES), "rows": [asdict(row) for row in rows]}
