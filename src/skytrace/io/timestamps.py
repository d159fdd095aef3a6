"""Time stamps of a camera's frames, on the camera's own clock: rows `frame time_s`, or times as ffprobe lists them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skytrace.errors import InputError
from skytrace.geometry.arrays import FloatArray, IntArray, frozen_array
from skytrace.io.ffprobe import is_listing, read_listing
from skytrace.io.table import read_table
from skytrace.io.text import read_text

_FRAME, _TIME = ("frame", "frame_number", "n"), ("time_s", "time", "timestamp", "timestamp_s", "pts_time")


_POSSIBLE_RATES_HZ = (1.0, 20_000.0)


@dataclass(frozen=True, eq=False, slots=True)
class Timestamps:
    """When each frame was taken. Frames strictly increase; two frames may carry the same time."""

    path: Path
    frame: IntArray  # (n,)
    time_s: FloatArray  # (n,) never falling
    complete: bool = False  # every frame of the video is listed, from frame 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "frame", frozen_array(self.frame, (None,), "frame", np.int64))
        object.__setattr__(self, "time_s", frozen_array(self.time_s, (len(self.frame),), "time_s"))

    def at(self, frame: IntArray) -> tuple[FloatArray, np.ndarray]:
        """Times (n,) of frames (n,), and for which frames (n,) the file has one; NaN for the others."""
        place = np.minimum(np.searchsorted(self.frame, frame), len(self.frame) - 1)
        known = self.frame[place] == frame
        return np.where(known, self.time_s[place], np.nan), known


def read_timestamps(path: Path | str) -> Timestamps:
    """Read time stamps: rows `frame time_s` (a header may name the two columns), or a listing by ffprobe.

    Raises InputError with the line where a frame is not a whole number, frames do not rise or time falls. Dropped
    frames are longer steps of time and need nothing; frames may share a time.
    """
    path = Path(path)
    if is_listing(read_text(path, "time stamps")):
        listing = read_listing(path)
        return Timestamps(path, listing.frame, listing.time_s, complete=True)
    return _read_rows(path)


def typical_rate_hz(frame: IntArray, time_s: FloatArray) -> float | None:
    """Median frame rate between neighbours of frames (n,) with times (n,), in any order; None where nothing tells."""
    order = np.argsort(frame, kind="stable")
    frames, seconds = np.diff(frame[order]), np.diff(time_s[order])
    rising = (frames > 0) & (seconds > 0)
    if not rising.any():
        return None
    return float(np.median(frames[rising] / seconds[rising]))


def wrong_unit(stamped_hz: float, nominal_hz: float | None) -> str | None:
    """What is wrong with time stamps whose frame rate no camera has, in words; None where it is possible.

    A factor of up to a hundred from the nominal frame rate may be slow motion or time lapse.
    """
    low, high = (nominal_hz / 100, nominal_hz * 100) if nominal_hz is not None else _POSSIBLE_RATES_HZ
    if low <= stamped_hz <= high:
        return None
    # Without a nominal rate, any that videos have.
    typical_hz = nominal_hz or 30.0
    near = 1.1 if nominal_hz is not None else 10.0
    units = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9, "ticks of 1/90000 s": 9e4}
    names = [name for name, unit in units.items() if 1 / near <= stamped_hz * unit / typical_hz <= near]
    told = f"its time stamps tell {stamped_hz:.4g} frames a second"
    if nominal_hz is not None:
        told += f" where {nominal_hz:.4g} are nominal"
    return f"{told}: {f'they look like {names[0]}, ' if names else ''}expected seconds"


def _read_rows(path: Path) -> Timestamps:
    table = read_table(path, "time stamps")
    if not table.rows:
        raise InputError(path, "time stamps: a header and no rows")
    columns = (0, 1)
    if table.header is not None:
        chosen = [next((table.header.index(n) for n in names if n in table.header), None) for names in (_FRAME, _TIME)]
        if chosen[0] is None or chosen[1] is None:
            message = f"header {' '.join(table.header)!r}: expected columns named frame and time_s"
            raise InputError(path, message, line=table.header_line)
        columns = (chosen[0], chosen[1])
    elif len(table.cells(0)) != 2:
        message = (
            f"expected two columns, frame and time_s, or one time a line as ffprobe lists them, got "
            f"{len(table.cells(0))} columns; name them in a header"
        )
        raise InputError(path, message, line=int(table.line[0]))
    frame, time_s = table.numbers(columns, ("frame", "time_s")).T
    for values, whole, what in ((frame, True, "a whole frame number"), (time_s, False, "a finite time_s")):
        bad = ~np.isfinite(values) | (whole & (values != np.round(values)))
        if bad.any():
            row = int(np.argmax(bad))
            raise InputError(path, f"expected {what}, got {values[row]:g}", line=int(table.line[row]))
    order = (frame, np.diff(frame) <= 0, "frame to rise"), (time_s, np.diff(time_s) < 0, "time_s not to fall")
    for values, wrong, what in order:
        if wrong.any():
            row = int(np.argmax(wrong)) + 1
            message = f"expected {what} from row to row, got {values[row]:.9g} after {values[row - 1]:.9g}"
            raise InputError(path, message, line=int(table.line[row]))
    return Timestamps(path, frame.astype(np.int64), time_s)
