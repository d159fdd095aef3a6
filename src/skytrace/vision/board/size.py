"""How large a chessboard is, from all its views, and what lies beyond it in some of them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from skytrace.vision.board.chessboard import BoardCorners

_SHARE = 0.2  # of the views of the size seen most often


def common_size(boards: Sequence[BoardCorners]) -> tuple[int, int] | None:
    """Inner corners along the longer and the shorter side of the largest board that was seen in whole repeatedly.

    None where no two views agree on one. A board that leaves the picture looks smaller, often along a whole line; one
    whose outer edge was taken for more corners has that line in part, or once in a while.
    """
    whole = Counter(b.extent for b in boards if len(b) == b.extent[0] * b.extent[1])
    if not whole:
        return None
    enough = max(2, math.ceil(_SHARE * max(whole.values())))
    repeated = [size for size, views in whole.items() if views >= enough]
    return max(repeated, key=lambda size: (size[0] * size[1], size), default=None)


def trimmed(board: BoardCorners, size: tuple[int, int]) -> BoardCorners:
    """The board without its emptiest outer lines, so that it is no larger than `size` (longer, shorter)."""
    while True:
        extent = np.ptp(board.lattice, axis=0) + 1 if len(board) else np.zeros(2, int)
        longer = int(np.argmax(extent))
        allowed = {longer: size[0], 1 - longer: size[1]}
        outer = [
            (axis, end)
            for axis in (0, 1)
            if extent[axis] > allowed[axis]
            for end in (board.lattice[:, axis].min(), board.lattice[:, axis].max())
        ]
        if not outer:
            return board
        axis, end = min(outer, key=lambda line: int((board.lattice[:, line[0]] == line[1]).sum()))
        kept = board.lattice[:, axis] != end
        board = replace(board, lattice=board.lattice[kept], xy_px=board.xy_px[kept])
