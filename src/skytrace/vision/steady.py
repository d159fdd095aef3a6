"""How far the camera itself has turned since the video began, in pixels of the reduced picture."""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from skytrace.geometry.arrays import FloatArray

_MAX_EDGE_PX = 2.5  # from dark to bright; clouds are softer and drift
_HALF = 4  # half the width of a patch
_QUALITY = 0.05  # of a corner against the strongest, as a square of contrast
_NEAR, _FAR = 2, 12  # search radius about the last shift, and where that fails
_MAX_PATCHES = 40
_LEAST_PATCHES = 6
_AGREEING = 0.4  # share of the patches that have to agree about a shift
_STILL, _LEAST_STILL = 0.1, 3  # share that keep still in a camera that does, however many clouds drift
_STILL_PX, _STILL_FIT = 0.25, 0.8
_DRIFT_PX = 1.0
_TOLERANCE_PX = 0.6


@njit(cache=True, error_model="numpy", fastmath=True)
def _mismatch(around, patch, counted):
    """Sum of the squared differences of what counts, about their mean."""
    total, square = np.float32(0.0), np.float32(0.0)
    for i in range(len(patch)):
        e = counted[i] * (around[i] - patch[i])
        total += e
        square += e * e
    return square - total * total / np.float32((2 * _HALF + 1) ** 2)


@njit(cache=True, error_model="numpy")
def _match(sums, patches, places, start_x, start_y, radius, shifts, fit):
    """Where each patch is found: shifts (n, 2) from its place, and fit (n,), the share of it that is explained."""
    h, w = sums.shape
    side = 2 * _HALF + 1
    across = side + 2 * radius  # of what is searched; patches are laid out in rows as long
    grid = np.empty((2 * radius + 1, 2 * radius + 1))
    around, patch = np.empty(across * across, np.float32), np.zeros((side - 1) * across + side, np.float32)
    counted = np.zeros_like(patch)
    for i in range(side):
        counted[i * across : i * across + side] = 1.0
    for k in range(len(places)):
        left, top = places[k, 0] + start_x - radius - _HALF, places[k, 1] + start_y - radius - _HALF
        fit[k] = 0.0
        if left < 0 or top < 0 or left + across > w or top + across > h:
            continue
        energy = 0.0
        for i in range(side):
            for j in range(side):
                patch[i * across + j] = patches[k, i, j]
                energy += patches[k, i, j] ** 2
        middle = np.float32(sums[top + across // 2, left + across // 2])
        for i in range(across):
            for j in range(across):
                around[i * across + j] = np.float32(sums[top + i, left + j]) - middle
        best, bx, by = np.inf, 0, 0
        for dy in range(-radius, radius + 1):
            for dx in range(-radius, radius + 1):
                cost = _mismatch(around[(dy + radius) * across + dx + radius :], patch, counted)
                grid[dy + radius, dx + radius] = cost
                if cost < best:
                    best, bx, by = cost, dx, dy
        if abs(bx) == radius or abs(by) == radius:
            continue
        u, v = bx + radius, by + radius
        cx = grid[v, u - 1] - 2 * best + grid[v, u + 1]
        cy = grid[v - 1, u] - 2 * best + grid[v + 1, u]
        shifts[k, 0] = start_x + bx + (0.5 * (grid[v, u - 1] - grid[v, u + 1]) / cx if cx > 0 else 0.0)
        shifts[k, 1] = start_y + by + (0.5 * (grid[v - 1, u] - grid[v + 1, u]) / cy if cy > 0 else 0.0)
        fit[k] = 1 - best / max(energy, 1.0)


class Steadiness:
    """Follows patches of the scenery.

    The shift is zero for a camera on a tripod. Where too little of the scenery can be followed, the last one stays.
    """

    def __init__(self) -> None:
        self.shift = np.zeros(2)
        self.lost = False  # the last picture could not be placed
        self._base = np.zeros(2)  # shift at which the patches were taken
        self._places = np.zeros((0, 2), np.int64)
        self._patches = np.zeros((0, 2 * _HALF + 1, 2 * _HALF + 1))
        self._age = 0

    def step(self, sums: NDArray[np.uint16]) -> FloatArray:
        """The shift (2,) of a picture against the first one."""
        if self._age == 0:
            self._take(sums)
        self._age += 1
        self.lost = False
        if len(self._places) < _LEAST_STILL:
            return self.shift
        found = self._measure(sums, _NEAR)
        if found is None:
            found = self._measure(sums, _FAR)
        if found is None:
            self.lost = True
            self._take(sums)
        else:
            self.shift = self._base + found
            if np.abs(found).max() > 3 * _FAR:
                self._take(sums)
        return self.shift

    def _measure(self, sums: NDArray[np.uint16], radius: int) -> FloatArray | None:
        n = len(self._places)
        shifts, fit = np.zeros((n, 2)), np.zeros(n)
        x, y = np.rint(self.shift - self._base).astype(int)
        _match(sums, self._patches, self._places, x, y, radius, shifts, fit)
        still = (np.abs(shifts).max(axis=1) < _STILL_PX) & (fit > _STILL_FIT)
        if still.sum() >= max(_LEAST_STILL, _STILL * n):
            # What moves meanwhile is no scenery.
            self._keep((fit <= _STILL_FIT) | (np.abs(shifts).max(axis=1) < _DRIFT_PX))
            return np.zeros(2)
        good = shifts[fit > 0.5]
        least = max(min(_LEAST_PATCHES, n), _AGREEING * n)
        if len(good) < least:
            return None
        middle = np.median(good, axis=0)
        agreeing = np.abs(good - middle).max(axis=1) < _TOLERANCE_PX
        if agreeing.sum() < least:
            return None
        return good[agreeing].mean(axis=0)

    def _take(self, sums: NDArray[np.uint16]) -> None:
        h, w = sums.shape
        margin = 2 * _FAR + _HALF
        picture = (sums >> 2).astype(np.uint8)
        inside = np.zeros(picture.shape, np.uint8)
        inside[margin:-margin, margin:-margin] = 1
        corners = cv2.goodFeaturesToTrack(picture, _MAX_PATCHES, _QUALITY, max(h, w) / 24, mask=inside, blockSize=5)
        places = np.zeros((0, 2)) if corners is None else corners.reshape(-1, 2)
        patches = [
            sums[y - _HALF : y + _HALF + 1, x - _HALF : x + _HALF + 1].astype(float) for x, y in places.astype(np.int64)
        ]
        solid = [np.ptp(p) < _MAX_EDGE_PX * max(np.abs(np.gradient(p)).max(), 1.0) for p in patches]
        self._places = places.astype(np.int64)
        self._patches = np.array(patches).reshape(-1, 2 * _HALF + 1, 2 * _HALF + 1)
        self._patches -= self._patches.mean(axis=(1, 2), keepdims=True)
        self._keep(np.array(solid, bool) & (sum(solid) >= _LEAST_PATCHES))
        self._base = self.shift.copy()

    def _keep(self, kept: NDArray[np.bool_]) -> None:
        self._places, self._patches = self._places[kept], self._patches[kept]
