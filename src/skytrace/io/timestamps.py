"""Time stamps of a camera's frames: rows `frame time_s` on the camera's own clock."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skytrace.errors import InputError
from skytrace.geometry.arrays import FloatArray, IntArray, frozen_array
from skytrace.io.table import read_table


@dataclass(frozen=True, eq=False, slots=True)
class Timestamps:
    """When each frame was taken; frames and times strictly increasing."""

    path: Path
    frame: IntArray  # (n,)
    time_s: FloatArray  # (n,)

    def __post_init__(self) -> None:
        object.__setattr__(self, "frame", frozen_array(self.frame, (None,), "frame", np.int64))
        object.__setattr__(self, "time_s", frozen_array(self.time_s, (len(self.frame),), "time_s"))

    def at(self, frame: IntArray) -> tuple[FloatArray, np.ndarray]:
        """Times (n,) of frames (n,), and for which frames (n,) the file has one; NaN for the others."""
        place = np.minimum(np.searchsorted(self.frame, frame), len(self.frame) - 1)
        known = self.frame[place] == frame
        return np.where(known, self.time_s[place], np.nan), known


def read_timestamps(path: Path | str) -> Timestamps:
    """Read `frame time_s` rows (a header may name the two columns in either order).

    Raises InputError with the line where a frame is not a whole number or frame or time does not rise.
    """
    path = Path(path)
    table = read_table(path, "time stamps")
    if not table.rows:
        raise InputError(path, "time stamps: a header and no rows")
    columns = (0, 1)
    if table.header is not None:
        names = table.header
        if "frame" not in names or "time_s" not in names:
            message = f"header {' '.join(table.header)!r}: expected columns named frame and time_s"
            raise InputError(path, message, line=table.header_line)
        columns = (names.index("frame"), names.index("time_s"))
    elif len(table.cells(0)) != 2:
        message = f"expected two columns, frame and time_s, got {len(table.cells(0))}; name them in a header"
        raise InputError(path, message, line=int(table.line[0]))
    frame, time_s = table.numbers(columns, ("frame", "time_s")).T
    for values, whole, what in ((frame, True, "a whole frame number"), (time_s, False, "a finite time_s")):
        bad = ~np.isfinite(values) | (whole & (values != np.round(values)))
        if bad.any():
            row = int(np.argmax(bad))
            raise InputError(path, f"expected {what}, got {values[row]:g}", line=int(table.line[row]))
    for values, what in ((frame, "frame"), (time_s, "time_s")):
        falling = np.diff(values) <= 0
        if falling.any():
            row = int(np.argmax(falling)) + 1
            message = f"expected {what} to rise from row to row, got {values[row]:.9g} after {values[row - 1]:.9g}"
            raise InputError(path, message, line=int(table.line[row]))
    return Timestamps(path, frame.astype(np.int64), time_s)
