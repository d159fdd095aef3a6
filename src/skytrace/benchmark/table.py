"""Tables of measurements, for a terminal and for documents."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill

_WIDTH = 120


def text_table(
    title: str, header: Sequence[str], rows: Sequence[Sequence[str]], failures: Sequence[str], notes: Sequence[str]
) -> str:
    """The table for a terminal, each row's failure (empty for none) below it, with its notes."""
    table = [header, *rows]
    widths = [max(len(row[k]) for row in table) for k in range(len(header))]
    lines = []
    for row, why in zip(table, ["", *failures], strict=True):
        lines.append("  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip())
        lines += [f"    {why}"] if why else []
    return "\n".join([title, "", *lines, "", *(fill(note, _WIDTH) for note in notes)]) + "\n"


def markdown_table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]], notes: Sequence[str]) -> str:
    """The table for a document, with its notes."""
    lines = ["| " + " | ".join(row) + " |" for row in (header, *rows)]
    rule = "|" + " --- |" * len(header)
    return "\n".join([f"## {title}", "", lines[0], rule, *lines[1:], "", *(f"- {note}" for note in notes)]) + "\n"
