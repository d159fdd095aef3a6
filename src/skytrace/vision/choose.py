"""Which of the tracks are the target's: the longest consistent set."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skytrace.vision.found import FoundTrack

_OVERLAP = 0.1  # share of the shorter track during which two pieces of one may run apart
_BESIDE = 3.0  # sizes; two parts of one thing are no farther apart
_SIZE_FACTOR = 3.0  # by which the target's size may change from one piece to the next
_CONTRAST_FACTOR = 4.0
_SPEED = 1.0  # widths/s, the most it can travel unseen
_FREE_S = 5.0  # after which it may come back anywhere


def choose_target(tracks: Sequence[FoundTrack], width_px: int, frame_rate_hz: float) -> frozenset[int]:
    """Ids of the tracks taken as the target's; none of no tracks.

    Of all sequences of tracks that follow one another and could be one thing seen again - alike in size and contrast,
    within reach of each other - the one with the most detections, each counted by its track's quality.
    """
    order = sorted(tracks, key=lambda t: (int(t.frame[0]), int(t.frame[-1]), t.track_id))
    best = [len(t) * t.quality for t in order]
    before: list[int | None] = [None] * len(order)
    for k, track in enumerate(order):
        own = best[k]
        for i in range(k):
            if best[i] + own > best[k] and _continues(order[i], track, width_px, frame_rate_hz):
                best[k], before[k] = best[i] + own, i
    chosen: set[int] = set()
    k = int(np.argmax(best)) if order else None
    while k is not None:
        chosen.add(order[k].track_id)
        k = before[k]
    return frozenset(chosen)


def _continues(first: FoundTrack, second: FoundTrack, width_px: int, frame_rate_hz: float) -> bool:
    """Whether the second track can be the first one's thing, seen again or in another part."""
    size = max(first.size_px, second.size_px)
    # Against the sky and against trees one thing can be dark and bright.
    dark, bright = sorted((abs(first.contrast), abs(second.contrast)))
    if size > _SIZE_FACTOR * min(first.size_px, second.size_px) or bright > _CONTRAST_FACTOR * max(dark, 1.0):
        return False
    if second.frame[0] <= first.frame[-1]:
        _, i, k = np.intersect1d(first.frame, second.frame, return_indices=True)
        apart = np.hypot(*(first.xy_px[i] - second.xy_px[k]).T) > _BESIDE * size
        return bool(apart.sum() <= _OVERLAP * min(len(first), len(second)))
    gap_s = (second.frame[0] - first.frame[-1]) / frame_rate_hz
    way = np.hypot(*(second.xy_px[0] - first.xy_px[-1]))
    return bool(gap_s > _FREE_S or way <= _SPEED * width_px * gap_s + _BESIDE * size)
