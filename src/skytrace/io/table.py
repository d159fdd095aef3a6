"""Tables of numbers in text: one parser for whitespace, comma, semicolon and tab, that knows every row's line."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skytrace.errors import InputError
from skytrace.geometry.arrays import FloatArray, IntArray
from skytrace.io.text import read_text, shortened

_NUMBER = re.compile(r"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|nan|inf(?:inity)?)", re.IGNORECASE)

# One name of two words, also where white space separates the columns.
_FRAME_NUMBER = re.compile(r"\bframe[ _](?:no\b\.?|nr\b\.?|number\b|index\b)", re.IGNORECASE)


@dataclass(frozen=True, eq=False, slots=True)
class TextTable:
    """The rows of a table, not yet numbers. Blank lines and `#` comments are gone, header lines set apart."""

    path: Path
    header: tuple[str, ...] | None  # names in lower case, those of the last line before the first number
    header_line: int | None
    rows: tuple[str, ...]
    line: IntArray  # (n,) line numbers from 1
    delimiter: str | None  # None: any white space
    comments: tuple[str, ...]

    def cells(self, row: int) -> list[str]:
        """The cells of a row as text."""
        return _split(self.rows[row].split("#")[0], self.delimiter)

    def numbers(self, columns: Sequence[int], names: Sequence[str]) -> FloatArray:
        """The chosen columns as numbers (n, len(columns)); an empty cell is NaN.

        `names` says in messages what the columns hold. Raises InputError naming the first line that has too few
        columns or a cell that is not a number.
        """
        if not self.rows:
            return np.zeros((0, len(columns)))
        try:
            return np.loadtxt(self.rows, delimiter=self.delimiter, usecols=tuple(columns), ndmin=2)
        except ValueError:
            return self._numbers_one_by_one(columns, names)

    def _numbers_one_by_one(self, columns: Sequence[int], names: Sequence[str]) -> FloatArray:
        values = np.empty((len(self.rows), len(columns)))
        for row in range(len(self.rows)):
            cells = self.cells(row)
            if len(cells) <= max(columns):
                raise InputError(
                    self.path,
                    f"expected at least {max(columns) + 1} columns ({' '.join(names)}), got {len(cells)}: "
                    f"{shortened(self.rows[row])}",
                    line=int(self.line[row]),
                )
            for k, column in enumerate(columns):
                values[row, k] = self._number(cells[column], row, names[k])
        return values

    def _number(self, cell: str, row: int, name: str) -> float:
        if cell == "":
            return float("nan")
        if not _NUMBER.fullmatch(cell):
            hint = "; write decimals with a point" if re.fullmatch(r"[+-]?\d+,\d+", cell) else ""
            message = f"expected a number for {name}, got {shortened(cell)}{hint}"
            raise InputError(self.path, message, line=int(self.line[row]))
        return float(cell)


def read_table(path: Path, what: str) -> TextTable:
    """Read a table of numbers. Raises InputError when the file cannot be read or holds no row at all."""
    text = read_text(path, what)
    lines = [(n, line) for n, line in enumerate(text.split("\n"), 1) if line and not line.isspace()]
    kept = [(n, line) for n, line in lines if line.lstrip()[0] != "#"]
    if not kept:
        raise InputError(path, f"{what} is empty: expected one row of numbers per line")
    # A header is a line without a single number; one bad cell among numbers is a mistake to report, not a header.
    first = next((k for k, (_, s) in enumerate(kept) if _has_number(s)), len(kept))
    header, header_line = (None, None) if first == 0 else (_header_names(kept[first - 1][1]), kept[first - 1][0])
    rows = kept[first:]
    return TextTable(
        path=path,
        header=header,
        header_line=header_line,
        rows=tuple(s for _, s in rows),
        line=np.array([n for n, _ in rows], np.int64),
        delimiter=_delimiter(rows[0][1].split("#")[0]) if rows else None,
        comments=tuple(line.lstrip()[1:].strip() for _, line in lines if line.lstrip()[0] == "#"),
    )


def _has_number(line: str) -> bool:
    return any(_NUMBER.fullmatch(cell.strip("\"'")) for cell in re.split(r"[,;\s]+", line.strip()) if cell)


def _delimiter(line: str) -> str | None:
    for character in ";,":
        if character in line:
            return character
    # Tabs may also just align columns; as separators they are taken only where both readings agree on the first row.
    return "\t" if "\t" in line and len(line.split("\t")) == len(line.split()) else None


def _split(line: str, delimiter: str | None) -> list[str]:
    return [cell.strip().strip('"') for cell in line.split(delimiter)]


def _header_names(line: str) -> tuple[str, ...]:
    delimiter = next((c for c in ";,\t" if c in line), None)
    names = [name.strip("\"' ").lower() for name in re.sub(_FRAME_NUMBER, "frame", line).strip().split(delimiter)]
    return tuple(names)
