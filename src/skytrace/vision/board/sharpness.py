"""Which of a video's pictures are worth looking at: the sharpest of those that follow one another."""

from __future__ import annotations

import cv2
import numpy as np

_LONGEST_PX = 640  # motion blur that matters to corners shows at this size, sensor noise does not


def sharpness(grey: np.ndarray) -> float:
    """How much fine detail a picture (h, w) uint8 shows; to be compared between pictures of one scene only."""
    step = max(1, max(grey.shape) // _LONGEST_PX)
    small = cv2.resize(grey, (grey.shape[1] // step, grey.shape[0] // step), interpolation=cv2.INTER_AREA)
    return float(cv2.Laplacian(small, cv2.CV_32F).var())
