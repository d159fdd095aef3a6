"""Compiled opening and closing of a picture by a square window."""

from __future__ import annotations

import numpy as np
from numba import njit

WINDOW = 16  # pixels along a side
HALF = WINDOW // 2  # what a padded picture (h + WINDOW, w + WINDOW) has on each side
_BAND = 64  # rows worked on at once stay in the processor's cache


@njit(cache=True, error_model="numpy", fastmath=True)
def _least(values, step, out):
    """Fill out (n,) with the least of four values that are `step` apart."""
    n = len(out)
    a, b, c, d = values[:n], values[step : step + n], values[2 * step : 2 * step + n], values[3 * step : 3 * step + n]
    for i in range(n):
        out[i] = min(min(a[i], b[i]), min(c[i], d[i]))


@njit(cache=True, error_model="numpy", fastmath=True)
def _largest(values, step, out):
    """Fill out (n,) with the largest of four values that are `step` apart."""
    n = len(out)
    a, b, c, d = values[:n], values[step : step + n], values[2 * step : 2 * step + n], values[3 * step : 3 * step + n]
    for i in range(n):
        out[i] = max(max(a[i], b[i]), max(c[i], d[i]))


@njit(cache=True, error_model="numpy")
def _slide(padded, largest, out, shift):
    """The least or the largest value in the window around every pixel, put `shift` rows and columns into out.

    Four of four make sixteen, first down and then across. A row's end runs on into the next row's beginning, in
    columns that nobody reads.
    """
    stride = padded.shape[1]
    h, w = padded.shape[0] - WINDOW, stride - WINDOW
    one, other = np.empty((_BAND + WINDOW) * stride, np.uint8), np.empty((_BAND + WINDOW) * stride, np.uint8)
    values, filled = padded.ravel(), out.ravel()[shift * (stride + 1) :]
    for y in range(0, h, _BAND):
        first, n = y * stride, (min(_BAND, h - y) - 1) * stride + w
        quarter, column, part = one[: n + 15 + 12 * stride], other[: n + 15], one[: n + 12]
        if largest:
            _largest(values[first:], stride, quarter)
            _largest(quarter, 4 * stride, column)
            _largest(column, 1, part)
            _largest(part, 4, filled[first : first + n])
        else:
            _least(values[first:], stride, quarter)
            _least(quarter, 4 * stride, column)
            _least(column, 1, part)
            _least(part, 4, filled[first : first + n])


@njit(cache=True, error_model="numpy")
def pad_edges(padded):
    """Repeat a picture's outermost pixels around it: this changes no least or largest value of a window."""
    h, w = padded.shape[0] - WINDOW, padded.shape[1] - WINDOW
    for y in range(HALF, h + HALF):
        row = padded[y]
        row[:HALF], row[w + HALF :] = row[HALF], row[w + HALF - 1]
    for y in range(HALF):
        padded[y], padded[h + HALF + y] = padded[HALF], padded[h + HALF - 1]


@njit(cache=True, error_model="numpy")
def open_and_close(padded, scratch, opened, closed):
    """Fill opened and closed with those of a picture (h, w), which is padded; all have the padded size.

    Both results begin at the first row and column. Both of their steps look HALF before a pixel and HALF - 1 behind,
    so that they lie one pixel to the right of and below the true ones; sharp edges then stand out more than soft ones.
    """
    _slide(padded, False, scratch, HALF)
    pad_edges(scratch)
    _slide(scratch, True, opened, 0)
    _slide(padded, True, scratch, HALF)
    pad_edges(scratch)
    _slide(scratch, False, closed, 0)
