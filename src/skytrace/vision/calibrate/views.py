"""From boards found in pictures to the views a calibration works on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skytrace.vision.board.chessboard import BoardCorners
from skytrace.vision.board.size import common_size, trimmed
from skytrace.vision.calibrate.fit import FEWEST_CORNERS
from skytrace.vision.calibrate.problem import View


def as_views(
    boards: Sequence[tuple[str, BoardCorners]], size: tuple[int, int] | None = None
) -> tuple[list[View], tuple[int, int] | None]:
    """Views of named boards, none larger than the board is, and its size (inner corners, longer side first).

    Boards of which too little is seen to say where they are give no view.

    The size is found out from the boards where it is not given, and None where they do not tell.
    """
    size = common_size([board for _, board in boards]) if size is None else size
    views = []
    for name, board in boards:
        board = trimmed(board, size) if size else board
        if len(board) >= FEWEST_CORNERS and np.linalg.matrix_rank(board.lattice - board.lattice.mean(axis=0)) == 2:
            views.append(View(name, board.lattice, board.xy_px, _long_first(board, size)))
    return views, size


def _long_first(board: BoardCorners, size: tuple[int, int] | None) -> bool | None:
    """Whether the first axis runs along the board's longer side: only there can more than the shorter one be seen."""
    if board.long_first is not None or size is None or size[0] == size[1]:
        return board.long_first
    extent = np.ptp(board.lattice, axis=0) + 1
    if extent[0] > size[1]:
        return True
    return False if extent[1] > size[1] else None
