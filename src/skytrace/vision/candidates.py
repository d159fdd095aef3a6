"""Compiled steps from blobs to measured candidates, and the search for one object around a place."""

from __future__ import annotations

import numpy as np
from numba import njit

from skytrace.vision import blobs as blob
from skytrace.vision import refine
from skytrace.vision.scan import BLOCK, UNITS_PER_LUMA

# Columns of a candidate; lengths in pixels of the picture, brightness in luma codes.
X, Y, SIGMA, CONTRAST, SIZE, WIDTH, HEIGHT, EDGE, ISOLATED, CHANGE, STANDING, NOVELTY = range(12)
N_COLUMNS = 12

MIN_PEAK = 4.0  # luma codes
MIN_RATIO = 4.0  # of an isolated object's strongest pixel to the deviation of the sky around it
REST_FRAMES = 8  # what stands still is measured again after so many
_LONG_REST = 8 * REST_FRAMES  # and what is nothing isolated after so many
_PATCH_SIGMA_PX = 0.7  # of a centre taken from the reduced picture


@njit(cache=True, error_model="numpy")
def isolated(found):
    """Whether a measurement is that of something small and solid in quiet surroundings."""
    return (
        found[refine.CONTAINED] > 0
        and found[refine.QUIET] >= refine.MIN_QUIET
        and found[refine.EDGE] <= refine.MAX_EDGE_PX
        and found[refine.PEAK] >= max(MIN_RATIO * found[refine.NOISE], MIN_PEAK)
    )


@njit(cache=True, error_model="numpy")
def _fill(out, found, change, standing, novelty):
    out[X], out[Y], out[SIGMA], out[CONTRAST] = (
        found[refine.X],
        found[refine.Y],
        found[refine.SIGMA],
        found[refine.CONTRAST],
    )
    out[SIZE], out[WIDTH], out[HEIGHT] = np.sqrt(found[refine.AREA]), found[refine.WIDTH], found[refine.HEIGHT]
    out[EDGE], out[ISOLATED] = found[refine.EDGE], 1
    out[CHANGE], out[STANDING], out[NOVELTY] = change, standing, novelty


@njit(cache=True, error_model="numpy")
def _within(boxes, n, x, y):
    """Whether a place lies in one of the first n boxes."""
    for j in range(n):
        b = boxes[j]
        if b[0] - 0.5 <= x and x <= b[2] + 0.5 and b[1] - 0.5 <= y and y <= b[3] + 0.5:
            return True
    return False


@njit(cache=True, error_model="numpy")
def measure_blobs(luma, stride, width, height, blobs, pixels, rest, memory, out):
    """Measure blobs, the strongest first; fills out (m, N_COLUMNS) and returns how many candidates there are.

    Something isolated is measured in the full picture. What only differs from its past, against trees or houses, keeps
    its centre in the reduced picture; what does neither is no candidate. Where something stands that has not changed,
    `rest` is set: nothing is missed by measuring it less often, and a roof full of tiles costs next to nothing.
    """
    order = np.argsort(-blobs[:, blob.PEAK])
    boxes = np.empty((out.shape[0], 4), np.float32)
    rests = np.zeros(len(blobs), np.uint8)
    found = np.empty(refine.N_MEASURED)
    at, window, inside, stack = memory
    n = 0
    for i in order:
        b = blobs[i]
        w, h = 2 * (b[blob.RIGHT] - b[blob.LEFT] + 1), 2 * (b[blob.BOTTOM] - b[blob.TOP] + 1)
        changed = b[blob.CHANGED] > 0
        if max(w, h) > 2 * refine.MAX_HALF:
            rests[i] = _LONG_REST
            continue
        px, py = 2 * int(b[blob.PEAK_X]), 2 * int(b[blob.PEAK_Y])
        if n == out.shape[0] or _within(boxes, n, px + 0.5, py + 0.5):
            continue
        half = int(0.5 * max(w, h)) + refine.RING + 2
        seen = refine.measure(luma, stride, width, height, px, py, half, at, window, inside, stack, found)
        if seen and isolated(found):
            if _within(boxes, n, found[refine.X], found[refine.Y]):
                continue
            _fill(out[n], found, b[blob.CHANGE], b[blob.STANDING], b[blob.NOVELTY])
            boxes[n, 0], boxes[n, 1] = found[refine.LEFT] - refine.GAP, found[refine.TOP] - refine.GAP
            boxes[n, 2], boxes[n, 3] = (
                found[refine.LEFT] + found[refine.WIDTH] + refine.GAP,
                found[refine.TOP] + found[refine.HEIGHT] + refine.GAP,
            )
            n += 1
            rests[i] = 0 if changed else REST_FRAMES
        elif changed:
            _fill_changed(out[n], b, w, h)
            boxes[n, 0], boxes[n, 1] = 2 * b[blob.LEFT], 2 * b[blob.TOP]
            boxes[n, 2], boxes[n, 3] = 2 * b[blob.RIGHT] + 1, 2 * b[blob.BOTTOM] + 1
            n += 1
        elif not changed:
            rests[i] = _LONG_REST
    for k in range(len(pixels)):
        x, y, i = pixels[k]
        if rests[i]:
            for v in range(max((y >> 1) - 1, 0), min((y >> 1) + 2, rest.shape[0])):
                for u in range(max((x >> 1) - 1, 0), min((x >> 1) + 2, rest.shape[1])):
                    rest[v, u] = max(rest[v, u], rests[i])
    return n


@njit(cache=True, error_model="numpy")
def _fill_changed(out, b, w, h):
    out[X], out[Y] = 2 * b[blob.CHANGED_X] + 0.5, 2 * b[blob.CHANGED_Y] + 0.5
    size = 2 * np.sqrt(b[blob.CHANGED])
    out[SIGMA] = np.hypot(_PATCH_SIGMA_PX, 0.1 * size)
    out[CONTRAST], out[SIZE] = b[blob.SIGN] * b[blob.PEAK] / UNITS_PER_LUMA, size
    out[WIDTH], out[HEIGHT] = w, h
    out[EDGE], out[ISOLATED] = np.nan, 0
    out[CHANGE], out[STANDING], out[NOVELTY] = b[blob.CHANGE], b[blob.STANDING], b[blob.NOVELTY]


@njit(cache=True, error_model="numpy")
def _places_to_look(response, usual, spread, factors, left, right, top, bottom, x, y, radius, sign):
    """The strongest response of a sign around a place, as x, y, and the largest change, as size, x, y.

    What lies far from where it is expected has to stand out more.
    """
    best, bx, by = 0.0, -1, -1
    most, mx, my = 0.0, -1, -1
    for v in range(top, bottom):
        for u in range(left, right):
            d2 = ((2 * u - x) ** 2 + (2 * v - y) ** 2) / (radius * radius)
            if d2 > 1:
                continue
            weight = 1 - 0.5 * d2
            value = np.float64(response[v, u])
            if weight * sign * value > best:
                best, bx, by = weight * sign * value, u, v
            moved = value - usual[v, u]
            change = sign * moved / (factors[0] * spread[v, u] + factors[1])
            if weight * change > most:
                most, mx, my = weight * change, u, v
    return bx, by, most, mx, my


@njit(cache=True, error_model="numpy")
def _fill_around(out, response, usual, mx, my, sign, most, size):
    """A candidate from the pixels around the largest change that changed half as much."""
    h, w = response.shape
    reach = int(0.5 * size) + 1
    total, sx, sy, n = 0.0, 0.0, 0.0, 0
    peak = sign * (response[my, mx] - usual[my, mx])
    for v in range(max(my - reach, 0), min(my + reach + 1, h)):
        for u in range(max(mx - reach, 0), min(mx + reach + 1, w)):
            moved = sign * (response[v, u] - usual[v, u])
            if moved > 0.5 * peak:
                total += moved
                sx += moved * u
                sy += moved * v
                n += 1
    out[X], out[Y] = 2 * sx / total + 0.5, 2 * sy / total + 0.5
    out[SIZE] = 2 * np.sqrt(n)
    out[SIGMA] = np.hypot(_PATCH_SIGMA_PX, 0.15 * size)
    out[CONTRAST], out[WIDTH], out[HEIGHT] = sign * peak / UNITS_PER_LUMA, out[SIZE], out[SIZE]
    out[EDGE], out[ISOLATED] = np.nan, 0
    out[CHANGE], out[STANDING] = most, 0
    out[NOVELTY] = min(peak / max(abs(response[my, mx]), 1), 1.0)


@njit(cache=True, error_model="numpy")
def seek(
    luma, stride, width, height, response, usual, spread, clutter, factors, x, y, radius, contrast, size, least_change,
    memory, out,
):  # fmt: skip
    """Look for an object of known contrast and size around a place; fills out (N_COLUMNS,) and returns whether found.

    First for something isolated that looks like it, then for the largest change against the past.
    """
    h, w = response.shape
    left, right = max(int((x - radius) / 2), 0), min(int((x + radius) / 2) + 1, w)
    top, bottom = max(int((y - radius) / 2), 0), min(int((y + radius) / 2) + 1, h)
    if left >= right or top >= bottom:
        return False
    sign = 1.0 if contrast > 0 else -1.0
    bx, by, most, mx, my = _places_to_look(
        response, usual, spread, factors, left, right, top, bottom, x, y, radius, sign
    )
    found = np.empty(refine.N_MEASURED)
    at, window, inside, stack = memory
    half = int(0.75 * size) + refine.RING + 2
    if bx >= 0 and refine.measure(luma, stride, width, height, 2 * bx, 2 * by, half, at, window, inside, stack, found):
        alike = (
            sign * found[refine.CONTRAST] > 0.4 * abs(contrast)
            and sign * found[refine.CONTRAST] < 2.5 * abs(contrast)
            and np.sqrt(found[refine.AREA]) > 0.4 * size
            and np.sqrt(found[refine.AREA]) < 2.5 * size
        )
        if alike and isolated(found):
            near = clutter[by // BLOCK, bx // BLOCK]
            standing = abs(response[by, bx]) / (factors[2] * near + factors[3])
            moved = abs(response[by, bx] - usual[by, bx])
            change = moved / (factors[0] * spread[by, bx] + factors[1])
            _fill(out, found, change, standing, min(moved / max(abs(response[by, bx]), 1), 1.0))
            return True
    if most < least_change:
        return False
    _fill_around(out, response, usual, mx, my, sign, most, size)
    return True
