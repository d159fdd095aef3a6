"""Detections of the target in one camera: `x y frame`, `frame x y`, or a CSV whose header names its columns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skytrace.errors import InputError
from skytrace.geometry.arrays import FloatArray, IntArray, frozen_array
from skytrace.io.table import TextTable, read_table
from skytrace.io.text import did_you_mean

# Names in files -> the one name used here. `track_id` is known, so that it may be declared, and not used.
_ALIASES = {
    "frame": "frame",
    "x": "x",
    "x_px": "x",
    "y": "y",
    "y_px": "y",
    "sigma": "sigma_px",
    "sigma_px": "sigma_px",
    "time_s": "time_s",
    "target": "target",
    "track_id": "track_id",
}
_REQUIRED = ("frame", "x", "y")
_LARGEST_FRAME = 2.0**53  # beyond it a float no longer holds every integer
_BOX_SIZES = ({"w", "h"}, {"width", "height"})


@dataclass(frozen=True, eq=False, slots=True)
class RawDetections:
    """The rows of a detection file in the file's order, not cleaned: frames may repeat, positions may be NaN."""

    path: Path
    frame: IntArray  # (n,)
    x: FloatArray  # (n,) raw (distorted) pixels; NaN where the file has no finite number
    y: FloatArray  # (n,) raw pixels
    sigma_px: FloatArray | None  # (n,) positive where x and y are finite
    time_s: FloatArray | None  # (n,) time stamps on the camera's own clock, never falling with the frame
    line: IntArray  # (n,) line numbers in the file, from 1
    n_absent: int = 0  # rows `0 0` that said "not visible", dropped
    n_other_target: int = 0  # rows of tracks that are not the target's, dropped

    def __post_init__(self) -> None:
        object.__setattr__(self, "frame", frozen_array(self.frame, (None,), "frame", np.int64))
        n = len(self.frame)
        for name in ("x", "y", "sigma_px", "time_s"):
            if (values := getattr(self, name)) is not None:
                object.__setattr__(self, name, frozen_array(values, (n,), name, finite=False))
        object.__setattr__(self, "line", frozen_array(self.line, (n,), "line", np.int64))

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def xy_px(self) -> FloatArray:
        """Positions (n, 2) in raw pixels."""
        return np.column_stack([self.x, self.y])


def no_detections(path: Path) -> RawDetections:
    """What a camera has that never saw the target, or whose video was not looked at."""
    nothing = np.zeros(0)
    return RawDetections(path, np.zeros(0, np.int64), nothing, nothing, None, None, np.zeros(0, np.int64))


def parse_columns(columns: str) -> tuple[str, ...]:
    """The columns a declaration such as "x y frame" names, `_` for one to skip.

    Raises ValueError on an unknown or repeated name, or where frame, x or y is missing.
    """
    names = []
    for word in columns.replace(",", " ").split():
        if word != "_" and word.lower() not in _ALIASES:
            known = [*dict.fromkeys(_ALIASES.values()), "_"]
            raise ValueError(f"unknown column {word!r}{did_you_mean(word, known)}; known: {', '.join(known)}")
        names.append(word if word == "_" else _ALIASES[word.lower()])
    return _checked_names(tuple(names))


def read_detections(path: Path | str, columns: str | None = None) -> RawDetections:
    """Read one camera's detections.

    `columns` declares the columns in order (see `parse_columns`); without it the file's header must name them.
    Rows `0 0` (not visible) and rows with `target` 0 are dropped and counted. Raises InputError with the line.
    """
    path = Path(path)
    table = read_table(path, "detections")
    if columns is None:
        column = _columns_of_header(table)
    else:
        column = _columns_declared(table, columns)
    if not table.rows:
        raise InputError(path, "detections: a header and no rows; remove the camera if it never sees the target")
    used = {name: k for name, k in column.items() if name != "track_id"}
    numbers = table.numbers(tuple(used.values()), tuple(used))
    numbers[np.isinf(numbers)] = np.nan
    values = dict(zip(used, numbers.T, strict=True))
    _refuse_swapped_columns(table, values)
    return _assemble(table, values)


def _checked_names(names: tuple[str, ...]) -> tuple[str, ...]:
    for name in set(names) - {"_"}:
        if names.count(name) > 1:
            raise ValueError(f"column {name!r} is named twice")
    missing = [name for name in _REQUIRED if name not in names]
    if missing:
        raise ValueError(f"no column {' or '.join(map(repr, missing))}; frame, x and y are needed")
    return names


def _columns_of_header(table: TextTable) -> Mapping[str, int]:
    if table.header is None:
        message = (
            "no header names the columns: set detections_columns, for example "
            '"x y frame" or "frame x y", to say what they hold'
        )
        raise InputError(table.path, message, line=int(table.line[0]))
    names = tuple(_ALIASES.get(name, "_") for name in table.header)
    try:
        _checked_names(names)
    except ValueError as error:
        message = f"header {' '.join(table.header)!r}: {error}; rename the columns or set detections_columns"
        raise InputError(table.path, message, line=table.header_line) from None
    # A box is given by a corner as often as by its centre; half a box is too much to guess about.
    if any(sizes <= set(table.header) for sizes in _BOX_SIZES):
        message = (
            "the header describes boxes: write the boxes' centres and set detections_columns "
            "to confirm that x and y are the target's centre"
        )
        raise InputError(table.path, message, line=table.header_line)
    return {name: k for k, name in enumerate(names) if name != "_"}


def _columns_declared(table: TextTable, columns: str) -> Mapping[str, int]:
    try:
        names = parse_columns(columns)
    except ValueError as error:
        raise InputError(table.path, f"detections_columns {columns!r}: {error}") from None
    for k, (said, header) in enumerate(zip(names, table.header or (), strict=False)):
        known = _ALIASES.get(header)
        if known in _REQUIRED and said in _REQUIRED and known != said:
            message = (
                f"column {k + 1} is {header!r} in the header, {said!r} in detections_columns {columns!r}; correct one"
            )
            raise InputError(table.path, message, line=table.header_line)
    return {name: k for k, name in enumerate(names) if name != "_"}


def _refuse_swapped_columns(table: TextTable, values: Mapping[str, FloatArray]) -> None:
    """Frames go up from row to row; where they do not and x or y does, the columns are declared in a wrong order."""
    if len(table.rows) < 10:
        return
    rising = {name: float(np.mean(np.diff(values[name]) > 0)) for name in _REQUIRED}
    for name in ("x", "y"):
        if rising["frame"] < 0.9 and rising[name] > 0.99 and (values[name] == np.round(values[name])).all():
            message = (
                f"the columns look swapped: what is declared as {name!r} counts up in every row, what is declared as "
                f"'frame' does not (up in {100 * rising['frame']:.0f} % of the rows); "
                "correct detections_columns or the header"
            )
            raise InputError(table.path, message, line=int(table.line[0]))


def _assemble(table: TextTable, values: Mapping[str, FloatArray]) -> RawDetections:
    frame = values["frame"]
    whole = (frame == np.round(frame)) & (np.abs(frame) <= _LARGEST_FRAME)
    _refuse_rows(table, ~whole, frame, "expected a whole frame number")
    seen = np.isfinite(values["x"]) & np.isfinite(values["y"])
    absent = (values["x"] == 0) & (values["y"] == 0)
    other = np.zeros(len(frame), bool)
    if "target" in values:
        _refuse_rows(table, ~np.isin(values["target"], (0, 1)), values["target"], "expected target 0 or 1")
        other = values["target"] == 0
    kept = ~absent & ~other
    if "sigma_px" in values:
        sigma = values["sigma_px"]
        _refuse_rows(table, kept & seen & ~((sigma > 0) & np.isfinite(sigma)), sigma, "expected a positive sigma_px")
    if "time_s" in values:
        _refuse_rows(table, kept & ~np.isfinite(values["time_s"]), values["time_s"], "expected a finite time_s")
        _refuse_falling_time(table, np.flatnonzero(kept), frame, values["time_s"])
    return RawDetections(
        path=table.path,
        frame=frame[kept].astype(np.int64),
        x=np.where(seen, values["x"], np.nan)[kept],
        y=np.where(seen, values["y"], np.nan)[kept],
        sigma_px=values["sigma_px"][kept] if "sigma_px" in values else None,
        time_s=values["time_s"][kept] if "time_s" in values else None,
        line=table.line[kept],
        n_absent=int((absent & ~other).sum()),
        n_other_target=int(other.sum()),
    )


def _refuse_rows(table: TextTable, bad: np.ndarray, values: FloatArray, expected: str) -> None:
    if bad.any():
        row = int(np.argmax(bad))
        raise InputError(table.path, f"{expected}, got {values[row]:g}", line=int(table.line[row]))


def _refuse_falling_time(table: TextTable, rows: IntArray, frame: FloatArray, time_s: FloatArray) -> None:
    """Rows of several tracks may repeat a frame, with the same time; from frame to frame time must not fall."""
    order = rows[np.argsort(frame[rows], kind="stable")]
    step, rise = np.diff(frame[order]), np.diff(time_s[order])
    wrong = np.where(step == 0, rise != 0, rise < 0)
    if wrong.any():
        row, before = int(order[1:][wrong][0]), int(order[:-1][wrong][0])
        message = (
            f"time stamps must follow the frame number: frame {frame[row]:.0f} at {time_s[row]:.6f} s, "
            f"frame {frame[before]:.0f} at {time_s[before]:.6f} s (line {table.line[before]})"
        )
        raise InputError(table.path, message, line=int(table.line[row]))
