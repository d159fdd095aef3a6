"""The shapes that pixels of cameras and of video formats have."""

from __future__ import annotations

import math

# fy / fx: square pixels; 1440 x 1080 shown as 1920 wide; PAL and NTSC shown as 4:3 and as 16:9.
STANDARD_ASPECTS = (1.0, 4 / 3, 12 / 11, 10 / 11, 16 / 11, 40 / 33)


def standard_aspect(aspect: float, within: float) -> float | None:
    """The standard fy / fx that differs from `aspect` by no more than the share `within`; None if none does."""
    nearest = min(STANDARD_ASPECTS, key=lambda standard: abs(math.log(aspect / standard)))
    return nearest if abs(math.log(aspect / nearest)) <= within else None
