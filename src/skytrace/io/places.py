"""Tables of places: of cameras by id, or of the target by time; in metres or on the earth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from skytrace.errors import InputError
from skytrace.geometry.arrays import FloatArray
from skytrace.io.table import TextTable, read_table

_METRES = (("x", "x_m", "east_m", "e"), ("y", "y_m", "north_m", "n"), ("z", "z_m", "up_m", "u"))
_EARTH = (
    ("latitude_deg", "latitude", "lat"),
    ("longitude_deg", "longitude", "lon", "lng"),
    ("height_m", "height", "altitude_m", "altitude", "alt", "ele"),
)
_SIGMA = ("sigma_m", "accuracy_m", "accuracy")


@dataclass(frozen=True, eq=False, slots=True)
class Places:
    """Rows of a table of places: of cameras where `camera_ids` is there, else at times `time_s` (n,)."""

    path: Path
    camera_ids: tuple[str, ...] | None
    time_s: FloatArray | None
    position: FloatArray  # (n, 3) metres; on the earth latitude and longitude in radians, height in metres
    on_earth: bool
    sigma_m: FloatArray | None  # (n,) where the table tells it


def read_places(path: Path | str, key: Literal["camera", "time_s"]) -> Places:
    """Read a table with the header `camera` or `time_s`, then x,y,z or latitude_deg,longitude_deg,height_m, sigma_m.

    The last is optional; the order and further columns do not matter. Times must rise. Raises InputError with the line.
    """
    path = Path(path)
    table = read_table(path, "table of places")
    expected = f"expected a header {key},x,y,z or {key},latitude_deg,longitude_deg,height_m, optionally with sigma_m"
    if table.header is None:
        raise InputError(path, f"{expected}; got none", line=int(table.line[0]))
    own, columns, on_earth = _columns(table, key, expected)
    if not table.rows:
        raise InputError(path, "a header and no rows")
    values = table.numbers(columns, [table.header[c] for c in columns])
    wrong = ~np.isfinite(values).all(axis=1) | (values[:, 3:] <= 0).any(axis=1)
    if on_earth:
        wrong |= (np.abs(values[:, 0]) > 90) | (np.abs(values[:, 1]) > 360)
    if wrong.any():
        what = "latitude, longitude in degrees and height in metres" if on_earth else "three numbers"
        message = f"expected {what}{' and a positive deviation' if values.shape[1] > 3 else ''}"
        raise InputError(path, message, line=int(table.line[np.argmax(wrong)]))
    position = values[:, :3]
    if on_earth:
        position = np.column_stack([np.radians(position[:, :2]), position[:, 2]])
    ids, time_s = _keys(table, own, key)
    return Places(path, ids, time_s, position, on_earth, values[:, 3] if values.shape[1] > 3 else None)


def _columns(table: TextTable, key: str, expected: str) -> tuple[int, tuple[int, ...], bool]:
    """The key's column, those of the place and, where there is one, of the deviation; whether it is on the earth."""
    header = table.header or ()

    def find(names: tuple[str, ...]) -> int | None:
        return next((header.index(name) for name in names if name in header), None)

    own = find((key,))
    earth, metres = [find(names) for names in _EARTH], [find(names) for names in _METRES]
    on_earth = all(c is not None for c in earth)
    if own is None or on_earth == all(c is not None for c in metres):
        raise InputError(table.path, f"{expected}; got {','.join(header)}", line=table.header_line)
    found = [c for c in (*(earth if on_earth else metres), find(_SIGMA)) if c is not None]
    return own, tuple(found), on_earth


def _keys(table: TextTable, column: int, key: str) -> tuple[tuple[str, ...] | None, FloatArray | None]:
    if key == "camera":
        ids = tuple(table.cells(row)[column] for row in range(len(table.rows)))
        for row, camera_id in enumerate(ids):
            if camera_id in ids[:row]:
                raise InputError(table.path, f"camera {camera_id!r} appears twice", line=int(table.line[row]))
        return ids, None
    time_s = table.numbers((column,), (key,))[:, 0]
    wrong = ~np.isfinite(time_s)
    wrong[1:] |= np.diff(time_s) <= 0
    if wrong.any():
        row = int(np.argmax(wrong))
        message = f"expected time_s to rise from row to row, got {time_s[row]:.9g}"
        raise InputError(table.path, message, line=int(table.line[row]))
    return None, time_s
