"""What is left of a track when it has ended: its rows, and what its detections were like."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.geometry.arrays import FloatArray, IntArray, frozen_array
from skytrace.vision import candidates as cand
from skytrace.vision import link

# Columns of a row as the tracker keeps it.
FRAME, X, Y, SIGMA, ISOLATED, CHANGE, CONTRAST, SIZE = range(8)
N_COLUMNS = 8

_PACK = 256  # rows
_RESTING_PX = 1.5  # at most, between two measurements of something that did not change in between
_RESTING_SHARE = 0.25  # of that way, added to the deviation of a place in between
_STUCK_PX, _STUCK_S = 1e-6, 0.33  # a camera's picture of anything trembles more
_HANGING_S = 1.0
_FOLLOWED = 0.5
_STRONG = 3.0  # times the limit for a change: what stands out this much is beyond doubt


class Rows:
    """The rows of a track under way, packed, and only the last of them as long as they may prove useless."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._packed: list[FloatArray] = []
        self._loose: list[tuple[float, ...]] = []

    def append(self, row: tuple[float, ...], keep_all: bool) -> None:
        """Add a row; without `keep_all` the oldest beyond the limit may go."""
        self._loose.append(row)
        if len(self._loose) == _PACK:
            self._packed.append(np.array(self._loose))
            self._loose.clear()
            if not keep_all and (len(self._packed) - 1) * _PACK >= self._limit:
                del self._packed[0]

    def array(self) -> FloatArray:
        """All rows (n, N_COLUMNS)."""
        loose = np.array(self._loose).reshape(-1, N_COLUMNS)
        return np.vstack([*self._packed, loose])


@dataclass(frozen=True, eq=False, slots=True)
class FoundTrack:
    """Something that moved through a video: one place a frame."""

    track_id: int
    frame: IntArray  # (n,) strictly increasing
    xy_px: FloatArray  # (n, 2) raw pixels
    sigma_px: FloatArray  # (n,) deviation along each axis
    contrast: float  # median of its mean difference to its surroundings in luma codes; negative: darker
    size_px: float  # median of the root of its area
    strength: float  # how many times it exceeded the detector's limits, on the average of the last seconds

    def __post_init__(self) -> None:
        object.__setattr__(self, "frame", frozen_array(self.frame, (None,), "frame", np.int64))
        n = len(self.frame)
        object.__setattr__(self, "xy_px", frozen_array(self.xy_px, (n, 2), "xy_px"))
        object.__setattr__(self, "sigma_px", frozen_array(self.sigma_px, (n,), "sigma_px"))

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def quality(self) -> float:
        """From 0 to 1: the share of frames from its first to its last in which it was found, less if it was faint."""
        span = self.frame[-1] - self.frame[0] + 1
        return float(len(self) / span * min(1.0, self.strength / _STRONG))


def finished(track_id: int, rows: FloatArray, marks: FloatArray, rate_hz: float) -> FoundTrack:
    """A track from its rows (n, N_COLUMNS) in order and its marks (link.N_COLUMNS,) when it ended."""
    rows = with_rests(rows)
    rows = rows[: count_moving(rows, marks[link.SIZE], rate_hz)]
    rows = rows[: count_followed(rows[:, FRAME])]
    # Only against the sky is it seen whole.
    clear = rows[rows[:, ISOLATED] > 0.5]
    looks = clear if len(clear) else rows
    return FoundTrack(
        track_id,
        rows[:, FRAME].astype(np.int64),
        rows[:, [X, Y]],
        rows[:, SIGMA],
        float(np.median(looks[:, CONTRAST])),
        float(np.median(looks[:, SIZE])),
        float(marks[link.STRENGTH]),
    )


def with_rests(rows: FloatArray) -> FloatArray:
    """Rows (m, N_COLUMNS) with those frames filled in for which something that stood still was not measured.

    Its pixels did not change in between, or they would have been looked at.
    """
    step = np.diff(rows[:, FRAME])
    way = np.hypot(*np.diff(rows[:, [X, Y]], axis=0).T)
    resting = (step > 1) & (step <= cand.REST_FRAMES + 1) & (rows[:-1, CHANGE] <= 1) & (way < _RESTING_PX)
    if not resting.any():
        return rows
    between = [np.arange(rows[k, FRAME] + 1, rows[k + 1, FRAME]) for k in np.flatnonzero(resting)]
    frames = np.sort(np.concatenate([rows[:, FRAME], *between]))
    filled = np.column_stack([frames, *(np.interp(frames, rows[:, FRAME], values) for values in rows[:, 1:].T)])
    filled[:, SIGMA] += ~np.isin(frames, rows[:, FRAME]) * _RESTING_SHARE * np.interp(frames, rows[1:, FRAME], way)
    return filled


def count_followed(frame: FloatArray) -> int:
    """How many rows (n,) are left when a tail is cut off in which the track was hardly ever found.

    A target lost against trees leaves its track to chance. Of all beginnings of the track it is the one in which the
    frames found most exceed a share of `_FOLLOWED` of all frames.
    """
    found = np.arange(1, len(frame) + 1)
    return int(np.argmax(found - _FOLLOWED * (frame - frame[0]))) + 1


def count_moving(rows: FloatArray, size_px: float, rate_hz: float) -> int:
    """How many rows (n, N_COLUMNS) are left when what a track came to stand on at its end is cut off.

    A codec can leave a picture behind of what has flown on, which does not even tremble; and a target lost in front of
    trees can leave its track hanging there.
    """
    away = np.hypot(rows[:, X] - rows[-1, X], rows[:, Y] - rows[-1, Y])
    hanging = (away <= max(2.0, size_px)) & (rows[:, ISOLATED] == 0)
    for standing, longest_s in ((away <= _STUCK_PX, _STUCK_S), (hanging, _HANGING_S)):
        moving = np.flatnonzero(~standing)
        last = moving[-1] + 1 if len(moving) else 0
        if len(rows) - last > longest_s * rate_hz:
            return last + 1
    return len(rows)
