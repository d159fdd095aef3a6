"""The chosen offset of a pair, refined from several starts to sub-frame, and how far it can be trusted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from skytrace.estimation import two_view
from skytrace.estimation.correspond import ImagePath
from skytrace.estimation.pair_modes import PairMode
from skytrace.estimation.sync_settings import SyncSettings
from skytrace.geometry.rigid import Rigid


@dataclass(frozen=True, eq=False, slots=True)
class RefinedPair:
    """Geometry and clocks of a pair at one mode.

    `confidence` is the probability that the offset is right to a frame, `contrast` the mode's evidence over that for
    the pair's best other mode, `support` the share of the overlap that obeys the geometry.
    """

    geometry: two_view.PairGeometry
    evidence: float
    contrast: float
    confidence: float

    @property
    def support(self) -> float:
        return self.geometry.support_s / max(self.geometry.overlap_s, 1e-9)


def refine_mode(
    path0: ImagePath, path1: ImagePath, mode: PairMode, rivals: Sequence[PairMode], settings: SyncSettings
) -> RefinedPair | None:
    """Refine a mode; None where nothing is left of it.

    False detections and slow flight leave local optima some frames apart, so five-point poses at offsets and rates
    around the mode start refinements of their own, and the best fit is refined once more on all samples.
    """
    best = mode.geometry
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
        if found is not None and _fit(found) > _fit(best):
            best = found
    final = two_view.refine(
        path0,
        path1,
        best.camera1_from_camera0,
        best.offset_s,
        best.rate,
        rate_hz=settings.rate_hz,
        thresholds=settings.refine_thresholds[-1:],
        rate_prior=settings.rate_prior,
        nominal_rate=1.0,
        adapt=True,
    )
    if final is None:
        return None
    deviation = float(np.hypot(final.offset_sigma_s, _READOUT_SIGMA_S))
    rival = max((r.evidence for r in rivals), default=0.0)
    return RefinedPair(
        replace(final, offset_sigma_s=deviation),
        mode.evidence,
        mode.evidence / max(rival, 1e-9),
        confidence(mode.evidence, rival, final.support_s / max(final.overlap_s, 1e-9), final.overlap_s),
    )


_READOUT_SIGMA_S = 7e-4  # what the unknown readout times leave
_SHIFTS_S = (0.0, -0.15, 0.15, -0.4, 0.4)
_RATE_SHIFTS = (-2e-3, 2e-3)


def _fit(geometry: two_view.PairGeometry) -> float:
    return geometry.overlap_s * (6.5 - geometry.misfit)


def _starts(
    path0: ImagePath, path1: ImagePath, mode: two_view.PairGeometry, settings: SyncSettings
) -> list[tuple[float, float, Rigid]]:
    """Offsets, rates and poses around a mode: its own, then those that fit best without any refinement."""
    around = [(s, 0.0) for s in _SHIFTS_S] + [(0.0, r) for r in _RATE_SHIFTS]
    tried: list[tuple[float, tuple[float, float, Rigid]]] = []
    for shift, change in around:
        rate = mode.rate + change
        offset_s = mode.offset_s + shift - change * mode.centre_s
        pairs = two_view.correspond(path0, path1, settings.rate_hz, offset_s, rate, settings.verify_samples)
        pose = two_view.five_point_pose(
            pairs, settings.refine_thresholds[0], seed=0, max_samples=settings.verify_iterations, min_samples=50
        )
        if pose is not None:
            tried.append((two_view.misfit(pose, pairs), (offset_s, rate, pose)))
    tried.sort(key=lambda t: t[0])
    return [(mode.offset_s, mode.rate, mode.camera1_from_camera0), *(start for _, start in tried[:_REFINED_STARTS])]


_REFINED_STARTS = 3


def confidence(evidence: float, rival: float, support: float, overlap_s: float) -> float:
    """Probability that a mode is right to a frame, from its evidence, that of the best other mode, and its support.

    A logistic regression on simulated pairs with and without a common view, 450 of them with 15 to 120 s of overlap.
    Overlaps too short to tell flights apart never count as sure, and a figure flown twice, which leaves two modes of
    equal evidence, counts as a choice between them.
    """
    features = confidence_features(evidence, rival, support)
    found = float(1 / (1 + np.exp(-np.clip(features @ _COEFFICIENTS, -30, 30))))
    found /= 1 + float(np.exp(-np.clip((evidence - rival) / _EVIDENCE_PER_NAT, -30, 30)))
    return found if overlap_s >= _SURE_OVERLAP_S else min(found, _UNSURE)


def confidence_features(evidence: float, rival: float, support: float) -> np.ndarray:
    """Constant, logarithms of evidence and contrast above a floor of a few seconds, and support."""
    own, other = max(evidence, 0.0) + _EVIDENCE_FLOOR, max(rival, 0.0) + _EVIDENCE_FLOOR
    return np.array([1.0, np.log(own / _EVIDENCE_FLOOR), np.log(own / other), support])


_EVIDENCE_FLOOR = 20.0
_EVIDENCE_PER_NAT = 8.0  # errors are correlated in time, so evidence comes in larger units
_SURE_OVERLAP_S, _UNSURE = 20.0, 0.85
_COEFFICIENTS = np.array([-19.58, 4.01, 2.13, 15.5])
