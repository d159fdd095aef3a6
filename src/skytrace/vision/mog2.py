"""The paper's detector beside the default one: OpenCV's mixture of Gaussians.

Zivkovic, "Improved adaptive Gaussian mixture model for background subtraction", ICPR 2004; Zivkovic and van der
Heijden, "Efficient adaptive density estimation per image pixel", Pattern Recognition Letters 27 (2006).
"""

from __future__ import annotations

import cv2
import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.vision import candidates as cand
from skytrace.vision.detect import LumaArray

_MIN_AREA, _MAX_SIDE = 4, 144  # px
_MAX_CANDIDATES = 200
_SURE = 10.0  # the mask does not say how much a pixel changed


class Mog2Detector:
    """Foreground blobs of the luma picture, with the same surface as `Detector`."""

    scene_shift_px = np.zeros(2)
    unsettled = False

    def __init__(self, frame_rate_hz: float, mask: LumaArray | None = None) -> None:
        self._subtractor = cv2.createBackgroundSubtractorMOG2(
            history=round(500 * frame_rate_hz / 30), varThreshold=16, detectShadows=False
        )
        self._mask = mask
        self._opening = np.ones((2, 2), np.uint8)

    def look(self, luma: LumaArray) -> FloatArray:
        """The candidates (n, cand.N_COLUMNS) of a picture (height, width)."""
        foreground = cv2.morphologyEx(self._subtractor.apply(luma), cv2.MORPH_OPEN, self._opening)
        if self._mask is not None:
            foreground[self._mask == 0] = 0
        _, _, boxes, centres = cv2.connectedComponentsWithStats(foreground)
        boxes, centres = boxes[1:], centres[1:]
        area, side = boxes[:, cv2.CC_STAT_AREA], boxes[:, cv2.CC_STAT_WIDTH : cv2.CC_STAT_HEIGHT + 1].max(axis=1)
        kept = np.flatnonzero((area >= _MIN_AREA) & (side <= _MAX_SIDE))
        kept = kept[np.argsort(-area[kept])][:_MAX_CANDIDATES]
        boxes, centres = boxes[kept], centres[kept]
        out = np.zeros((len(kept), cand.N_COLUMNS))
        out[:, [cand.X, cand.Y]] = centres
        out[:, cand.SIZE] = np.sqrt(boxes[:, cv2.CC_STAT_AREA])
        out[:, cand.SIGMA] = np.hypot(0.5, 0.1 * out[:, cand.SIZE])
        out[:, cand.WIDTH], out[:, cand.HEIGHT] = boxes[:, cv2.CC_STAT_WIDTH], boxes[:, cv2.CC_STAT_HEIGHT]
        out[:, cand.CONTRAST] = [_contrast(luma, box) for box in boxes]
        out[:, cand.EDGE], out[:, cand.ISOLATED] = 2.0, 1.0
        out[:, cand.CHANGE] = out[:, cand.STANDING] = _SURE
        out[:, cand.NOVELTY] = 1.0
        return out

    def seek(
        self, xy_px: FloatArray, radius_px: float, contrast: float, size_px: float, least_change: float
    ) -> FloatArray | None:
        """Nothing: what the mask does not show is not found."""

    def learn(self, sure_px: FloatArray, unsure_px: FloatArray) -> None:
        """The mixture learns while it looks."""


def _contrast(luma: LumaArray, box: np.ndarray) -> float:
    """Mean of a box minus that of its surroundings, in luma codes."""
    x, y, w, h = box[:4]
    around = luma[max(y - h, 0) : y + 2 * h, max(x - w, 0) : x + 2 * w].astype(float)
    inside = luma[y : y + h, x : x + w].astype(float)
    rest = around.size - inside.size
    return float(inside.mean() - (around.sum() - inside.sum()) / rest) if rest else 0.0
