"""Compiled measurement of one small object in a full picture: where its centre is, and how it looks."""

from __future__ import annotations

import numpy as np
from numba import njit

RING = 2  # width of the border of a window from which the background is taken
MAX_HALF = 72  # half the width of the largest window
GAP = 2  # parts of one object may be this far apart
_GROWTH = 1.5
SHARE = 0.25  # pixels weaker than this share of the strongest belong to the background

# Columns of a measurement; lengths in pixels of the picture, brightness in luma codes.
X, Y, SIGMA, CONTRAST, PEAK, AREA, LEFT, TOP, WIDTH, HEIGHT, NOISE, QUIET, EDGE, CONTAINED = range(14)
N_MEASURED = 14

_SIDE = 2 * MAX_HALF + 1
MAX_EDGE_PX = 4.5  # solid things have sharper edges; clouds have not
MIN_QUIET = 0.75  # with less of the border as quiet as the sky, the window lies inside something large
_CENTRE_FLOOR_PX = 0.05  # what pixels, codec and the object's shape leave uncertain at best
_CENTRE_SHARE = 0.02  # and as a share of the object's size


@njit(cache=True)
def scratch():
    """Memory for `measure`, to be used again and again."""
    return (
        np.empty((3, 4 * RING * (_SIDE + 1)), np.float32),
        np.empty((_SIDE, _SIDE), np.float32),
        np.empty((_SIDE, _SIDE), np.uint8),
        np.empty((_SIDE * _SIDE, 2), np.int16),
    )


@njit(cache=True, error_model="numpy")
def _ring(luma, stride, x0, y0, x1, y1, width, height, at):
    """The pixels (3, n) x, y, value of the window's border; where the picture ends there is none."""
    n = 0
    left, right = x0 + (RING if x0 > 0 else 0), x1 - (RING if x1 < width else 0)
    for y in range(y0, y1):
        row = (y < y0 + RING and y0 > 0) or (y >= y1 - RING and y1 < height)
        for x in range(x0, x1 if row else left):
            at[0, n], at[1, n], at[2, n] = x - x0, y - y0, luma[y * stride + x]
            n += 1
        for x in range(x1 if row else max(left, right), x1):
            at[0, n], at[1, n], at[2, n] = x - x0, y - y0, luma[y * stride + x]
            n += 1
    return n


@njit(cache=True, error_model="numpy", fastmath=True)
def _plane(at, n, plane):
    """Fit value = a + b x + c y, twice again without what is far off; returns the deviation about it."""
    xs, ys, values = at[0, :n], at[1, :n], at[2, :n]
    limit, noise = np.float32(1e9), 0.0
    p, q, r = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for _ in range(3):
        m, sx, sy, sv, sxx, sxy, syy, sxv, syv = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(n):
            x, y, v = xs[i], ys[i], values[i]
            k = 1.0 if abs(v - p - q * x - r * y) <= limit else 0.0
            kx, ky, kv = k * x, k * y, k * v
            m += k
            sx += kx
            sy += ky
            sv += kv
            sxx += kx * x
            sxy += kx * y
            syy += ky * y
            sxv += kv * x
            syv += kv * y
        if m < 8:
            return -1.0
        mx, my, mv = sx / m, sy / m, sv / m
        cxx, cxy, cyy = sxx / m - mx * mx, sxy / m - mx * my, syy / m - my * my
        cxv, cyv = sxv / m - mx * mv, syv / m - my * mv
        det = cxx * cyy - cxy * cxy
        b, c = 0.0, 0.0
        if det > 1e-6 * (cxx + cyy) ** 2:
            b, c = (cyy * cxv - cxy * cyv) / det, (cxx * cyv - cxy * cxv) / det
        plane[0], plane[1], plane[2] = mv - b * mx - c * my, b, c
        p, q, r = np.float32(plane[0]), np.float32(b), np.float32(c)
        # A mean absolute deviation: what is far off weighs less than in a mean square.
        total, m = np.float32(0.0), np.float32(0.0)
        for i in range(n):
            off = abs(values[i] - p - q * xs[i] - r * ys[i])
            k = np.float32(1.0) if off <= limit else np.float32(0.0)
            total += k * off
            m += k
        noise = 1.2533 * total / max(m, 1.0)
        limit = np.float32(max(2.5 * noise, 1.0))
    return noise


@njit(cache=True, error_model="numpy", fastmath=True)
def _n_quiet(at, n, plane, level):
    """How many of the pixels of a window's border differ from the background by less than a level."""
    p, q, r, level = np.float32(plane[0]), np.float32(plane[1]), np.float32(plane[2]), np.float32(level)
    xs, ys, values = at[0, :n], at[1, :n], at[2, :n]
    quiet = 0
    for i in range(n):
        quiet += abs(values[i] - p - q * xs[i] - r * ys[i]) < level
    return quiet


@njit(cache=True, error_model="numpy")
def _steepest(window, w, h, at, n):
    """The largest gradient at the pixels at (n, 2), by Sobel's masks."""
    steepest = 0.0
    for i in range(n):
        u, v = at[i, 0], at[i, 1]
        if u == 0 or u == w - 1 or v == 0 or v == h - 1:
            continue
        a, b, c = window[v - 1, u - 1], window[v - 1, u], window[v - 1, u + 1]
        d, e = window[v, u - 1], window[v, u + 1]
        f, g, k = window[v + 1, u - 1], window[v + 1, u], window[v + 1, u + 1]
        gx, gy = c + 2 * e + k - a - 2 * d - f, f + 2 * g + k - a - 2 * b - c
        steepest = max(steepest, gx * gx + gy * gy)
    return np.sqrt(steepest) / 8


@njit(cache=True, error_model="numpy")
def _fill_window(luma, stride, x0, y0, x1, y1, plane, seed_x, seed_y, near, window, inside):
    """Differences to the background in a window, and the strongest (size, x, y) near the seed; clears `inside`."""
    peak, px, py, slope = np.float32(0.0), -1, -1, np.float32(plane[1])
    for y in range(y0, y1):
        row, out = luma[y * stride + x0 : y * stride + x1], window[y - y0, : x1 - x0]
        begin = np.float32(plane[0] + plane[2] * (y - y0))
        for x in range(len(row)):
            out[x] = np.float32(row[x]) - begin - slope * np.float32(x)
        inside[y - y0, : x1 - x0] = 0
        if abs(y - seed_y) <= near:
            for x in range(max(seed_x - near, x0) - x0, min(seed_x + near + 1, x1) - x0):
                if abs(out[x]) > peak:
                    peak, px, py = abs(out[x]), x, y - y0
    return peak, px, py


@njit(cache=True, error_model="numpy")
def _hang_together(window, w, h, px, py, level, inside, stack):
    """What hangs together with a pixel: fills stack (m, 2); returns m and the left, right, top and bottom of it."""
    n, m = 0, 1
    stack[0, 0], stack[0, 1] = px, py
    inside[py, px] = 1
    left, right, top, bottom = px, px, py, py
    while n < m:
        cx, cy = stack[n, 0], stack[n, 1]
        n += 1
        left, right, top, bottom = min(left, cx), max(right, cx), min(top, cy), max(bottom, cy)
        for v in range(max(cy - GAP, 0), min(cy + GAP + 1, h)):
            for u in range(max(cx - GAP, 0), min(cx + GAP + 1, w)):
                if inside[v, u] == 0 and abs(window[v, u]) > level:
                    inside[v, u] = 1
                    stack[m, 0], stack[m, 1] = u, v
                    m += 1
    return m, left, right, top, bottom


@njit(cache=True, error_model="numpy")
def _weigh(window, stack, m, noise, x0, y0, out):
    """Centre, its deviation and the mean contrast of the pixels in stack (m, 2), each weighing what it differs by."""
    total, mx, my, signed = 0.0, 0.0, 0.0, 0.0
    for i in range(m):
        u, v = stack[i, 0], stack[i, 1]
        e = abs(window[v, u])
        total += e
        mx += e * u
        my += e * v
        signed += window[v, u]
    mx, my = mx / total, my / total
    spread2 = 0.0
    for i in range(m):
        spread2 += (stack[i, 0] - mx) ** 2 + (stack[i, 1] - my) ** 2
    out[X], out[Y] = x0 + mx, y0 + my
    out[SIGMA] = np.sqrt(noise**2 * 0.5 * spread2 / total**2 + _CENTRE_FLOOR_PX**2 + _CENTRE_SHARE**2 * m)
    out[CONTRAST] = signed / m


@njit(cache=True, error_model="numpy")
def measure(luma, stride, width, height, seed_x, seed_y, half, at, window, inside, stack, out):
    """Measure the object at a seed pixel of a picture given as its flat memory.

    The window begins with the half-width `half` and grows until the object lies inside. Fills out (N_MEASURED,):
    centre and its deviation, mean contrast (signed) and strongest difference to the background, pixels, width and
    height, deviation of the background, share of the window's border that is quiet against the object, the shortest
    distance over which brightness passes from the background to the strongest (a soft cloud's is long), and whether
    the object lies inside the window. The last four arguments before out are those of `scratch`. Returns False where
    there is nothing to measure, or where the surroundings are not quiet.
    """
    plane = np.zeros(3)
    near = max(2, half // 2)
    while True:
        half = min(half, MAX_HALF)
        x0, x1 = max(seed_x - half, 0), min(seed_x + half + 1, width)
        y0, y1 = max(seed_y - half, 0), min(seed_y + half + 1, height)
        n_ring = _ring(luma, stride, x0, y0, x1, y1, width, height, at)
        noise = _plane(at, n_ring, plane)
        if noise < 0:
            return False
        peak, px, py = _fill_window(luma, stride, x0, y0, x1, y1, plane, seed_x, seed_y, near, window, inside)
        if peak < 3 * noise or peak < 2:
            return False
        level = max(SHARE * peak, 2.5 * noise)
        quiet = _n_quiet(at, n_ring, plane, level)
        if quiet < MIN_QUIET * n_ring:
            return False
        w, h = x1 - x0, y1 - y0
        m, left, right, top, bottom = _hang_together(window, w, h, px, py, level, inside, stack)
        contained = (
            (left >= RING or x0 == 0)
            and (right < w - RING or x1 == width)
            and (top >= RING or y0 == 0)
            and (bottom < h - RING or y1 == height)
        )
        steepest = _steepest(window, w, h, stack, m)
        edge = peak / max(steepest - noise, 1e-3)
        if contained or half == MAX_HALF or edge > MAX_EDGE_PX:
            break
        half = int(_GROWTH * half) + 1
    _weigh(window, stack, m, noise, x0, y0, out)
    out[PEAK], out[AREA] = peak, m
    out[LEFT], out[TOP] = x0 + left, y0 + top
    out[WIDTH], out[HEIGHT] = right - left + 1, bottom - top + 1
    out[NOISE], out[QUIET] = noise, quiet / max(n_ring, 1)
    out[EDGE] = edge
    out[CONTAINED] = contained
    return True
