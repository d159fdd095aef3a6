"""The corners of a chessboard in a picture, wherever they can be seen, to a small part of a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from skytrace.geometry.arrays import FloatArray, IntArray
from skytrace.vision.board.lattice import Node, largest_lattice
from skytrace.vision.board.saddles import find_saddles

_WORKING_PX = 1280  # longest side of the picture that lattices are grown in
_FINE_PX = 2560  # of the one tried where nothing is found
_BLURS_PX = (2.0, 3.0, 5.0)  # small squares want little, motion blur much
_WINDOW = 0.2  # of the distance to the next corner, half the width of the window a corner is refined in
_WINDOW_PX = (2, 24)
_REFINING_BLUR = 1 / 1920  # of the picture's longer side: what a sensor's noise needs, and little to a corner


@dataclass(frozen=True, eq=False, slots=True)
class BoardCorners:
    """Inner corners of a board: where they lie on it, in squares from an arbitrary one, and in the picture."""

    lattice: IntArray  # (n, 2) column and row
    xy_px: FloatArray  # (n, 2)
    long_first: bool | None = None  # whether columns run along the board's longer side; None where that is not known

    def __len__(self) -> int:
        return len(self.lattice)

    @property
    def extent(self) -> tuple[int, int]:
        """Corners along the longer and the shorter side, where all between the outermost are seen."""
        if len(self) == 0:
            return 0, 0
        a, b = sorted((np.ptp(self.lattice, axis=0) + 1).tolist(), reverse=True)
        return a, b


def find_chessboard(grey: np.ndarray) -> BoardCorners | None:
    """The chessboard that fills most of a grey picture (h, w) uint8; None where there is no three by three corners."""
    best, largest = None, 0.0
    for longest_px, blurs in ((_WORKING_PX, _BLURS_PX), (_FINE_PX, _BLURS_PX[:1])):
        scale = min(1.0, longest_px / max(grey.shape))
        small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else grey
        for blur in blurs:
            blurred = np.asarray(cv2.GaussianBlur(small.astype(np.float32), (0, 0), blur), np.float32)
            saddles = find_saddles(blurred, blur)
            nodes, area = largest_lattice(blurred, saddles)
            if area > largest * scale**2:
                # The centre of pixel 0 of the small picture is not that of pixel 0 of the large one.
                rough = (saddles.xy_px[list(nodes.values())] + 0.5) / scale - 0.5
                best, largest = (nodes, rough), area / scale**2
        if best is not None or scale == 1.0:
            break
    if best is None:
        return None
    nodes, rough = best
    lattice = np.array(list(nodes))
    return BoardCorners(lattice, refine(grey, rough, spacing(nodes, rough)))


def spacing(nodes: dict[Node, int], xy_px: FloatArray) -> FloatArray:
    """Distance (n,) of each corner to its nearest neighbour on the lattice."""
    place = {node: k for k, node in enumerate(nodes)}
    nearest = np.full(len(nodes), np.inf)
    for (i, j), k in place.items():
        for neighbour in ((i + 1, j), (i, j + 1)):
            other = place.get(neighbour)
            if other is not None:
                d = float(np.linalg.norm(xy_px[k] - xy_px[other]))
                nearest[k], nearest[other] = min(nearest[k], d), min(nearest[other], d)
    known = nearest[np.isfinite(nearest)]
    return np.where(np.isfinite(nearest), nearest, np.median(known) if len(known) else 10.0)


def refine(grey: np.ndarray, rough_px: FloatArray, spacing_px: FloatArray, *, window: float = _WINDOW) -> FloatArray:
    """Corners (n, 2) where the picture's gradients point past them (Foerstner), each in a window of its own size.

    Half of a window's side is `window` of the distance to the next corner.
    """
    out = np.empty_like(rough_px)
    grey = cv2.GaussianBlur(grey, (0, 0), max(_REFINING_BLUR * max(grey.shape), 0.3))
    for k, (place, step) in enumerate(zip(rough_px, spacing_px, strict=True)):
        half = int(np.clip(round(window * step), *_WINDOW_PX))
        start = place.astype(np.float32).reshape(1, 1, 2)
        criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-3)
        out[k] = cv2.cornerSubPix(grey, start, (half, half), (-1, -1), criteria).reshape(2)
    return out
