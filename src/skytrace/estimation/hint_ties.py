"""Cameras that the tracks cannot tie in, tied by what was said of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from skytrace.estimation import two_view
from skytrace.estimation.correspond import ImagePath
from skytrace.estimation.hint_search import middle_of_overlap
from skytrace.estimation.hints import PRECISE_S, Hints, PairHint
from skytrace.estimation.pair_modes import PairMode
from skytrace.estimation.pair_refine import RefinedPair
from skytrace.estimation.sync_groups import Measured, TiedGroup, tie_groups
from skytrace.estimation.sync_settings import SyncSettings
from skytrace.geometry.rigid import Rigid

_FITTING = 0.8  # share of what two cameras saw together that must fit a geometry at the hint's offset
_ATTEMPTS = 5
HINT_CONFIDENCE = 0.9  # that a hint which no track confirms is right: less than tracks must reach


@dataclass(frozen=True, eq=False, slots=True)
class HintTie:
    """Cameras i and j tied by a hint alone, with their geometry at its offset where they saw enough together.

    Or not tied, where their tracks object to that.
    """

    i: int
    j: int
    hint: PairHint
    measured: Measured | None
    objected: bool


def join_by_hints(
    groups: Sequence[TiedGroup], paths: Mapping[str, ImagePath], hints: Hints, settings: SyncSettings
) -> tuple[list[TiedGroup], list[HintTie]]:
    """Groups joined, and single cameras added, where a precise hint relates them and their tracks do not object.

    The most precise hints first. The tracks object where both cameras saw the target for long enough to tell and no
    geometry explains most of it. Returns the groups, largest first, and what became of each hint that was tried.
    """
    ids = list(paths)
    parts = list(groups)
    tied = {c for group in groups for c in group.clocks}
    parts += [_single(c) for c in range(len(ids)) if c not in tied]
    offered = [
        (i, j, hint)
        for i, j in combinations(range(len(ids)), 2)
        for hint in hints.between(ids[i], ids[j], settings.rate_prior)
        if hint.sigma_s <= PRECISE_S and not hint.heavy_tail
    ]
    tried: list[HintTie] = []
    for i, j, hint in sorted(offered, key=lambda o: o[2].sigma_s):
        a, b = (next(p for p in parts if c in p.clocks) for c in (i, j))
        if a is b:
            continue
        tried.append(_tie(paths[ids[i]], paths[ids[j]], i, j, hint, settings))
        if not tried[-1].objected:
            joined = _joined(a, b, tried[-1], paths[ids[i]], paths[ids[j]])
            parts = [p for p in parts if p is not a and p is not b] + [joined]
    larger = [p for p in parts if len(p.clocks) > 1]
    return sorted(larger, key=lambda g: (-len(g.clocks), g.reference)), tried


def decided_by_hints(
    measured: Sequence[Measured], groups: Sequence[TiedGroup], settings: SyncSettings
) -> list[Measured]:
    """The pairs of groups that would not be tied without hints, and whose own offsets those decide."""
    if all(m.pair.blind_confidence is None for m in measured):
        return []
    n_cameras = 1 + max(m.j for m in measured)
    blind = tie_groups([_without_hints(m) for m in measured], n_cameras, settings)

    def together(m: Measured, groups: Sequence[TiedGroup]) -> bool:
        return any(m.i in g.clocks and m.j in g.clocks for g in groups)

    return [
        m
        for m in measured
        if together(m, groups) and not together(m, blind) and (m.pair.blind_confidence or 1.0) < m.pair.confidence
    ]


def _without_hints(m: Measured) -> Measured:
    blind = m.pair.blind_confidence
    return m if blind is None else replace(m, pair=replace(m.pair, confidence=blind))


def _single(camera: int) -> TiedGroup:
    return TiedGroup(camera, {camera: (0.0, 1.0)}, {camera: (0.0, 0.0)}, {camera: 1.0}, (), np.zeros(0))


def _tie(path0: ImagePath, path1: ImagePath, i: int, j: int, hint: PairHint, settings: SyncSettings) -> HintTie:
    """The pair at the hint's offset."""
    rate_hz = settings.rate_hz
    pairs = two_view.correspond(path0, path1, rate_hz, hint.offset_s, hint.rate, settings.verify_samples)
    overlap_s = len(two_view.common_times(path0, path1, rate_hz, hint.offset_s, hint.rate)) / rate_hz
    if overlap_s < settings.min_mode_overlap_s:
        return HintTie(i, j, hint, None, objected=False)
    pose, support = _best_pose(pairs, settings.verify_threshold)
    if pose is None or support < _FITTING:
        return HintTie(i, j, hint, None, objected=True)
    centre_s = float(np.median(pairs.time0_s))
    geometry = two_view.PairGeometry(
        pose,
        hint.offset_s,
        hint.rate,
        centre_s,
        support * overlap_s,
        overlap_s,
        hint.sigma_at(centre_s),
        hint.rate_sigma,
        two_view.misfit(pose, pairs),
    )
    refined = RefinedPair(geometry, 0.0, 0.0, HINT_CONFIDENCE)
    return HintTie(i, j, hint, Measured(i, j, PairMode(geometry, 0.0), refined, consistent=True), objected=False)


def _best_pose(pairs: two_view.Correspondences, threshold: float) -> tuple[Rigid | None, float]:
    """The pose with most support, and that: in straight flight many samples are degenerate, hence several attempts."""
    best: tuple[Rigid | None, float] = (None, 0.0)
    for seed in range(_ATTEMPTS):
        pose = two_view.five_point_pose(pairs, threshold, seed)
        share = 0.0 if pose is None else float(two_view.support(pose, pairs, threshold).mean())
        best = max(best, (pose, share), key=lambda found: found[1])
    return best


def _joined(a: TiedGroup, b: TiedGroup, tie: HintTie, path_i: ImagePath, path_j: ImagePath) -> TiedGroup:
    """One group of two, on the clock of the larger."""
    kept, moved = (a, b) if (-len(a.clocks), a.reference) <= (-len(b.clocks), b.reference) else (b, a)
    hint = tie.hint
    # Camera time j = offset + rate * camera time i; each group has world = o + r * camera time.
    if tie.i in kept.clocks:
        anchor, newcomer, rate, offset_s = tie.i, tie.j, 1 / hint.rate, -hint.offset_s / hint.rate
    else:
        anchor, newcomer, rate, offset_s = tie.j, tie.i, hint.rate, hint.offset_s
    o_kept, r_kept = kept.clocks[anchor]
    o_moved, r_moved = moved.clocks[newcomer]
    scale = r_kept * rate / r_moved  # of the moved group's world time
    shift = o_kept + r_kept * offset_s - scale * o_moved
    middle_s = middle_of_overlap(path_i, path_j, hint)
    sigma = hint.sigma_s if middle_s is None else hint.sigma_at(middle_s)
    deviation = np.hypot(kept.deviations[anchor], (sigma, hint.rate_sigma))
    # A reference is as sure as the first tie to it, which says nothing of further ones: they are to its own clock.
    sure = HINT_CONFIDENCE * (1.0 if anchor == kept.reference else kept.confidence[anchor])
    confidence = {**kept.confidence, **{c: sure * p for c, p in moved.confidence.items()}}
    if len(kept.clocks) == 1:
        confidence[kept.reference] = HINT_CONFIDENCE
    pairs = (tie.measured,) if tie.measured is not None else ()
    return TiedGroup(
        kept.reference,
        {**kept.clocks, **{c: (shift + scale * o, scale * r) for c, (o, r) in moved.clocks.items()}},
        {**kept.deviations, **{c: _pair(np.hypot(d, deviation)) for c, d in moved.deviations.items()}},
        confidence,
        (*kept.pairs, *moved.pairs, *pairs),
        np.concatenate([kept.disagreement_s, moved.disagreement_s, np.zeros(len(pairs))]),
    )


def _pair(values: np.ndarray) -> tuple[float, float]:
    return float(values[0]), float(values[1])
