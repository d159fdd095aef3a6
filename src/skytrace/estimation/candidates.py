"""Candidate offsets of a pair: every offset is scored, the best are screened and verified by five-point poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skytrace.estimation import two_view
from skytrace.estimation.correspond import ImagePath, common_grid
from skytrace.estimation.offset_search import ShiftScores, peaks, score_shifts, turn_rate_correlation
from skytrace.estimation.robust_search import robust_scores
from skytrace.estimation.sync_settings import SyncSettings
from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import Rigid

_FREE_S = 5.0  # seconds of any two tracks that some geometry, offset and rate explain
_BEST_MISS = 0.05  # short overlaps of slow flight may fit perfectly: better than this says nothing
_MOST_SCORED = 1500  # shifts that are scored robustly


@dataclass(frozen=True, eq=False, slots=True)
class Candidate:
    """Camera time 1 = offset_s + camera time 0, inside a window of camera 0's time, with a pose that fits there."""

    offset_s: float
    camera1_from_camera0: Rigid
    window_s: tuple[float, float]
    rank: float

    @property
    def centre_s(self) -> float:
        return 0.5 * (self.window_s[0] + self.window_s[1])


def ranked_candidates(path0: ImagePath, path1: ImagePath, settings: SyncSettings, *, thorough: bool) -> list[Candidate]:
    """Offsets with the support of many seconds, best first.

    Offsets that the searches take for likely are screened by a hasty RANSAC and the best of them verified by a thorough
    one. Unless `thorough`, only the few likeliest offsets of the fast searches are tried, and no windows.
    """
    found = []
    windows = search_windows(path0, path1, settings) if thorough else [(path0.begin_s, path0.end_s)]
    for window in windows:
        part = path0.clipped(*window)
        offsets = likely_offsets(part, path1, settings, thorough=thorough)
        hasty = [
            _supported(part, path1, o, window, settings.screen_samples, settings.screen_iterations, settings)
            for o in _apart(offsets, 0.5 * settings.screen_separation_s)
        ]
        best = sorted((c for c in hasty if c is not None), key=lambda c: -c.rank)[: settings.verified]
        for c in best:
            sure = _supported(
                part, path1, c.offset_s, window, settings.verify_samples, settings.verify_iterations, settings
            )
            if sure is not None:
                found.append(sure)
    return sorted(found, key=lambda c: -c.rank)


def search_windows(path0: ImagePath, path1: ImagePath, settings: SyncSettings) -> list[tuple[float, float]]:
    """The whole of camera 0's time and, of long recordings, some windows: short enough for any clock's rate."""
    whole = (path0.begin_s, path0.end_s)
    length, window = min(path0.end_s - path0.begin_s, path1.end_s - path1.begin_s), settings.window_s
    if length <= 2 * window:
        return [whole]
    number = min(settings.most_windows, int((whole[1] - whole[0]) // window))
    centres = np.linspace(whole[0] + 0.5 * window, whole[1] - 0.5 * window, number)
    inside = [(float(c) - 0.5 * window, float(c) + 0.5 * window) for c in centres]
    seen = [path0.clipped(*w).seen_s for w in inside]
    return [whole, *(w for w, s in zip(inside, seen, strict=True) if s >= settings.min_overlap_s)]


def likely_offsets(path0: ImagePath, path1: ImagePath, settings: SyncSettings, *, thorough: bool) -> list[float]:
    """The best offsets of each of the searches, each at least a fraction of a second from the others."""
    rate = settings.rate_hz
    (begin0, xy0), (begin1, xy1) = common_grid([path0, path1], rate)
    if not (np.isfinite(xy0).any() and np.isfinite(xy1).any()):
        return []
    apart, distinct = max(1, round(settings.screen_separation_s * rate)), round(settings.distinct_s * rate)
    least_squares = score_shifts(xy0, xy1, rate, settings.min_overlap_s)
    if not len(least_squares.shift):
        return []
    turns = turn_rate_correlation(xy0, xy1, rate, settings.min_overlap_s)
    if thorough:
        robust = _robustly(xy0, xy1, least_squares, apart, settings)
        searches = [
            (robust, settings.candidates, apart),
            (least_squares, settings.candidates, apart),
            (turns, settings.turn_candidates, distinct),
        ]
    else:
        searches = [
            (least_squares, settings.first_candidates, distinct),
            (turns, settings.first_candidates // 4, distinct),
        ]
    offsets: list[float] = []
    for scores, count, separation in searches:
        best = peaks(scores.score, scores.shift, count, separation)
        offsets += [float(s) for s in scores.shift[best] / rate + (begin1 - begin0)]
    return offsets


def _robustly(xy0: FloatArray, xy1: FloatArray, scores: ShiftScores, apart: int, settings: SyncSettings) -> ShiftScores:
    """Robust scores on a grid of shifts, of the more likely ones where there are too many."""
    grid = np.arange(0, len(scores.shift), apart)
    if len(grid) > _MOST_SCORED:
        grid = np.sort(grid[np.argsort(-scores.score[grid])[:_MOST_SCORED]])
    return robust_scores(xy0, xy1, scores.shift[grid], settings.rate_hz)


def _apart(offsets: Sequence[float], separation_s: float) -> list[float]:
    """Offsets without those close to an earlier one."""
    taken: list[float] = []
    for offset in offsets:
        if all(abs(offset - other) >= separation_s for other in taken):
            taken.append(offset)
    return taken


def _supported(
    path0: ImagePath,
    path1: ImagePath,
    offset_s: float,
    window_s: tuple[float, float],
    samples: int,
    iterations: int,
    settings: SyncSettings,
) -> Candidate | None:
    """An offset with its best pose, ranked by the seconds of support over what chance would give."""
    rate, threshold = settings.rate_hz, settings.verify_threshold
    time0 = two_view.common_times(path0, path1, rate, offset_s, 1.0)
    pairs = two_view.correspond_at(path0, path1, two_view.evenly(time0, samples), offset_s, 1.0)
    pose = two_view.five_point_pose(pairs, threshold, seed=0, max_samples=iterations, min_samples=iterations // 2)
    if pose is None:
        return None
    miss = 1 - float(two_view.support(pose, pairs, threshold).mean())
    rank = -(len(time0) / rate - _FREE_S) * float(np.log(max(miss, _BEST_MISS)))
    return Candidate(offset_s, pose, window_s, rank)
