"""The measurements of the calibration benchmark as two tables: plain text, Markdown, and values for JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from textwrap import fill
from typing import Any

from skytrace.benchmark.calibration import RECORDING, FlightMeasurement, LensMeasurement

Measurement = LensMeasurement | FlightMeasurement

TITLE = f"Calibration from photographs: the six lenses of {RECORDING}"
FLIGHT_TITLE = f"{RECORDING}, automatic detections, blind, with these calibrations"
NOTES = (
    "No hint is given: board size, lens model and pixel aspect are found out. RMS: root mean square length of the "
    "residuals of the corners used. Halves: root mean square difference of the focal lengths of two random halves of "
    "the pictures. OpenCV: findChessboardCorners of the known size and calibrateCamera with its defaults.",
    "Mean and median distance from the true path after a similarity, over all N samples of the truth covered. Refined: "
    "the default; focal fixed: --fix-focal; fixed: --fix-lens. Published: the calibrations that come with the "
    "recordings.",
)
_WIDTH = 110
HEADER = ("device", "pictures used", "model", "RMS px", "focal px", "sd %", "halves %", "published", "OpenCV", "CPU s")
FLIGHT_HEADER = ("calibrations", "lenses", "mean cm", "median cm", "N", "CPU s")


def cells(m: Measurement) -> tuple[str, ...]:
    """One measurement, a cell for each column of its table."""
    if isinstance(m, FlightMeasurement):
        failed = ("fails", "", "")
        figures = failed if m.mean_cm is None else (f"{m.mean_cm:.1f}", f"{m.median_cm:.1f}", f"{m.n_covered}")
        return (m.source, m.lenses, *figures, f"{m.cpu_s:.0f}")
    plain = "fails" if m.plain is None else f"{m.plain.used} used, {m.plain.rms_px:.2f} px, {m.plain.focal_px:.1f}"
    return (
        m.device,
        f"{m.used} of {m.pictures}",
        m.model,
        f"{m.rms_px:.2f}",
        f"{m.focal_px:.1f}",
        f"{100 * m.focal_sd:.2f}",
        "" if m.halves_rms is None else f"{100 * m.halves_rms:.2f}",
        f"{m.published_focal_px:.1f}",
        plain,
        f"{m.cpu_s:.0f}",
    )


def as_text(rows: Sequence[Measurement]) -> str:
    """Both tables for a terminal, with their notes."""
    parts = []
    for title, table, note in _tables(rows):
        widths = [max(len(row[k]) for row in table) for k in range(len(table[0]))]
        lines = ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in table]
        parts.append("\n".join([title, "", *lines, "", fill(note, _WIDTH)]))
    return "\n\n".join(parts) + "\n"


def as_markdown(rows: Sequence[Measurement]) -> str:
    """Both tables for a document, with their notes."""
    parts = []
    for title, table, note in _tables(rows):
        lines = ["| " + " | ".join(row) + " |" for row in table]
        parts.append("\n".join([f"## {title}", "", lines[0], "|" + " --- |" * len(table[0]), *lines[1:], "", note]))
    return "\n\n".join(parts) + "\n"


def as_document(rows: Sequence[Measurement]) -> dict[str, Any]:
    """Plain values: what was measured, in full."""
    return {
        "recording": RECORDING,
        "notes": list(NOTES),
        "lenses": [asdict(row) for row in rows if isinstance(row, LensMeasurement)],
        "flights": [asdict(row) for row in rows if isinstance(row, FlightMeasurement)],
    }


def _tables(rows: Sequence[Measurement]) -> list[tuple[str, list[tuple[str, ...]], str]]:
    lenses = [cells(row) for row in rows if isinstance(row, LensMeasurement)]
    flights = [cells(row) for row in rows if isinstance(row, FlightMeasurement)]
    return [(TITLE, [HEADER, *lenses], NOTES[0]), (FLIGHT_TITLE, [FLIGHT_HEADER, *flights], NOTES[1])]
