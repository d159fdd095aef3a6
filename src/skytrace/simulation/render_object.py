"""Drawing of small solid things, anti-aliased, blurred by their motion and read out row by row."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from skytrace.geometry.arrays import FloatArray, frozen_array

Picture = NDArray[Any]  # of float32

# Half the width over which an edge passes from clear to covered, and the radius an infinitely thin part appears with:
# what a good lens makes of them.
_EDGE_PX = 0.7
_SPOT_PX = 0.5
_MAX_BLUR_SAMPLES = 64


@dataclass(frozen=True, eq=False, slots=True)
class Solid:
    """Ellipsoids of one tone and opacity each, in units of the thing's size, in its own frame."""

    offset: FloatArray  # (m, 3) centres
    axes: FloatArray  # (m, 3, 3) semi-axes as columns
    opacity: FloatArray  # (m,) in (0, 1]
    tone: FloatArray  # (m,) luma code

    def __post_init__(self) -> None:
        object.__setattr__(self, "offset", frozen_array(self.offset, (None, 3), "offset"))
        m = len(self.offset)
        object.__setattr__(self, "axes", frozen_array(self.axes, (m, 3, 3), "axes"))
        for name in ("opacity", "tone"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), (m,), name))

    def seen(self, px_from_body: FloatArray) -> Ellipses:
        """How it looks where a small step in its frame moves the image by px_from_body (2, 3)."""
        offset = self.offset @ px_from_body.T
        half = px_from_body @ self.axes
        sharp = half @ half.transpose(0, 2, 1)
        blurred = sharp + _SPOT_PX**2 * np.eye(2)
        # A part thinner than a spot of the lens appears wider and fainter, its darkness kept.
        # Its soft edge adds some 0.2 _EDGE_PX**2 to the product of its semi-axes.
        wide = np.sqrt(np.linalg.det(blurred)) + 0.2 * _EDGE_PX**2
        share = np.sqrt(np.maximum(np.linalg.det(sharp), 0)) / wide
        reach = np.sqrt(np.linalg.eigvalsh(blurred)[:, 1])
        return Ellipses(offset, np.linalg.inv(blurred), self.opacity * share, self.tone, reach)


@dataclass(frozen=True, eq=False, slots=True)
class Ellipses:
    """A solid as seen: from the hindmost part to the foremost."""

    offset_px: FloatArray  # (m, 2)
    conic: NDArray[Any]  # (m, 2, 2): d.T @ conic @ d = 1 on the edge
    opacity: FloatArray  # (m,)
    tone: FloatArray  # (m,)
    reach_px: FloatArray  # (m,) longer semi-axis

    @property
    def radius_px(self) -> float:
        """Distance from the origin beyond which nothing is drawn."""
        return float((np.hypot(*self.offset_px.T) + self.reach_px).max() + 2 * _EDGE_PX)


@dataclass(frozen=True, eq=False, slots=True)
class Patch:
    """The part of a picture that something was drawn into."""

    top: int
    left: int
    cover: FloatArray  # (rows, columns) share of each pixel that is covered
    contrast: float  # mean difference in luma from what it covers


def draw(
    picture: Picture,
    ellipses: Ellipses,
    path_px: Callable[[FloatArray], FloatArray],
    row_time_s: Callable[[FloatArray], FloatArray],
    exposure_s: float,
    centre_px: FloatArray,
) -> Patch | None:
    """Draw a thing into a picture (h, w), in place; none where it is not in it.

    `path_px` gives its centre (n, 2) at times (n,), `row_time_s` the times at the middle of the exposure of rows.
    Every row shows the thing where it was while that row was exposed. `centre_px` (2,) is where to look for it. The
    centroid of what is drawn is where the thing is in the middle of the exposure of its own row, as long as its path
    is straight over the few milliseconds it takes to read it out and its parts are symmetric.
    """
    height, width = picture.shape
    radius = ellipses.radius_px
    middle_s = float(row_time_s(np.array([centre_px[1]]))[0])
    ends = path_px(middle_s + exposure_s * np.array([-0.5, 0.5]))
    blur_px = float(np.hypot(*(ends[1] - ends[0])))
    # Moving along with the readout a thing can appear twice as high as it is.
    reach = 2 * radius + blur_px + 2
    if not np.isfinite(centre_px).all() or not np.isfinite(blur_px):
        return None
    first, last = max(0, int(centre_px[1] - reach)), min(height - 1, int(centre_px[1] + reach))
    if last < first:
        return None
    rows = np.arange(first, last + 1)
    n_samples = int(np.clip(np.ceil(2 * blur_px), 1, _MAX_BLUR_SAMPLES))
    part = (np.arange(n_samples) + 0.5) / n_samples - 0.5
    time_s = row_time_s(rows.astype(float))[:, None] + exposure_s * part
    centre = path_px(time_s.ravel()).reshape(len(rows), n_samples, 2)
    left = max(0, int(np.floor(centre[..., 0].min() - radius)))
    right = min(width - 1, int(np.ceil(centre[..., 0].max() + radius)))
    if right < left:
        return None
    cover = np.empty((len(rows), right - left + 1))
    light = np.empty_like(cover)
    conic = np.stack([ellipses.conic[:, 0, 0], ellipses.conic[:, 0, 1], ellipses.conic[:, 1, 1]], axis=1)
    steps = 3 if radius < 12 else 2
    reach_px = ellipses.reach_px + 2 * _EDGE_PX
    _cover(
        centre, first, left, ellipses.offset_px, conic, ellipses.opacity, ellipses.tone, reach_px, steps, cover, light
    )
    window = picture[first : last + 1, left : right + 1]
    change = light - cover * window
    window += change
    return Patch(first, left, cover, float(np.abs(change).sum() / max(cover.sum(), 1e-9)))


@njit(cache=True, error_model="numpy")
def _cover(centre, first, left, offset, conic, opacity, tone, reach, steps, cover, light):
    """Share of each pixel that is covered, and the light from what covers it: means over pixel and exposure."""
    n_rows, n_samples = centre.shape[0], centre.shape[1]
    weight = 1.0 / (n_samples * steps * steps)
    outer = 0.0
    for p in range(len(offset)):
        outer = max(outer, np.hypot(offset[p, 0], offset[p, 1]) + reach[p])
    for i in range(n_rows):
        for j in range(cover.shape[1]):
            covered, lit = 0.0, 0.0
            for k in range(n_samples):
                x0, y0 = left + j - centre[i, k, 0], first + i - centre[i, k, 1]
                if x0 * x0 + y0 * y0 > (outer + 1) ** 2:
                    continue
                for s in range(steps * steps):
                    dx = x0 + (s % steps + 0.5) / steps - 0.5
                    dy = y0 + (s // steps + 0.5) / steps - 0.5
                    a, t = 0.0, 0.0
                    for p in range(len(offset)):
                        u, v = dx - offset[p, 0], dy - offset[p, 1]
                        if u * u + v * v > reach[p] * reach[p]:
                            continue
                        gu, gv = conic[p, 0] * u + conic[p, 1] * v, conic[p, 1] * u + conic[p, 2] * v
                        r = np.sqrt(u * gu + v * gv)
                        slope = np.sqrt(gu * gu + gv * gv)
                        inside = 1.0
                        if slope > 1e-12:
                            # Distance to the edge, to first order.
                            inside = min(max(0.5 + 0.5 * (1 - r) * r / slope / _EDGE_PX, 0.0), 1.0)
                        alpha = opacity[p] * inside * inside * (3 - 2 * inside)
                        a += (1 - a) * alpha
                        t += (tone[p] - t) * alpha
                    covered += a
                    lit += t
            cover[i, j] = covered * weight
            light[i, j] = lit * weight
