"""How fast a camera really ran, where its frame rate as given fits nothing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skytrace.estimation.correspond import ImagePath, common_grid
from skytrace.estimation.offset_search import score_shifts
from skytrace.estimation.sync_settings import SyncSettings


def search_rate(
    path: ImagePath, partners: Sequence[ImagePath], settings: SyncSettings, hinted: Sequence[float] = ()
) -> float | None:
    """By what factor a camera's clock must be stretched so that its track fits a partner's at some offset.

    Serves cameras whose given frame rate is grossly wrong (slow motion, variable rate, a wrong file). The offset search
    stands a stretch of one per cent, so a geometric grid of that step finds it; None where nothing stands out. `hinted`
    are further stretches to try.
    """

    def best_score(factor: float, rate_hz: float) -> float:
        return max(_best_offset_score(path.stretched(factor), partner, rate_hz, settings) for partner in partners)

    coarse = {f: best_score(f, settings.rate_hz / 2) for f in (*settings.rate_factors, *hinted)}
    top = max(coarse, key=lambda f: coarse[f])
    chance = float(np.median(list(coarse.values())))
    if coarse[top] < settings.min_rate_contrast * max(chance, 1e-9):
        return None
    return max(top * np.linspace(0.985, 1.015, 31), key=lambda f: best_score(float(f), settings.rate_hz))


def _best_offset_score(path0: ImagePath, path1: ImagePath, rate_hz: float, settings: SyncSettings) -> float:
    (_, xy0), (_, xy1) = common_grid([path0, path1], rate_hz)
    return float(score_shifts(xy0, xy1, rate_hz, settings.min_overlap_s).score.max(initial=0.0))
