"""ChArUco boards: chessboards with markers in their white squares, which tell each corner apart.

Dictionary, number of columns and size of the markers are found out from some pictures of the board.
Markers and corners are OpenCV's (Garrido-Jurado et al., Automatic generation and detection of highly reliable fiducial
markers under occlusion, Pattern Recognition 2014).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from skytrace.geometry.arrays import FloatArray, IntArray
from skytrace.vision.board.chessboard import BoardCorners, refine, spacing

_FAMILIES = ("4X4", "5X5", "6X6", "7X7")
_SIZES = (50, 100, 250, 1000)
_OTHERS = ("DICT_ARUCO_ORIGINAL", "DICT_APRILTAG_36h11", "DICT_APRILTAG_25h9", "DICT_APRILTAG_16h5")
_FEWEST_MARKERS = 4
_FEWEST_CORNERS = 4
_THRESHOLD_WINDOW_PX = 23
_COLUMNS = range(3, 31)
_WORST_FIT = 0.15  # squares, between marker centres and where a homography puts them on the right board


@dataclass(frozen=True, eq=False, slots=True)
class Markers:
    """The markers seen in one picture."""

    ids: IntArray  # (n,)
    xy_px: FloatArray  # (n, 4, 2) corners, clockwise from the marker's own top left

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True, slots=True)
class CharucoBoard:
    """A board as its markers describe it."""

    dictionary: str  # OpenCV's name
    columns: int  # squares
    rows: int  # squares, as many as were seen
    white_first: bool  # whether the first square holds a marker
    marker_share: float  # side of a marker, in squares

    @property
    def size(self) -> tuple[int, int]:
        """Inner corners along the longer and the shorter side."""
        a, b = sorted((self.columns - 1, self.rows - 1), reverse=True)
        return a, b


def identify(pictures: Sequence[np.ndarray], squares: tuple[int, int] | None = None) -> CharucoBoard | None:
    """The ChArUco board that grey pictures show; None where they show none. `squares` are its sides, if known."""
    name, seen = "", []
    for candidate in _dictionaries():
        found = [find_markers(picture, candidate) for picture in pictures]
        found = [markers for markers in found if len(markers) >= _FEWEST_MARKERS]
        if sum(map(len, found)) > sum(map(len, seen)):
            name, seen = candidate, found
    if not seen:
        return None
    fits = []
    for columns in _COLUMNS if squares is None else squares:
        for white_first in (False, True):
            fits.append((*_fit(seen, columns, white_first), columns, white_first))
    error, share, columns, white_first = min(fits)
    if error > _WORST_FIT:
        return None
    last = max(int(m.ids.max()) for m in seen)
    rows = squares[squares[0] == columns] if squares else int(_cells(np.array([last]), columns, white_first)[0, 1]) + 1
    if white_first and rows % 2:
        rows += 1  # OpenCV knows such boards with an even number of rows only
    return CharucoBoard(_smallest(name, last), columns, rows, white_first, share)


def finder(board: CharucoBoard) -> Callable[[np.ndarray], BoardCorners | None]:
    """A function that finds the corners of a board in grey pictures."""
    pattern = cv2.aruco.CharucoBoard(
        (board.columns, board.rows), 1.0, board.marker_share, _dictionary(board.dictionary)
    )
    pattern.setLegacyPattern(board.white_first)
    detector = cv2.aruco.CharucoDetector(pattern)

    def find(grey: np.ndarray) -> BoardCorners | None:
        corners, ids, _, _ = detector.detectBoard(grey)
        if ids is None or len(ids) < _FEWEST_CORNERS:
            return None
        ids = np.asarray(ids).ravel().astype(np.int64)
        lattice = np.column_stack([ids % (board.columns - 1), ids // (board.columns - 1)])
        rough = np.asarray(corners, float).reshape(-1, 2)
        step = spacing({(i, j): k for k, (i, j) in enumerate(lattice.tolist())}, rough)
        # Markers begin so near to the corners; their edges must stay outside the window.
        xy_px = refine(grey, rough, step, window=0.4 * (1 - board.marker_share))
        known = None if board.columns == board.rows else board.columns > board.rows
        return BoardCorners(lattice, xy_px, known)

    return find


def find_markers(grey: np.ndarray, dictionary: str) -> Markers:
    """The plainly visible markers of a dictionary in a grey picture."""
    detector = cv2.aruco.ArucoDetector(_dictionary(dictionary), _quick())
    corners, ids, _ = detector.detectMarkers(grey)
    if ids is None or len(ids) == 0:
        return Markers(np.zeros(0, np.int64), np.zeros((0, 4, 2)))
    return Markers(np.asarray(ids).ravel().astype(np.int64), np.asarray(corners, float).reshape(-1, 4, 2))


def _dictionaries() -> Iterator[str]:
    yield from (f"DICT_{family}_{_SIZES[-1]}" for family in _FAMILIES)
    yield from (name for name in _OTHERS if hasattr(cv2.aruco, name))


def _quick() -> cv2.aruco.DetectorParameters:
    """One threshold instead of three: all dictionaries are tried, and most markers of a board show anyway."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.adaptiveThreshWinSizeMin = parameters.adaptiveThreshWinSizeMax = _THRESHOLD_WINDOW_PX
    return parameters


def _dictionary(name: str) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def _smallest(name: str, last_id: int) -> str:
    """The smallest dictionary of the same family that holds an id: fewer markers, fewer mistakes."""
    family = name.rpartition("_")[0]
    if not name.endswith(f"_{_SIZES[-1]}"):
        return name
    return f"{family}_{next(size for size in _SIZES if last_id < size)}"


def _cells(ids: IntArray, columns: int, white_first: bool) -> IntArray:
    """Column and row (n, 2) of the squares that hold the markers, numbered row by row."""
    # Two rows hold `columns` markers; the first of the two holds the odd one where the first square is white.
    pair, within = np.divmod(ids, columns)
    in_first = (columns + 1) // 2 if white_first else columns // 2
    second = within >= in_first
    column = 2 * (within - second * in_first) + (second == white_first)
    return np.column_stack([column, 2 * pair + second])


def _fit(seen: Sequence[Markers], columns: int, white_first: bool) -> tuple[float, float]:
    """How badly a number of columns explains where markers are, in squares, and the markers' side by it."""
    errors, shares = [], []
    for markers in seen:
        cells = _cells(markers.ids, columns, white_first) + 0.5
        homography, _ = cv2.findHomography(markers.xy_px.mean(axis=1), cells.astype(float), 0)
        if homography is None:
            return np.inf, 0.0
        on_board = cv2.perspectiveTransform(markers.xy_px.reshape(-1, 1, 2), homography).reshape(-1, 4, 2)
        errors.append(np.linalg.norm(on_board.mean(axis=1) - cells, axis=1))
        shares.append(np.linalg.norm(on_board - np.roll(on_board, 1, axis=1), axis=2).ravel())
    return float(np.median(np.concatenate(errors))), float(np.clip(np.median(np.concatenate(shares)), 0.1, 0.98))
