"""Compiled loops over whole pictures: reduction, what stands out, and what is usual at every pixel."""

from __future__ import annotations

import numpy as np
from numba import njit

from skytrace.vision.window import HALF, pad_edges

UNITS_PER_LUMA = 16  # responses are kept in sixteenths of a luma code
BLOCK = 8  # pixels along a side of a clutter block
_INT16_MAX = 32767


@njit(cache=True, error_model="numpy", fastmath=True)
def sum_pairs(luma, stride, sums, padded):
    """Fill sums (h, w) with the 2x2 sums of a picture given as its flat memory, and `padded` with their means."""
    h, w = sums.shape
    for y in range(h):
        first = 2 * y * stride
        above, below = luma[first : first + 2 * w], luma[first + stride : first + stride + 2 * w]
        row, mean = sums[y], padded[y + HALF, HALF : w + HALF]
        for x in range(w):
            total = np.uint16(above[2 * x] + above[2 * x + 1] + below[2 * x] + below[2 * x + 1])
            row[x] = total
            mean[x] = np.uint8((total + 2) >> 2)
    pad_edges(padded)


@njit(cache=True, error_model="numpy", fastmath=True)
def mark_hits(sums, opened, closed, least, most, clutter, factors, response, hit, n_hits, block_mean):
    """Respond to what is smaller than the window of the opening; mark what differs from its past or its surroundings.

    The response is 2 sums - opened - closed in units; opened and closed (h, w or more) are those of the means. least
    and most (h, w) bound what is usual at a pixel, see `set_limits`; clutter (h / BLOCK, w / BLOCK) is what responses
    amount to around a block. factors = (spread factor, spread floor, clutter factor, clutter floor). Fills response
    (h, w), hit (h, w or more), n_hits (h,) per row and block_mean, the means of the absolute responses.
    """
    h, w = response.shape
    near_factor, near_floor = np.float32(factors[2]), np.float32(factors[3])
    gain, unit = np.int16(UNITS_PER_LUMA // 2), np.int16(UNITS_PER_LUMA)
    limit, total = np.empty(w, np.int16), np.zeros(w, np.uint16)
    for y in range(h):
        if y % BLOCK == 0:
            for b in range(clutter.shape[1]):
                near = near_factor * clutter[y // BLOCK, b] + near_floor
                limit[b * BLOCK : (b + 1) * BLOCK] = np.int16(min(near, np.float32(_INT16_MAX)))
            total[:] = 0
        low, high = opened[y], closed[y]
        centre, out, mark, lower, upper = sums[y], response[y], hit[y], least[y], most[y]
        found = np.uint8(0)
        for x in range(w):
            value = np.int16(gain * np.int16(centre[x]) - unit * np.int16(low[x] + high[x]))
            out[x] = value
            size = np.int16(abs(value))
            stands_out = np.uint8((value < lower[x]) | (value > upper[x]) | (size > limit[x]))
            mark[x] = stands_out
            found |= stands_out
            total[x] = np.uint16(total[x] + size)
        n_hits[y] = mark[:w].sum() if found else 0
        if y % BLOCK == BLOCK - 1 or y == h - 1:
            rows = y % BLOCK + 1
            for b in range(clutter.shape[1]):
                first, last = b * BLOCK, min((b + 1) * BLOCK, w)
                block_mean[y // BLOCK, b] = total[first:last].sum() / np.float32((last - first) * rows)


@njit(cache=True, error_model="numpy", fastmath=True)
def _limits(middle, wide, factor, floor):
    """The whole numbers between which a response is usual, for a median and a spread."""
    reach, end = factor * wide + floor, np.float32(_INT16_MAX)
    return np.int16(np.ceil(max(middle - reach, -end))), np.int16(np.floor(min(middle + reach, end)))


@njit(cache=True, error_model="numpy", fastmath=True)
def set_limits(usual, spread, factors, least, most):
    """Fill least and most (h, w), the whole numbers between which a response is usual."""
    factor, floor = np.float32(factors[0]), np.float32(factors[1])
    for y in range(len(usual)):
        middle, wide, lower, upper = usual[y], spread[y], least[y], most[y]
        for x in range(len(middle)):
            lower[x], upper[x] = _limits(middle[x], wide[x], factor, floor)


@njit(cache=True, error_model="numpy", fastmath=True)
def learn_past(response, usual, spread, least, most, factors, first_row, step, pull, widen, narrow):
    """Move every second row's median, spread and limits towards the response.

    The median moves by one step towards the response, and by the share `pull` of its difference. The spread grows by
    the share `widen` where it was exceeded and shrinks by `narrow` elsewhere, so that it comes to rest where the
    change exceeds it in a share narrow / (narrow + widen) of the frames, however often and far it does.
    """
    h, w = response.shape
    step, pull = np.float32(step), np.float32(pull)
    widen, narrow = np.float32(widen), np.float32(narrow)
    factor, floor = np.float32(factors[0]), np.float32(factors[1])
    base = np.float32(0.5 * UNITS_PER_LUMA)
    for y in range(first_row, h, 2):
        values, middle, wide, lower, upper = response[y], usual[y], spread[y], least[y], most[y]
        for x in range(w):
            change = np.float32(values[x]) - middle[x]
            median = middle[x] + pull * change + (step if change > 0 else -step)
            # A spread of nothing could never grow: both rates refer to at least half a luma code.
            rate = widen if abs(change) > wide[x] else -narrow
            around = max(wide[x] + rate * max(wide[x], base), np.float32(1.0))
            middle[x], wide[x] = median, around
            lower[x], upper[x] = _limits(median, around, factor, floor)


@njit(cache=True, error_model="numpy", fastmath=True)
def quiet_neighbours(average, clutter):
    """Set every block's clutter to that of its quiet neighbours: the third quietest of nine says how loud it is there.

    Beside trees and roofs the sky is quiet on one side: there, too, something small stands out against the sky.
    """
    rows, columns = average.shape
    # Of each block, the one above and the one below in order; the outermost columns twice.
    ordered = np.empty((3, columns + 2), np.float32)
    first, second, third = ordered[0], ordered[1], ordered[2]
    for y in range(rows):
        above, centre, below = average[max(y - 1, 0)], average[y], average[min(y + 1, rows - 1)]
        for x in range(columns):
            a, b = min(above[x], below[x]), max(above[x], below[x])
            first[x + 1], third[x + 1] = min(a, centre[x]), max(b, centre[x])
            second[x + 1] = max(a, min(b, centre[x]))
        ordered[:, 0], ordered[:, columns + 1] = ordered[:, 1], ordered[:, columns]
        out = clutter[y]
        for x in range(columns):
            a, b, c = first[x], first[x + 1], first[x + 2]
            d, e, f = second[x], second[x + 1], second[x + 2]
            # Three blocks are at least as quiet as the largest of k of one column, m of the next, n of the third,
            # in order, where k + m + n = 3.
            alone = min(min(third[x], third[x + 1]), third[x + 2])
            one = min(max(d, min(b, c)), max(e, min(a, c)))
            out[x] = min(min(alone, one), min(max(f, min(a, b)), max(max(a, b), c)))
