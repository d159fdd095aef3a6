"""Saddle points of a picture: where two dark and two bright corners meet.

The quadratic form of the blurred picture's second derivatives tells all that is needed of such a point: its determinant
is negative, the form vanishes along the two edges that cross there, and it is largest towards the bright corners.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from skytrace.geometry.arrays import BoolArray, FloatArray, IntArray

_LEAST_CONTRAST = 12.0  # grey levels of 255 between dark and bright corners
_LEAST_STRENGTH = 0.12  # of the contrast; an ideal right-angled crossing has 1 / pi
_RING_SIGMAS = 2.5  # radius of the ring that checks a crossing, in blurs
_RING_SAMPLES = 32
_LARGEST_ODD_SHARE = 0.35


@dataclass(frozen=True, eq=False, slots=True)
class Saddles:
    """Crossings of two edges in a picture."""

    xy_px: FloatArray  # (n, 2)
    edges: FloatArray  # (n, 2, 2) unit directions along the two edges, sign arbitrary
    bright: FloatArray  # (n, 2) unit direction towards a bright corner, sign arbitrary
    strength: FloatArray  # (n,)

    def __len__(self) -> int:
        return len(self.xy_px)

    def take(self, chosen: BoolArray | IntArray) -> Saddles:
        return Saddles(self.xy_px[chosen], self.edges[chosen], self.bright[chosen], self.strength[chosen])


def find_saddles(blurred: np.ndarray, sigma_px: float) -> Saddles:
    """All crossings in a grey picture (h, w) float32 that was blurred by a Gaussian of `sigma_px`, strongest first."""
    ixx = cv2.Sobel(blurred, cv2.CV_32F, 2, 0, ksize=3) / 4
    iyy = cv2.Sobel(blurred, cv2.CV_32F, 0, 2, ksize=3) / 4
    ixy = cv2.Sobel(blurred, cv2.CV_32F, 1, 1, ksize=3) / 4
    saddle = ixy * ixy - ixx * iyy
    response = np.sqrt(np.maximum(saddle, 0)) * sigma_px**2
    reach = max(3, 2 * int(np.ceil(1.5 * sigma_px)) + 1)
    largest = cv2.dilate(response, np.ones((reach, reach), np.uint8))
    margin = int(np.ceil(_RING_SIGMAS * sigma_px)) + 1
    inside = np.zeros(response.shape, bool)
    inside[margin:-margin, margin:-margin] = True
    rows, columns = np.nonzero((response == largest) & (response > _LEAST_STRENGTH * _LEAST_CONTRAST) & inside)
    hxx, hyy, hxy = (derivative[rows, columns].astype(float) for derivative in (ixx, iyy, ixy))
    strength = response[rows, columns].astype(float)
    xy = np.column_stack([columns, rows]).astype(float) + _peak_offset(response, rows, columns)
    edges, bright = _directions(hxx, hyy, hxy)
    ring = _ring(blurred, xy, _RING_SIGMAS * sigma_px)
    good = _is_crossing(ring) & (strength > _LEAST_STRENGTH * np.ptp(ring, axis=1))
    found = Saddles(xy, edges, bright, strength).take(good)
    return found.take(np.argsort(-found.strength, kind="stable"))


def _peak_offset(response: np.ndarray, rows: IntArray, columns: IntArray) -> FloatArray:
    """Offset (n, 2) of the maximum from its pixel, by parabolas through the neighbours."""
    centre = response[rows, columns]
    offset = np.empty((len(rows), 2))
    for axis, (dr, dc) in enumerate([(0, 1), (1, 0)]):
        before, after = response[rows - dr, columns - dc], response[rows + dr, columns + dc]
        curvature = np.minimum(before + after - 2 * centre, -1e-9)
        offset[:, axis] = np.clip(0.5 * (before - after) / curvature, -0.5, 0.5)
    return offset


def _directions(hxx: FloatArray, hyy: FloatArray, hxy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Edge directions (n, 2, 2), along which the quadratic form vanishes, and bright directions (n, 2)."""
    mean, half = 0.5 * (hxx + hyy), np.hypot(0.5 * (hxx - hyy), hxy)
    bright_rad = 0.5 * np.arctan2(2 * hxy, hxx - hyy)
    # The form at angle a from the bright direction is mean + half cos 2a.
    open_rad = 0.5 * np.arccos(np.clip(-mean / np.maximum(half, 1e-12), -1, 1))
    angles = np.stack([bright_rad - open_rad, bright_rad + open_rad], axis=1)
    edges = np.stack([np.cos(angles), np.sin(angles)], axis=2)
    return edges, np.stack([np.cos(bright_rad), np.sin(bright_rad)], axis=1)


def _ring(blurred: np.ndarray, xy_px: FloatArray, radius_px: float) -> FloatArray:
    """Grey values (n, samples) on a circle about each point."""
    angle = 2 * np.pi * np.arange(_RING_SAMPLES) / _RING_SAMPLES
    x = (xy_px[:, :1] + radius_px * np.cos(angle)).astype(np.float32)
    y = (xy_px[:, 1:] + radius_px * np.sin(angle)).astype(np.float32)
    return sample(blurred, x, y)


def sample(picture: np.ndarray, x: np.ndarray, y: np.ndarray) -> FloatArray:
    """Bilinear grey values at coordinates, both of shape (n, m); the border's beyond it."""
    if x.size == 0:
        return np.zeros(x.shape)
    # remap takes at most 32767 rows or columns.
    flat_x, flat_y = x.reshape(-1).astype(np.float32), y.reshape(-1).astype(np.float32)
    chunks = [slice(k, k + 30000) for k in range(0, len(flat_x), 30000)]
    border = cv2.BORDER_REPLICATE
    parts = [cv2.remap(picture, flat_x[c], flat_y[c], cv2.INTER_LINEAR, borderMode=border) for c in chunks]
    return np.concatenate([part.ravel() for part in parts]).reshape(x.shape).astype(float)


def _is_crossing(ring: FloatArray) -> BoolArray:
    """Two dark and two bright arcs, alike on opposite sides, and enough contrast between them."""
    half = _RING_SAMPLES // 2
    middle = 0.5 * (ring.max(1) + ring.min(1))
    centred = ring - middle[:, None]
    even = 0.5 * (centred[:, :half] + centred[:, half:])
    odd = 0.5 * (centred[:, :half] - centred[:, half:])
    bright = even > 0
    changes = (bright[:, 1:] != bright[:, :-1]).sum(1) + (bright[:, 0] != bright[:, -1])
    alike = (odd**2).sum(1) < _LARGEST_ODD_SHARE * (even**2).sum(1)
    return alike & (changes == 2) & (np.ptp(ring, axis=1) > _LEAST_CONTRAST)
