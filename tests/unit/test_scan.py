"""The compiled loops over whole pictures against plain arrays."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.ndimage import rank_filter

from skytrace.vision.blobs import group_hits
from skytrace.vision.scan import BLOCK, UNITS_PER_LUMA, learn_past, mark_hits, quiet_neighbours, set_limits, sum_pairs
from skytrace.vision.window import HALF, WINDOW, open_and_close

SIZES = [(150, 77), (64, 96), (9, 11), (2, 3)]
FACTORS = np.array([3.0, 40.0, 7.0, 60.0])


def _luma(h: int, w: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (h, w)).astype(np.uint8)


def _sums_and_means(luma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    h, w = luma.shape[0] // 2, luma.shape[1] // 2
    sums, padded = np.empty((h, w), np.uint16), np.zeros((h + WINDOW, w + WINDOW), np.uint8)
    sum_pairs(luma.ravel(), luma.shape[1], sums, padded)
    return sums, padded


@pytest.mark.parametrize(("h", "w"), SIZES)
def test_opening_and_closing_are_those_of_opencv(h: int, w: int) -> None:
    sums, padded = _sums_and_means(_luma(2 * h, 2 * w, 1))
    means = ((sums + 2) >> 2).astype(np.uint8)
    np.testing.assert_array_equal(padded[HALF : HALF + h, HALF : HALF + w], means)
    scratch, opened, closed = (np.zeros_like(padded) for _ in range(3))
    open_and_close(padded, scratch, opened, closed)
    window = np.ones((WINDOW, WINDOW), np.uint8)
    np.testing.assert_array_equal(opened[:h, :w], cv2.dilate(cv2.erode(means, window), window))
    np.testing.assert_array_equal(closed[:h, :w], cv2.erode(cv2.dilate(means, window), window))


@pytest.mark.parametrize(("h", "w"), SIZES)
def test_pixels_are_marked_beyond_their_past_or_their_surroundings(h: int, w: int) -> None:
    rng = np.random.default_rng(2)
    sums, padded = _sums_and_means(_luma(2 * h, 2 * w, 3))
    scratch, opened, closed = (np.zeros_like(padded) for _ in range(3))
    open_and_close(padded, scratch, opened, closed)
    expected = UNITS_PER_LUMA // 2 * sums.astype(int) - UNITS_PER_LUMA * (opened[:h, :w].astype(int) + closed[:h, :w])
    usual = (expected + rng.normal(0, 300, (h, w))).astype(np.float32)
    spread = rng.uniform(1, 200, (h, w)).astype(np.float32)
    spread[0, 0], usual[0, 0] = 1e4, 0.0  # nothing is known yet
    clutter = rng.uniform(0, 400, (-(-h // BLOCK), -(-w // BLOCK))).astype(np.float32)
    least, most, response = np.empty((3, h, w), np.int16)
    set_limits(usual, spread, FACTORS, least, most)
    hit, n_hits, block_mean = np.zeros((h, -(-w // 8) * 8), bool), np.empty(h, np.int64), np.empty_like(clutter)
    mark_hits(sums, opened, closed, least, most, clutter, FACTORS, response, hit, n_hits, block_mean)
    np.testing.assert_array_equal(response, expected)
    near = np.repeat(np.repeat(7 * clutter + 60, BLOCK, 0), BLOCK, 1)[:h, :w]
    marked = (np.abs(expected - usual) > 3 * spread + 40) | (np.abs(expected) > near)
    np.testing.assert_array_equal(hit[:, :w], marked)
    assert not hit[:, w:].any()
    np.testing.assert_array_equal(n_hits, marked.sum(axis=1))
    assert block_mean[-1, -1] == pytest.approx(np.abs(expected)[h - 1 - (h - 1) % 8 :, w - 1 - (w - 1) % 8 :].mean())


def test_learning_keeps_the_limits_of_the_rows_it_moves() -> None:
    rng = np.random.default_rng(4)
    response = rng.integers(-8160, 8161, (7, 21)).astype(np.int16)
    usual, spread = np.zeros((7, 21), np.float32), np.full((7, 21), 50, np.float32)
    least, most = np.zeros((2, 7, 21), np.int16)
    learn_past(response, usual, spread, least, most, FACTORS, 1, 1.0, 0.25, 0.06, 0.003)
    assert not usual[::2].any()
    assert not most[::2].any()
    np.testing.assert_allclose(usual[1::2], 0.25 * response[1::2] + np.sign(response[1::2]), rtol=1e-5)
    expected = np.zeros((2, 7, 21), np.int16)
    set_limits(usual, spread, FACTORS, *expected)
    np.testing.assert_array_equal(least[1::2], expected[0, 1::2])
    np.testing.assert_array_equal(most[1::2], expected[1, 1::2])


@pytest.mark.parametrize(("h", "w"), [(9, 13), (1, 4), (5, 1)])
def test_clutter_is_the_third_quietest_of_nine_blocks(h: int, w: int) -> None:
    average = np.random.default_rng(5).uniform(0, 100, (h, w)).astype(np.float32)
    clutter = np.empty_like(average)
    quiet_neighbours(average, clutter)
    np.testing.assert_array_equal(clutter, rank_filter(average, 2, size=3, mode="nearest"))


def test_what_has_gone_is_forgotten_together_with_its_limits() -> None:
    h, w = 16, 20
    response, label = np.zeros((h, w), np.int16), np.zeros((h, w), np.int32)
    usual, spread = np.zeros((h, w), np.float32), np.full((h, w), 10, np.float32)
    usual[4, 17], response[12, 3] = 900.0, 900
    least, most = np.empty((2, h, w), np.int16)
    set_limits(usual, spread, FACTORS, least, most)
    hit = np.zeros((h, 24), bool)
    hit[:, :w] = (response < least) | (response > most)
    clutter = np.full((2, 3), 10, np.float32)
    rest = np.zeros((8, 10), np.uint8)
    marks = (hit, hit.view(np.uint64), hit.sum(axis=1))
    blobs, pixels = group_hits(response, *marks, usual, spread, least, most, clutter, FACTORS, rest, label)
    assert len(blobs) == 1
    assert pixels.tolist() == [[3, 12, 0]]
    assert usual[4, 17] == 0
    assert least[4, 17] <= 0 <= most[4, 17]
    assert not label.any()
