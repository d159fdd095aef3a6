"""Corners of boards in rendered pictures: where they are, how many are found, and how precisely."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from board_scene import FISHEYE, PINHOLE, Board, exact_corners, half_size, render, shots

from skytrace.vision.board import charuco
from skytrace.vision.board.chessboard import BoardCorners, find_chessboard
from skytrace.vision.board.lattice import prune
from skytrace.vision.board.saddles import find_saddles
from skytrace.vision.board.size import common_size, trimmed

LENSES = [half_size(PINHOLE), half_size(FISHEYE)]


def on_the_true_board(found: BoardCorners, exact: np.ndarray, board: Board) -> tuple[np.ndarray, np.ndarray]:
    """Distances (n,) of found corners to the nearest true ones, and the lattice (n, 2) of those."""
    distance = np.linalg.norm(found.xy_px[:, None] - exact[None], axis=2)
    distance = np.where(np.isfinite(distance), distance, np.inf)
    return distance.min(axis=1), board.lattice[distance.argmin(axis=1)]


@pytest.mark.parametrize("lens", LENSES, ids=["pinhole", "fisheye"])
def test_corners_of_whole_and_cut_off_boards(lens):
    rng, board = np.random.default_rng(3), Board()
    for shot in shots(lens, 3, rng, turn_rad=0.005, reach=1.2):
        exact = exact_corners(lens, board, shot)
        visible = int(np.isfinite(exact[:, 0]).sum())
        found = find_chessboard(render(lens, board, shot, rng, over=2))
        assert found is not None
        assert len(found) >= 0.85 * visible
        distance, true = on_the_true_board(found, exact, board)
        assert np.median(distance) < 0.15
        assert distance.max() < 1.0
        # The lattice found is the true one, but for where it begins and how it is turned.
        centred = [(lattice - lattice.mean(axis=0)).astype(float) for lattice in (found.lattice, true)]
        turn = np.rint(np.linalg.lstsq(centred[0], centred[1], rcond=None)[0])
        assert abs(np.linalg.det(turn)) == 1
        np.testing.assert_allclose(centred[0] @ turn, centred[1], atol=1e-9)


def test_saddles_are_found_where_squares_meet():
    """A picture of four squares, blurred: one crossing, its edges along the axes, bright towards the diagonal."""
    picture = np.full((60, 80), 40.0, np.float32)
    picture[:30, :41] = picture[30:, 41:] = 210
    blurred = cv2.GaussianBlur(picture, (0, 0), 2.0)
    saddles = find_saddles(blurred, 2.0)
    assert len(saddles) == 1
    np.testing.assert_allclose(saddles.xy_px[0], [40.5, 29.5], atol=0.05)
    assert np.abs(saddles.edges[0]).max(axis=1) == pytest.approx([1, 1], abs=1e-2)
    assert np.abs(saddles.bright[0]) == pytest.approx([np.sqrt(0.5)] * 2, abs=1e-2)


def test_nothing_is_found_where_there_is_no_board(rng):
    assert find_chessboard(np.full((240, 320), 128, np.uint8)) is None
    assert find_chessboard(rng.integers(0, 255, (240, 320)).astype(np.uint8)) is None
    ramp = np.tile(np.linspace(0, 255, 320), (240, 1)).astype(np.uint8)
    assert find_chessboard(ramp) is None


def test_lines_with_fewer_than_three_corners_are_dropped():
    grid = {(i, j): 10 * i + j for i in range(4) for j in range(3)}
    assert prune({**grid, (4, 0): 99, (4, 1): 98}) == grid
    assert prune({(0, 0): 1, (1, 0): 2, (0, 1): 3, (1, 1): 4}) == {}


def board_of(columns, rows, missing=()):
    lattice = np.array([(i, j) for i in range(columns) for j in range(rows) if (i, j) not in missing])
    return BoardCorners(lattice, 50.0 * lattice)


def test_the_size_is_the_largest_seen_in_whole_repeatedly():
    boards = [board_of(7, 6), board_of(6, 7), board_of(7, 6, missing=[(3, 3)]), board_of(5, 5), board_of(7, 7)]
    assert common_size(boards) == (7, 6)
    assert common_size([*boards, *3 * [board_of(6, 5)]]) == (7, 6)  # those that leave the picture
    assert common_size([*10 * [board_of(7, 6)], board_of(7, 7)]) == (7, 6)
    assert common_size([board_of(7, 6), board_of(5, 4)]) is None
    assert common_size([]) is None


def test_a_false_outer_line_is_trimmed():
    too_wide = board_of(8, 6, missing=[(7, 0), (7, 1), (7, 2)])
    kept = trimmed(too_wide, (7, 6))
    assert kept.extent == (7, 6)
    assert kept.lattice[:, 0].max() == 6
    assert len(trimmed(board_of(6, 7), (7, 6))) == 42


@pytest.fixture(scope="module")
def marked():
    """Pictures of a ChArUco board of 8 x 7 squares, some of it out of view, and the true corners."""
    rng, board, lens = np.random.default_rng(1), Board(), LENSES[0]
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    pattern = cv2.aruco.CharucoBoard((8, 7), 1.0, 0.7, dictionary).generateImage((480, 420), marginSize=0)
    taken = shots(lens, 3, rng)
    pictures = [render(lens, board, shot, rng, over=2, pattern=pattern) for shot in taken]
    return pictures, [exact_corners(lens, board, shot).reshape(7, 6, 2) for shot in taken]


def test_a_charuco_board_is_known_by_its_markers(marked):
    pictures, exact = marked
    board = charuco.identify(pictures)
    assert board is not None
    assert (board.dictionary, board.columns, board.rows, board.white_first) == ("DICT_4X4_50", 8, 7, False)
    assert board.marker_share == pytest.approx(0.7, abs=0.05)
    assert charuco.identify(pictures, (7, 8)) == board
    find = charuco.finder(board)
    for picture, true in zip(pictures, exact, strict=True):
        found = find(picture)
        assert found is not None
        assert found.long_first is True
        assert len(found) >= 20
        error = np.linalg.norm(found.xy_px - true[found.lattice[:, 0], found.lattice[:, 1]], axis=1)
        assert np.median(error) < 0.3
    assert find(np.full((240, 320), 128, np.uint8)) is None


def test_a_plain_chessboard_is_no_charuco_board(rng):
    lens, board = LENSES[0], Board()
    assert charuco.identify([render(lens, board, shots(lens, 1, rng)[0], rng, over=2)]) is None
