"""The default detector: what is small, stands out of the sky or of its own past, and has solid edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skytrace.geometry.arrays import FloatArray
from skytrace.vision import candidates, refine
from skytrace.vision.blobs import group_hits
from skytrace.vision.scan import BLOCK, UNITS_PER_LUMA, learn_past, mark_hits, quiet_neighbours, set_limits, sum_pairs
from skytrace.vision.steady import Steadiness
from skytrace.vision.window import WINDOW, open_and_close

LumaArray = NDArray[np.uint8]

_CLUTTER_EVERY = 8  # pictures


@dataclass(frozen=True, slots=True)
class DetectorSettings:
    """Limits are for what is new; luma floors keep the codec's own noise out."""

    change_factor: float = 3.0  # times the spread that a pixel's own changes exceed in one frame of twenty
    change_floor: float = 2.5  # luma codes
    standing_factor: float = 7.0  # times the mean response of the quiet surroundings
    standing_floor: float = 3.75  # luma codes
    rate_hz: float = 30.0  # the background learns this often; faster videos are not learned faster
    memory_frames: float = 256.0  # over which a pixel's usual response follows
    widen: float = 1 / 16
    exceeded: float = 0.05  # share of the frames in which a change exceeds its pixel's spread
    max_hit_share: float = 0.05  # more pixels than this do not change at once but when the camera moves
    max_candidates: int = 200

    def factors(self) -> NDArray[np.float64]:
        """For the compiled loops, in their units."""
        u = UNITS_PER_LUMA
        return np.array([self.change_factor, u * self.change_floor, self.standing_factor, u * self.standing_floor])


class Detector:
    """Looks at one picture after the other; `learn` after each.

    The picture is reduced by 2x2 sums. What is narrower than a window of 32 pixels stands out of the picture's opening
    and closing by that window; unlike a local mean, these follow the edges of roofs and trees. A pixel is marked where
    this response exceeds what is usual around it, or differs from its own past by more than it usually does: the past
    is a running median and a high quantile of the changes, moved in small steps (after Manzanera and Richefeu, "A new
    motion detection algorithm based on sigma-delta background estimation", Pattern Recognition Letters 28, 2007), so
    that a target leaves little trace and swaying leaves raise their own limit. Marked pixels are grouped, and measured
    in the full picture. A mask (height, width) is zero where nothing is to be found.
    """

    def __init__(
        self,
        size_px: tuple[int, int],
        frame_rate_hz: float,
        mask: LumaArray | None = None,
        settings: DetectorSettings | None = None,
    ) -> None:
        self._settings = settings = settings or DetectorSettings()
        self._factors = settings.factors()
        width, height = size_px
        h, w = height // 2, width // 2
        blocks = (-(-h // BLOCK), -(-w // BLOCK))
        self._size_px = size_px
        self._sums = np.empty((h, w), np.uint16)
        self._means, self._scratch, self._opened, self._closed = np.zeros((4, h + WINDOW, w + WINDOW), np.uint8)
        self._response, self._hit = np.empty((h, w), np.int16), np.zeros((h, -(-w // 8) * 8), np.bool_)
        self._words = self._hit.view(np.uint64)
        self._n_hits, self._label = np.empty(h, np.int64), np.zeros((h, w), np.int32)
        self._usual, self._spread = np.zeros((h, w), np.float32), np.full((h, w), 1e4, np.float32)
        self._least, self._most = np.full((h, w), -(2**15), np.int16), np.full((h, w), 2**15 - 1, np.int16)
        self._average, self._clutter = np.zeros(blocks, np.float32), np.full(blocks, 1e4, np.float32)
        self._block_mean = np.empty(blocks, np.float32)
        self._rest = np.zeros((-(-h // 2), -(-w // 2)), np.uint8)
        self._masked = None if mask is None else mask[: 2 * h : 2, : 2 * w : 2] == 0
        self._memory = refine.scratch()
        self._out = np.empty((settings.max_candidates, candidates.N_COLUMNS))
        self._learn_every = max(1, round(frame_rate_hz / settings.rate_hz))
        self._n_learned = self._n_seen = 0
        self._luma, self._stride = np.empty(0, np.uint8), 0
        self.unsettled = True
        self._steady = Steadiness()
        self._applied = np.zeros(2, np.int64)

    def look(self, luma: LumaArray) -> FloatArray:
        """The candidates (n, N_COLUMNS) of a picture (height, width)."""
        self._luma, self._stride = flat_memory(luma)
        sum_pairs(self._luma, self._stride, self._sums, self._means)
        self._follow_camera()
        self._respond()
        if self._n_learned == 0:
            self._begin()
        if self._masked is not None:
            self._hit[:, : self._masked.shape[1]][self._masked] = False
            self._n_hits[:] = self._hit.sum(axis=1)
        self._rest -= self._rest > 0
        flooded = self._n_hits.sum() > self._settings.max_hit_share * self._response.size
        self.unsettled = bool(flooded) or self._steady.lost
        if flooded:
            return self._out[:0].copy()
        blobs, pixels = group_hits(
            self._response,
            self._hit,
            self._words,
            self._n_hits,
            self._usual,
            self._spread,
            self._least,
            self._most,
            self._clutter,
            self._factors,
            self._rest,
            self._label,
        )
        n = candidates.measure_blobs(
            self._luma, self._stride, *self._size_px, blobs, pixels, self._rest, self._memory, self._out
        )
        return self._out[:n].copy()

    def seek(
        self, xy_px: FloatArray, radius_px: float, contrast: float, size_px: float, least_change: float
    ) -> FloatArray | None:
        """The candidate (N_COLUMNS,) within a radius that looks like something known, in the picture looked at last."""
        out = np.empty(candidates.N_COLUMNS)
        found = candidates.seek(
            self._luma,
            self._stride,
            *self._size_px,
            self._response,
            self._usual,
            self._spread,
            self._clutter,
            self._factors,
            float(xy_px[0]),
            float(xy_px[1]),
            float(radius_px),
            float(contrast),
            float(size_px),
            float(least_change),
            self._memory,
            out,
        )
        if not found or self._hidden(out[candidates.X], out[candidates.Y]):
            return None
        return out

    def learn(self, sure_px: FloatArray, unsure_px: FloatArray) -> None:
        """Take the picture looked at last as background, except within boxes (n, 4) x0, y0, x1, y1 of targets.

        Within the boxes of the unsure, pixels come to know the target in time, but do not take it for their own noise.
        """
        self._n_seen += 1
        if (self._n_seen - 1) % self._learn_every:
            return
        settings, n = self._settings, self._n_learned
        kept = []
        for boxes, maps in ((sure_px, (self._usual, self._spread)), (unsure_px, (self._spread,))):
            for x0, y0, x1, y1 in np.clip(boxes / 2, 0, max(self._size_px)).astype(int):
                place = (slice(y0, y1 + 2), slice(x0, x1 + 2))
                kept += [(values, place, values[place].copy()) for values in maps]
        narrow = settings.widen * settings.exceeded / (1 - settings.exceeded)
        learn_past(
            self._response,
            self._usual,
            self._spread,
            self._least,
            self._most,
            self._factors,
            n & 1,
            0.06 * UNITS_PER_LUMA,
            max(1 / settings.memory_frames, 2 / (n + 2)),
            settings.widen,
            narrow * max(1.0, 16 / (n + 1)),
        )
        for values, place, before in kept:
            values[place] = before
            self._limit(place)
        self._average += max(1 / 16, 1 / (n + 1)) * (self._block_mean - self._average)
        if n % _CLUTTER_EVERY == 0:
            quiet_neighbours(self._average, self._clutter)
        self._n_learned += 1

    @property
    def scene_shift_px(self) -> FloatArray:
        """How far the scenery (2,) has moved in the picture since the first one."""
        return 2 * self._steady.shift

    def _hidden(self, x: float, y: float) -> bool:
        """Whether a place in the picture is masked."""
        if self._masked is None:
            return False
        h, w = self._masked.shape
        return bool(self._masked[min(max(int(y / 2), 0), h - 1), min(max(int(x / 2), 0), w - 1)])

    def _follow_camera(self) -> None:
        """Move what is known of every pixel with the scenery; what comes into view is taken as it is."""
        shift = np.rint(self._steady.step(self._sums)).astype(np.int64) - self._applied
        if not shift.any():
            return
        self._applied += shift
        for values, unknown in ((self._usual, 0.0), (self._spread, 1e4)):
            _move(values, shift, unknown)
        self._limit()

    def _respond(self) -> None:
        open_and_close(self._means, self._scratch, self._opened, self._closed)
        mark_hits(
            self._sums,
            self._opened,
            self._closed,
            self._least,
            self._most,
            self._clutter,
            self._factors,
            self._response,
            self._hit,
            self._n_hits,
            self._block_mean,
        )

    def _begin(self) -> None:
        """Start from the first picture: each pixel varies as much as its surroundings do in space."""
        self._average[:] = self._block_mean
        quiet_neighbours(self._average, self._clutter)
        self._usual[:] = self._response
        h, w = self._response.shape
        self._spread[:] = 2 * np.repeat(np.repeat(self._block_mean, BLOCK, 0), BLOCK, 1)[:h, :w]
        self._limit()
        self._respond()

    def _limit(self, place: tuple[slice, slice] = (slice(None), slice(None))) -> None:
        set_limits(self._usual[place], self._spread[place], self._factors, self._least[place], self._most[place])


def _move(values: NDArray[np.float32], shift: NDArray[np.int64], unknown: float) -> None:
    """Move an array's content by whole columns and rows; what comes in from outside is `unknown`."""
    dx, dy = int(shift[0]), int(shift[1])
    h, w = values.shape
    moved = np.full_like(values, unknown)
    if abs(dx) < w and abs(dy) < h:
        moved[max(dy, 0) : h + min(dy, 0), max(dx, 0) : w + min(dx, 0)] = values[
            max(-dy, 0) : h + min(-dy, 0), max(-dx, 0) : w + min(-dx, 0)
        ]
    values[:] = moved


def flat_memory(luma: LumaArray) -> tuple[LumaArray, int]:
    """The memory (n,) of a picture whose rows are contiguous, and how many bytes a row begins after the last."""
    if luma.ndim != 2 or luma.dtype != np.uint8:
        raise ValueError(f"luma: expected (height, width) of uint8, got {luma.shape} of {luma.dtype}")
    if luma.strides[1] != 1 or luma.strides[0] < luma.shape[1]:
        luma = np.ascontiguousarray(luma)
    stride = luma.strides[0]
    flat = np.lib.stride_tricks.as_strided(luma, ((luma.shape[0] - 1) * stride + luma.shape[1],), (1,), writeable=False)
    return flat, stride
