"""Pictures of what was found: a contact sheet, and frames with the tracks drawn over them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from skytrace.vision.detect import LumaArray
from skytrace.vision.found import FoundTrack

BgrArray = NDArray[Any]  # of uint8

_TILE_WIDTH = 800
_COLUMNS = 2
_KEPT = 8  # pictures at least, twice as many at most
_INSET = 0.3  # of the tile's height
_TRAIL_S = 2.0
_TARGET_BGR = (60, 220, 60)
_OTHERS_BGR = ((255, 160, 40), (60, 200, 255), (220, 90, 220), (60, 120, 255), (220, 220, 60))
_FONT = cv2.FONT_HERSHEY_SIMPLEX


@dataclass(frozen=True, eq=False, slots=True)
class Sample:
    """A picture kept for the contact sheet."""

    frame: int
    time_s: float
    luma: LumaArray  # (height, width)


class Sampler:
    """Keeps evenly spaced pictures of a stream of unknown length."""

    def __init__(self) -> None:
        self._every = 1
        self._samples: list[Sample] = []

    def add(self, frame: int, time_s: float, luma: LumaArray) -> None:
        """Look at the next picture, and keep a copy where it falls on the grid."""
        if frame % self._every:
            return
        self._samples.append(Sample(frame, time_s, luma.copy()))
        if len(self._samples) >= 2 * _KEPT:
            self._every *= 2
            self._samples = [s for s in self._samples if s.frame % self._every == 0]

    def samples(self) -> tuple[Sample, ...]:
        """The kept pictures, an even share of them."""
        n = len(self._samples)
        chosen = np.unique(np.linspace(0, n - 1, min(n, _KEPT)).round().astype(int)) if n else []
        return tuple(self._samples[k] for k in chosen)


def contact_sheet(
    samples: Sequence[Sample], tracks: Sequence[FoundTrack], target: frozenset[int], title: str
) -> BgrArray:
    """A sheet of the samples: whole tracks as lines, detections of the moment as boxes, the target enlarged beside."""
    tiles = [_tile(sample, tracks, target) for sample in samples]
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % _COLUMNS)
    rows = [np.hstack(tiles[k : k + _COLUMNS]) for k in range(0, len(tiles), _COLUMNS)]
    head = np.full((40, rows[0].shape[1], 3), 30, np.uint8)
    cv2.putText(head, title, (10, 27), _FONT, 0.6, (235, 235, 235), 1, cv2.LINE_AA)
    return np.vstack([head, *rows])


class Overlay:
    """Draws the tracks over the pictures of a video, `width_px` wide."""

    def __init__(
        self, tracks: Sequence[FoundTrack], target: frozenset[int], size_px: tuple[int, int], rate_hz: float
    ) -> None:
        self._tracks, self._target = tracks, target
        self._trail = round(_TRAIL_S * rate_hz)
        scale = min(1.0, 1280 / size_px[0])
        self.size_px = (2 * round(0.5 * scale * size_px[0]), 2 * round(0.5 * scale * size_px[1]))
        self._scale = self.size_px[0] / size_px[0]

    def draw(self, luma: LumaArray, frame: int) -> tuple[BgrArray, BgrArray, BgrArray]:
        """Luma (h, w) and chroma planes (h/2, w/2) of a picture with the last seconds of every track."""
        small = cv2.resize(luma, self.size_px, interpolation=cv2.INTER_AREA)
        picture = cv2.cvtColor(small, cv2.COLOR_GRAY2BGR)
        for track in self._tracks:
            last = int(np.searchsorted(track.frame, frame, side="right"))
            first = int(np.searchsorted(track.frame, frame - self._trail))
            if last > first:
                _draw_line(picture, track, slice(first, last), self._scale, self._colour(track))
            if last and track.frame[last - 1] == frame:
                _draw_box(picture, track, last - 1, self._scale, self._colour(track))
        planes = cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_I420)
        w, h = self.size_px
        chroma = planes[h:].reshape(2, h // 2, w // 2)
        return planes[:h], chroma[0], chroma[1]

    def _colour(self, track: FoundTrack) -> tuple[int, int, int]:
        return colour_of(track, self._target)


def colour_of(track: FoundTrack, target: frozenset[int]) -> tuple[int, int, int]:
    """Green for the target, others by their number."""
    return _TARGET_BGR if track.track_id in target else _OTHERS_BGR[track.track_id % len(_OTHERS_BGR)]


def _tile(sample: Sample, tracks: Sequence[FoundTrack], target: frozenset[int]) -> BgrArray:
    height, width = sample.luma.shape
    scale = _TILE_WIDTH / width
    size = (_TILE_WIDTH, max(2, round(height * scale)))
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    tile = cv2.cvtColor(cv2.resize(sample.luma, size, interpolation=method), cv2.COLOR_GRAY2BGR)
    for track in tracks:
        _draw_line(tile, track, slice(None), scale, colour_of(track, target))
    for track in sorted(tracks, key=lambda t: t.track_id in target):
        k = int(np.searchsorted(track.frame, sample.frame))
        if k < len(track) and track.frame[k] == sample.frame:
            _draw_box(tile, track, k, scale, colour_of(track, target))
            if track.track_id in target:
                _draw_inset(tile, sample.luma, track, k)
    text, place = f"{sample.time_s:.2f} s, frame {sample.frame}", (8, size[1] - 10)
    for colour, width in (((0, 0, 0), 3), ((255, 255, 255), 1)):
        cv2.putText(tile, text, place, _FONT, 0.5, colour, width, cv2.LINE_AA)
    return tile


def _to_tile(xy_px: NDArray[np.float64], scale: float) -> NDArray[np.int32]:
    """Fixed-point positions with four fractional bits; the centre of the first pixel is (0, 0) in both pictures."""
    return np.round(16 * ((xy_px + 0.5) * scale - 0.5)).astype(np.int32)


def _draw_line(picture: BgrArray, track: FoundTrack, part: slice, scale: float, colour: tuple[int, int, int]) -> None:
    frame, points = track.frame[part], _to_tile(track.xy_px[part], scale)
    # Gaps stay open.
    for piece in np.split(points, np.flatnonzero(np.diff(frame) > 5) + 1):
        cv2.polylines(picture, [piece.reshape(-1, 1, 2)], False, colour, 1, cv2.LINE_AA, 4)


def _draw_box(picture: BgrArray, track: FoundTrack, k: int, scale: float, colour: tuple[int, int, int]) -> None:
    half = max(8.0, 1.5 * track.size_px * scale)
    x, y = _to_tile(track.xy_px[k], scale) / 16
    left, top = round(x - half), round(y - half)
    cv2.rectangle(picture, (left, top), (round(x + half), round(y + half)), colour, 1, cv2.LINE_AA)
    cv2.putText(picture, str(track.track_id), (left, top - 4), _FONT, 0.45, colour, 1, cv2.LINE_AA)


def _draw_inset(tile: BgrArray, luma: LumaArray, track: FoundTrack, k: int) -> None:
    """The target's surroundings, enlarged, with a cross beside its centre, in the corner farther from it."""
    side = int(_INSET * tile.shape[0])
    reach = int(max(12, round(3 * track.size_px)))
    x, y = track.xy_px[k]
    left, top = round(x) - reach, round(y) - reach
    padded = cv2.copyMakeBorder(luma, reach, reach, reach, reach, cv2.BORDER_REPLICATE)
    piece = padded[max(top + reach, 0) :, max(left + reach, 0) :][: 2 * reach + 1, : 2 * reach + 1]
    inset = cv2.cvtColor(cv2.resize(piece, (side, side), interpolation=cv2.INTER_NEAREST), cv2.COLOR_GRAY2BGR)
    scale = side / (2 * reach + 1)
    u, v = (x - left + 0.5) * scale, (y - top + 0.5) * scale
    for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        near, far = ((round(u + r * dx * side), round(v + r * dy * side)) for r in (0.12, 0.25))
        cv2.line(inset, near, far, _TARGET_BGR, 1, cv2.LINE_AA)
    cv2.rectangle(inset, (0, 0), (side - 1, side - 1), _TARGET_BGR, 1)
    where = slice(-side, None) if x < 0.5 * luma.shape[1] else slice(0, side)
    tile[:side, where] = inset
