"""The offsets at which two image paths are views of one flight, each refined, with the evidence for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from skytrace.estimation import two_view
from skytrace.estimation.correspond import ImagePath, common_grid
from skytrace.estimation.offset_search import peaks, score_shifts, turn_rate_correlation
from skytrace.estimation.sync_settings import SyncSettings
from skytrace.geometry.rigid import Rigid


@dataclass(frozen=True, eq=False, slots=True)
class PairMode:
    """A candidate offset of a pair.

    `evidence` is the overlap in seconds times how much better the pair fits than unrelated tracks would: the drop of
    the mean logarithmic loss (`two_view.misfit`) below its level by chance.
    """

    geometry: two_view.PairGeometry
    evidence: float

    @property
    def offset_s(self) -> float:
        """Camera time 1 less camera time 0 in the middle of the overlap."""
        return self.geometry.offset_s + (self.geometry.rate - 1) * self.geometry.centre_s


def find_modes(
    path0: ImagePath, path1: ImagePath, hints_s: Sequence[float], settings: SyncSettings, rate: float = 1.0
) -> list[PairMode]:
    """The plausible offsets of a pair, best first, at least `distinct_s` apart.

    Every offset is scored by two searches; their best are ranked by a five-point pose in RANSAC, the best of these
    refined together with the clock rate, and ranked by how well they then fit. `hints_s` are further candidates.
    """
    ranked = _ranked_candidates(path0, path1, hints_s, settings)
    found: list[two_view.PairGeometry] = []
    for offset, pose in ranked[: settings.modes]:
        geometry = two_view.refine(
            path0,
            path1,
            pose,
            offset,
            rate,
            rate_hz=settings.rate_hz,
            thresholds=settings.mode_thresholds,
            rate_prior=settings.rate_prior,
            max_samples=settings.mode_samples,
            iterations=settings.mode_iterations,
        )
        if geometry is not None and geometry.overlap_s >= settings.min_mode_overlap_s:
            found.append(geometry)
    return weigh(path0, path1, found, settings)


def weigh(
    path0: ImagePath, path1: ImagePath, found: Sequence[two_view.PairGeometry], settings: SyncSettings
) -> list[PairMode]:
    """Modes with their evidence, best first; of those closer than `distinct_s` only the best."""
    kept: list[PairMode] = []
    for geometry in sorted(found, key=lambda g: -g.overlap_s * (_LARGEST_CHANCE - g.misfit)):
        mode = PairMode(geometry, 0.0)
        if all(abs(mode.offset_s - k.offset_s) >= settings.distinct_s for k in kept):
            chance = chance_misfit(path0, path1, geometry, settings)
            kept.append(PairMode(geometry, (geometry.overlap_s - _FREE_S) * (chance - geometry.misfit)))
    return sorted(kept, key=lambda m: -m.evidence)


def chance_misfit(path0: ImagePath, path1: ImagePath, geometry: two_view.PairGeometry, settings: SyncSettings) -> float:
    """Loss of a pose fitted to the same overlap with one track run backwards.

    Hovering and straight flight fit some geometry whatever is paired; their fit by chance is as good as any, which
    leaves no evidence.
    """
    pairs = two_view.correspond(
        path0, path1, settings.rate_hz, geometry.offset_s, geometry.rate, settings.verify_samples
    )
    backwards = replace(pairs, xy1=pairs.xy1[::-1])
    pose = two_view.five_point_pose(
        backwards, settings.mode_thresholds[-1], seed=0, max_samples=settings.verify_iterations, min_samples=50
    )
    return _LARGEST_CHANCE if pose is None else min(two_view.misfit(pose, backwards), _LARGEST_CHANCE)


_LARGEST_CHANCE = 6.8  # the loss of errors that all saturate
_FREE_S = 5.0  # seconds of any two tracks that some geometry, offset and rate explain
_BEST_MISS = 0.05  # short overlaps of slow flight may fit perfectly: better than this says nothing


def _ranked_candidates(
    path0: ImagePath, path1: ImagePath, hints_s: Sequence[float], settings: SyncSettings
) -> list[tuple[float, Rigid]]:
    """Candidate offsets with a five-point pose, those with most support in seconds first."""
    rate = settings.rate_hz
    grid0, grid1 = common_grid([path0, path1], rate)
    start = grid1[0] - grid0[0]
    offsets: list[float] = list(hints_s)
    for search, count in ((score_shifts, settings.candidates), (turn_rate_correlation, settings.turn_candidates)):
        scores = search(grid0[1], grid1[1], rate, settings.min_overlap_s)
        best = peaks(scores.score, scores.shift, count, round(settings.distinct_s * rate))
        offsets += [float(s / rate + start) for s in scores.shift[best]]
    ranked: list[tuple[float, float, Rigid]] = []
    taken: list[float] = []
    for offset in offsets:
        if any(abs(offset - other) < 0.25 for other in taken):
            continue
        taken.append(offset)
        sample = two_view.correspond(path0, path1, rate, offset, 1.0, settings.verify_samples)
        pose = two_view.five_point_pose(
            sample, settings.verify_threshold, seed=0, max_samples=settings.verify_iterations, min_samples=50
        )
        if pose is not None:
            miss = 1 - float(two_view.support(pose, sample, settings.verify_threshold).mean())
            overlap_s = len(two_view.common_times(path0, path1, rate, offset, 1.0)) / rate
            ranked.append((-(overlap_s - _FREE_S) * float(np.log(max(miss, _BEST_MISS))), offset, pose))
    ranked.sort(key=lambda r: -r[0])
    return [(offset, pose) for _, offset, pose in ranked]
