"""Boards in pictures and videos: each picture looked at once, videos through their sharpest pictures."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path

import numpy as np

from skytrace.errors import InputError
from skytrace.io.pictures import is_picture, read_grey
from skytrace.io.video import VideoWarning, open_video, read_frames
from skytrace.vision.board import charuco
from skytrace.vision.board.chessboard import BoardCorners, find_chessboard
from skytrace.vision.board.sharpness import sharpness

_PROBED = 4  # pictures in which markers are looked for
_LONGEST_PROBED_PX = 1280
_LEAST_WINDOW_S, _MOST_WINDOWS = 0.2, 240  # a video's pictures: the sharpest of each window

Picture = tuple[str, np.ndarray]
Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False, slots=True)
class FoundBoards:
    """What pictures show."""

    names: tuple[str, ...]  # of all pictures looked at
    boards: tuple[BoardCorners | None, ...]  # as many
    size_px: tuple[int, int]
    markers: charuco.CharucoBoard | None  # the board's kind where it has markers
    frame_rate_hz: float | None  # where all come from videos of one rate
    warnings: tuple[str, ...]

    @property
    def seen(self) -> list[tuple[str, BoardCorners]]:
        """The pictures that show a board."""
        return [(n, b) for n, b in zip(self.names, self.boards, strict=True) if b is not None and len(b)]


def find_boards(files: Sequence[Path], squares: tuple[int, int] | None, on_progress: Progress) -> FoundBoards:
    """Look for one board in all pictures and videos named.

    `squares` are the board's sides where known. Raises InputError for files that cannot be read or do
    not belong to one lens.
    """
    warnings: list[str] = []
    source = _Source(files, warnings)
    pictures = source.pictures()
    probed = list(islice(pictures, _PROBED)) if source.has_video else []
    seen = [grey for _, grey in probed] or [read_grey(f) for f in _evenly(files, _PROBED)]
    markers = charuco.identify([_smaller(grey) for grey in seen], squares)
    find = find_chessboard if markers is None else charuco.finder(markers)
    names, boards = [], []
    for name, grey in chain(probed, pictures):
        names.append(name)
        boards.append(find(grey))
        on_progress(len(names), max(source.expected, len(names)))
    assert source.size_px is not None
    rates = {rate for rate in source.rates if rate is not None}
    rate_hz = rates.pop() if len(rates) == 1 and source.only_videos else None
    return FoundBoards(tuple(names), tuple(boards), source.size_px, markers, rate_hz, tuple(warnings))


class _Source:
    """Pictures, one after the other, all of one size."""

    def __init__(self, files: Sequence[Path], warnings: list[str]) -> None:
        self._files, self._warnings = files, warnings
        self._infos = {path: open_video(path) for path in files if not is_picture(path)}
        self.rates = [info.nominal_rate_hz for info in self._infos.values()]
        self.size_px: tuple[int, int] | None = None
        self._first = ""

    @property
    def has_video(self) -> bool:
        return bool(self._infos)

    @property
    def only_videos(self) -> bool:
        return len(self._infos) == len(self._files)

    @property
    def expected(self) -> int:
        """About how many pictures there will be."""
        stills = len(self._files) - len(self._infos)
        return stills + sum(
            math.ceil((info.duration_s or 0.0) / _window_s(info.duration_s)) for info in self._infos.values()
        )

    def pictures(self) -> Iterator[Picture]:
        for path in self._files:
            for name, grey in self._of(path):
                self._check(path, grey)
                yield name, grey

    def _of(self, path: Path) -> Iterator[Picture]:
        if path not in self._infos:
            yield path.name, read_grey(path)
            return

        def tell(warning: VideoWarning) -> None:
            self._warnings.append(str(warning))

        window_s, window = _window_s(self._infos[path].duration_s), None
        best: tuple[float, Picture] | None = None
        for frame in read_frames(path, on_warning=tell):
            now = math.floor(frame.time_s / window_s)
            if best is not None and now != window:
                yield best[1]
                best = None
            window, value = now, sharpness(frame.luma)
            if best is None or value > best[0]:
                best = (value, (f"{path.name} frame {frame.index}", np.array(frame.luma)))
        if best is not None:
            yield best[1]

    def _check(self, path: Path, grey: np.ndarray) -> None:
        size = (grey.shape[1], grey.shape[0])
        if self.size_px is None:
            self.size_px, self._first = size, path.name
        elif size != self.size_px:
            raise InputError(
                path,
                f"is {size[0]} x {size[1]} px, {self._first} is {self.size_px[0]} x {self.size_px[1]}: pictures for "
                "one calibration are of one size, from one camera in one mode",
            )


def _window_s(duration_s: float | None) -> float:
    return max(_LEAST_WINDOW_S, (duration_s or 0.0) / _MOST_WINDOWS)


def _evenly(files: Sequence[Path], n: int) -> list[Path]:
    return [files[k] for k in np.unique(np.linspace(0, len(files) - 1, n).round().astype(int))]


def _smaller(grey: np.ndarray) -> np.ndarray:
    import cv2

    scale = _LONGEST_PROBED_PX / max(grey.shape)
    return grey if scale >= 1 else cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
