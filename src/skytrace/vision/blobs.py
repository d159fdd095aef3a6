"""Compiled grouping of pixels that stand out into blobs."""

from __future__ import annotations

import numpy as np
from numba import njit

from skytrace.vision.scan import BLOCK, set_limits

_GONE = 0.5  # times the limit of what stands out; less means that nothing is left
REACH = 2  # pixels of one sign this close belong to one blob

# Columns of a blob, in pixels of its level.
LEFT, TOP, RIGHT, BOTTOM = 0, 1, 2, 3  # inclusive
PEAK, PEAK_X, PEAK_Y, SIGN = 4, 5, 6, 7  # the response farthest from zero or from the usual one, in units
CHANGE, CHANGED, CHANGED_X, CHANGED_Y = 8, 9, 10, 11  # change over its limit; pixels beyond it and their centre
STANDING, STOOD, N_PIXELS = 12, 13, 14  # response over the limit of the surroundings; pixels beyond it; all pixels
NOVELTY = 15  # share of the responses that is new
N_COLUMNS = 16


@njit(cache=True)
def _root(parent, k):
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@njit(cache=True, error_model="numpy")
def _marked(response, hit, words, n_hits, least, most, rest, xs, ys):
    """Fill xs and ys with the places of the marked pixels that count, and return how many they are.

    Most words of eight pixels hold none, and most of the others are those of roofs and trees at rest.
    """
    k = 0
    for y in range(len(n_hits)):
        if n_hits[y] == 0:
            continue
        for word in range(words.shape[1]):
            if words[y, word] == 0:
                continue
            for x in range(8 * word, 8 * word + 8):
                if hit[y, x] and (rest[y >> 1, x >> 1] == 0 or not least[y, x] <= response[y, x] <= most[y, x]):
                    xs[k], ys[k] = x, y
                    k += 1
    return k


@njit(cache=True, error_model="numpy")
def group_hits(response, hit, words, n_hits, usual, spread, least, most, clutter, factors, rest, label):
    """Blobs (n, N_COLUMNS) of the marked pixels, and these (m, 3) as x, y, blob.

    `words` (h, W / 8) uint64 is the same memory as hit (h, W), in which nothing is marked beyond the picture. Pixels
    that only stand out of their surroundings do not count where `rest` (uint8, a cell for 2x2 pixels) is not zero.
    Where something used to stand out and has gone, nothing is marked and `usual` is set right at once, with its limits
    least and most: what was there from the first picture on leaves no ghost behind. `label` (h, w) int32 is scratch
    memory of zeros and is returned to zeros.
    """
    w = response.shape[1]
    count = n_hits.sum()
    xs, ys = np.empty(count, np.int32), np.empty(count, np.int32)
    count = _marked(response, hit, words, n_hits, least, most, rest, xs, ys)
    change, standing = np.empty(count, np.float32), np.empty(count, np.float32)
    size, sign = np.empty(count, np.float32), np.empty(count, np.int8)
    parent = np.arange(count)
    k = 0
    for i in range(count):
        x, y = xs[i], ys[i]
        value = np.float32(response[y, x])
        moved = value - usual[y, x]
        change[k] = abs(moved) / (factors[0] * spread[y, x] + factors[1])
        near = factors[2] * clutter[y // BLOCK, x // BLOCK] + factors[3]
        standing[k] = abs(value) / near
        if change[k] > 1 and standing[k] < _GONE and abs(usual[y, x]) > near:
            usual[y, x] = value
            place = (slice(y, y + 1), slice(x, x + 1))
            set_limits(usual[place], spread[place], factors, least[place], most[place])
            continue
        xs[k], ys[k] = x, y
        size[k] = max(abs(value), abs(moved)) if change[k] > 1 else abs(value)
        sign[k] = (1 if value > 0 else -1) if standing[k] > 1 else (1 if moved > 0 else -1)
        label[y, x] = k + 1
        for v in range(max(y - REACH, 0), y + 1):
            for u in range(max(x - REACH, 0), min(x + REACH + 1, w)):
                other = label[v, u] - 1
                if other >= 0 and other != k and sign[other] == sign[k]:
                    a, b = _root(parent, other), _root(parent, k)
                    if a < b:
                        parent[b] = a
                    else:
                        parent[a] = b
        k += 1
    n, count = 0, k
    index = np.full(count, -1)
    for i in range(count):
        label[ys[i], xs[i]] = 0
        if _root(parent, i) == i:
            index[i] = n
            n += 1
    return _summarise(n, k, index, parent, xs, ys, size, sign, change, standing, response, usual)


@njit(cache=True, error_model="numpy")
def _summarise(n, count, index, parent, xs, ys, size, sign, change, standing, response, usual):
    """The n blobs of the marked pixels, and these; index (count,) numbers the pixels that stand for a blob."""
    h, w = response.shape
    blobs = np.zeros((n, N_COLUMNS), np.float32)
    blobs[:, LEFT], blobs[:, TOP] = w, h
    pixels = np.empty((count, 3), np.int32)
    weight, total = np.zeros(n, np.float32), np.zeros(n, np.float32)
    for i in range(count):
        j = index[_root(parent, i)]
        pixels[i, 0], pixels[i, 1], pixels[i, 2] = xs[i], ys[i], j
        b = blobs[j]
        b[LEFT], b[RIGHT] = min(b[LEFT], xs[i]), max(b[RIGHT], xs[i])
        b[TOP], b[BOTTOM] = min(b[TOP], ys[i]), max(b[BOTTOM], ys[i])
        b[N_PIXELS] += 1
        b[CHANGE], b[STANDING] = max(b[CHANGE], change[i]), max(b[STANDING], standing[i])
        value, moved = abs(response[ys[i], xs[i]]), abs(response[ys[i], xs[i]] - usual[ys[i], xs[i]])
        b[NOVELTY] += moved
        total[j] += max(value, moved)
        b[STOOD] += standing[i] > 1
        if change[i] > 1:
            b[CHANGED] += 1
            b[CHANGED_X] += size[i] * xs[i]
            b[CHANGED_Y] += size[i] * ys[i]
            weight[j] += size[i]
        if size[i] > b[PEAK]:
            b[PEAK], b[PEAK_X], b[PEAK_Y], b[SIGN] = size[i], xs[i], ys[i], sign[i]
    for j in range(n):
        blobs[j, NOVELTY] /= max(total[j], np.float32(1.0))
        if weight[j] > 0:
            blobs[j, CHANGED_X] /= weight[j]
            blobs[j, CHANGED_Y] /= weight[j]
    return blobs, pixels
