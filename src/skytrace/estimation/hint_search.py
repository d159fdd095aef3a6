"""The offsets of a pair in the light of hints: searched where they point, and weighed by what they say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from skytrace.estimation import two_view
from skytrace.estimation.confidence import EVIDENCE_PER_NAT
from skytrace.estimation.correspond import ImagePath, common_grid
from skytrace.estimation.hints import PairHint
from skytrace.estimation.offset_search import peaks, score_shifts, turn_rate_correlation
from skytrace.estimation.pair_modes import PairMode, weigh
from skytrace.estimation.sync_settings import SyncSettings

_REACH = 3.0  # deviations searched on either side of a hint
_PEAKS = 4  # of each search, in that reach


def hinted_modes(
    path0: ImagePath, path1: ImagePath, hints: Sequence[PairHint], blind: Sequence[PairMode], settings: SyncSettings
) -> list[PairMode]:
    """The modes of a blind search and those around the hints, best first, with the evidence that hints add.

    Near a hint even overlaps count that are too short for the blind search. What the tracks speak against stays so.
    """
    if not hints:
        return list(blind)
    span_s = searched_span_s(path0, path1)
    near = (_mode_geometry(path0, path1, o, settings) for o in _offsets_to_try(path0, path1, hints, settings))
    modes: list[PairMode] = []
    for mode in sorted(
        [*blind, *weigh(path0, path1, [g for g in near if g is not None], settings)], key=lambda m: -m.evidence
    ):
        if all(abs(mode.offset_s - other.offset_s) >= settings.distinct_s for other in modes):
            modes.append(mode)
    return sorted((favoured(mode, hints, span_s) for mode in modes), key=lambda m: -m.evidence)


def favoured(mode: PairMode, hints: Sequence[PairHint], span_s: float) -> PairMode:
    """A mode with the evidence of the hint that suits it best; hints that agree are seldom independent.

    It gains no more than the tracks say themselves: where they fit at any offset, their offset is none to believe.
    """
    if mode.evidence <= 0 or not hints:
        return mode
    time0_s = mode.geometry.centre_s
    nats = max(h.favour(time0_s, time0_s + mode.offset_s, span_s) for h in hints)
    nats = min(nats, mode.evidence / EVIDENCE_PER_NAT)
    return replace(mode, evidence=mode.evidence + EVIDENCE_PER_NAT * nats, hinted_nats=nats)


def searched_span_s(path0: ImagePath, path1: ImagePath) -> float:
    """Length of the range of offsets at which two paths overlap."""
    return (path0.end_s - path0.begin_s) + (path1.end_s - path1.begin_s)


def middle_of_overlap(path0: ImagePath, path1: ImagePath, hint: PairHint) -> float | None:
    """Camera time 0 in the middle of what both filmed, if the hint is right; None where that is nothing."""
    begin = max(path0.begin_s, (path1.begin_s - hint.offset_s) / hint.rate)
    end = min(path0.end_s, (path1.end_s - hint.offset_s) / hint.rate)
    return 0.5 * (begin + end) if end > begin else None


def _offsets_to_try(
    path0: ImagePath, path1: ImagePath, hints: Sequence[PairHint], settings: SyncSettings
) -> list[float]:
    """Camera time 1 less camera time 0: where the hints point, and around vague ones the best of the searches."""
    offsets: list[float] = []
    for hint in hints:
        middle_s = middle_of_overlap(path0, path1, hint)
        if middle_s is None:
            continue
        offset_s, reach_s = hint.time1_s(middle_s) - middle_s, _REACH * hint.sigma_at(middle_s)
        offsets.append(offset_s)
        if reach_s > settings.distinct_s:
            offsets += _peaks_within(path0, path1, offset_s, reach_s, settings)
    apart: list[float] = []
    for offset_s in offsets:
        if all(abs(offset_s - other) >= settings.tolerance_s for other in apart):
            apart.append(offset_s)
    return apart


def _peaks_within(
    path0: ImagePath, path1: ImagePath, offset_s: float, reach_s: float, settings: SyncSettings
) -> list[float]:
    rate_hz = settings.rate_hz
    (begin0, xy0), (begin1, xy1) = common_grid([path0, path1], rate_hz)
    found: list[float] = []
    for search in (score_shifts, turn_rate_correlation):
        scores = search(xy0, xy1, rate_hz, settings.min_mode_overlap_s)
        inside = abs(scores.shift / rate_hz + (begin1 - begin0) - offset_s) <= reach_s
        shift = scores.shift[inside]
        best = peaks(scores.score[inside], shift, _PEAKS, round(settings.distinct_s * rate_hz))
        found += [float(s) / rate_hz + (begin1 - begin0) for s in shift[best]]
    return found


def _mode_geometry(
    path0: ImagePath, path1: ImagePath, offset_s: float, settings: SyncSettings
) -> two_view.PairGeometry | None:
    """The pair's geometry refined from an offset; None where too little supports one."""
    pairs = two_view.correspond(path0, path1, settings.rate_hz, offset_s, 1.0, settings.verify_samples)
    pose = two_view.five_point_pose(
        pairs, settings.verify_threshold, seed=0, max_samples=settings.verify_iterations, min_samples=50
    )
    if pose is None:
        return None
    geometry = two_view.refine(
        path0,
        path1,
        pose,
        offset_s,
        1.0,
        rate_hz=settings.rate_hz,
        thresholds=settings.mode_thresholds,
        rate_prior=settings.rate_prior,
        max_samples=settings.mode_samples,
        iterations=settings.mode_iterations,
    )
    return geometry if geometry is not None and geometry.overlap_s >= settings.min_mode_overlap_s else None
