"""The chosen offset of a pair, refined from several starts to sub-frame, and how far it can be trusted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from skytrace.estimation import two_view
from skytrace.estimation.confidence import EVIDENCE_PER_NAT, confidence
from skytrace.estimation.correspond import ImagePath
from skytrace.estimation.pair_modes import PairMode
from skytrace.estimation.sync_settings import SyncSettings
from skytrace.geometry.rigid import Rigid


@dataclass(frozen=True, eq=False, slots=True)
class RefinedPair:
    """Geometry and clocks of a pair at one mode.

    `confidence` is the probability that the offset is right to a frame, hints considered, `rival_evidence` that for the
    pair's best other mode, `support` the share of the overlap that obeys the geometry. `blind_confidence` is what the
    tracks alone would give.
    """

    geometry: two_view.PairGeometry
    evidence: float
    rival_evidence: float
    confidence: float
    blind_confidence: float | None = None  # none: no hint was given

    @property
    def support(self) -> float:
        return self.geometry.support_s / max(self.geometry.overlap_s, 1e-9)


def refine_mode(
    path0: ImagePath, path1: ImagePath, mode: PairMode, rivals: Sequence[PairMode], settings: SyncSettings
) -> RefinedPair | None:
    """Refine a mode; None where nothing is left of it.

    False detections and slow flight leave local optima some frames apart, so five-point poses at offsets and rates
    around the mode start refinements of their own, and the best are refined once more on all samples. Where these end
    in different places and fit alike, deviation and confidence tell so.
    """
    optima = [mode.geometry]
    for offset_s, rate, pose in _starts(path0, path1, mode.geometry, settings):
        found = two_view.refine(
            path0,
            path1,
            pose,
            offset_s,
            rate,
            rate_hz=settings.rate_hz,
            thresholds=settings.refine_thresholds,
            rate_prior=settings.rate_prior,
            max_samples=settings.mode_samples,
            iterations=8,
            nominal_rate=1.0,
        )
        if found is not None:
            optima.append(found)
    ends = _distinct_ends(path0, path1, optima, settings)
    if not ends:
        return None
    # Where the fit is best its residuals' correlation is their own, not that of a wrong offset.
    correlated = max(ends, key=_fit).inflation
    ends = [end for end in (_to_the_end(path0, path1, end, settings, correlated) for end in ends) if end is not None]
    if not ends:
        return None
    nats = _likelihoods(ends, correlated, settings)
    final = ends[int(np.argmax(nats))]
    spread_s, within = ambiguity(final, ends, nats)
    deviation = float(np.sqrt(final.offset_sigma_s**2 + _READOUT_SIGMA_S**2 + spread_s**2))
    rival = max((r.evidence for r in rivals), default=0.0)
    sure, blind = _confidences(mode, rivals, final)
    return RefinedPair(
        replace(final, offset_sigma_s=deviation),
        mode.evidence,
        rival,
        sure * within,
        None if blind is None else blind * within,
    )


def _confidences(
    mode: PairMode, rivals: Sequence[PairMode], final: two_view.PairGeometry
) -> tuple[float, float | None]:
    """Confidence in a mode, and what it would be without hints; none where there are no hints."""
    support = final.support_s / max(final.overlap_s, 1e-9)
    rival = max((r.evidence for r in rivals), default=0.0)
    sure = confidence(mode.evidence, rival, support, final.overlap_s, mode.hinted_nats)
    if not any(m.hinted_nats for m in (mode, *rivals)):
        return sure, None
    own, *others = (m.evidence - EVIDENCE_PER_NAT * m.hinted_nats for m in (mode, *rivals))
    return sure, confidence(own, max(others, default=0.0), support, final.overlap_s)


def _distinct_ends(
    path0: ImagePath, path1: ImagePath, optima: Sequence[two_view.PairGeometry], settings: SyncSettings
) -> list[two_view.PairGeometry]:
    """The best optima refined on all samples, as far as they end in different places."""
    ends: list[two_view.PairGeometry] = []
    best = max(map(_fit, optima))
    for start in sorted(optima, key=_fit, reverse=True):
        if len(ends) == _MOST_ENDS or _fit(start) < best - 3 * EVIDENCE_PER_NAT:
            break
        if any(abs(_shift_s(end, start)) <= max(3 * end.offset_sigma_s, _SAME_S) for end in ends):
            continue
        end = _to_the_end(path0, path1, start, settings)
        if end is not None:
            ends.append(end)
    return ends


def _to_the_end(
    path0: ImagePath,
    path1: ImagePath,
    start: two_view.PairGeometry,
    settings: SyncSettings,
    residuals_per_independent: float = 1.0,
) -> two_view.PairGeometry | None:
    """Refined on all samples."""
    return two_view.refine(
        path0,
        path1,
        start.camera1_from_camera0,
        start.offset_s,
        start.rate,
        rate_hz=settings.rate_hz,
        thresholds=settings.refine_thresholds[-1:],
        rate_prior=settings.rate_prior,
        nominal_rate=1.0,
        adapt=True,
        residuals_per_independent=residuals_per_independent,
    )


def _shift_s(geometry: two_view.PairGeometry, other: two_view.PairGeometry) -> float:
    """How much later `other` is in camera 1, in the middle of the overlap."""
    middle = geometry.centre_s
    return (other.offset_s + other.rate * middle) - (geometry.offset_s + geometry.rate * middle)


def ambiguity(
    final: two_view.PairGeometry, ends: Sequence[two_view.PairGeometry], nats: Sequence[float]
) -> tuple[float, float]:
    """How far other optima that fit nearly as well lie from the one chosen, and the share of those within a frame.

    The root mean square of their distances in seconds, each with its likelihood, of which `nats` are the logarithms.
    """
    weight = np.exp(np.asarray(nats) - max(nats))
    distance = np.array([_shift_s(final, g) for g in ends])
    spread_s = float(np.sqrt((weight * distance**2).sum() / weight.sum()))
    return spread_s, float(weight[np.abs(distance) <= _FRAME_S].sum() / weight.sum())


def _likelihoods(
    ends: Sequence[two_view.PairGeometry], residuals_per_independent: float, settings: SyncSettings
) -> list[float]:
    """Logarithms of how likely the ends are, clock rates considered, up to a constant."""
    independent_hz = settings.rate_hz / residuals_per_independent
    prior = [float(np.log1p(((g.rate - 1) / settings.rate_prior) ** 2)) for g in ends]
    return [-g.overlap_s * independent_hz * g.misfit - p for g, p in zip(ends, prior, strict=True)]


_MOST_ENDS = 3
_SAME_S = 0.003
_FRAME_S = 1 / 30
_READOUT_SIGMA_S = 7e-4  # what the unknown readout times leave


def _fit(geometry: two_view.PairGeometry) -> float:
    return geometry.overlap_s * (6.5 - geometry.misfit)


def _starts(
    path0: ImagePath, path1: ImagePath, mode: two_view.PairGeometry, settings: SyncSettings
) -> list[tuple[float, float, Rigid]]:
    """Offsets, rates and poses around a mode: its own, and for each of some clock rates the shift that fits best.

    Offset and rate are explored together, for a wrong rate is half made up for by a wrong offset and pose.
    """
    starts = [(mode.offset_s, mode.rate, mode.camera1_from_camera0)]
    for rate in _RATES:
        best: tuple[float, tuple[float, float, Rigid] | None] = (np.inf, None)
        for shift in _SHIFTS_S:
            offset_s = mode.offset_s + shift + (mode.rate - rate) * mode.centre_s
            pairs = two_view.correspond(path0, path1, settings.rate_hz, offset_s, rate, settings.verify_samples)
            pose = two_view.five_point_pose(
                pairs,
                settings.refine_thresholds[0],
                seed=0,
                max_samples=settings.sharpen_iterations,
                min_samples=settings.sharpen_iterations // 2,
            )
            if pose is not None:
                best = min(best, (two_view.misfit(pose, pairs), (offset_s, rate, pose)), key=lambda b: b[0])
        if best[1] is not None:
            starts.append(best[1])
    return starts


_SHIFTS_S = (0.0, -0.07, 0.07, -0.15, 0.15)
_RATES = (1.0, 0.9985, 1.0015)
