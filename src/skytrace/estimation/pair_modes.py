"""The offsets at which two image paths are views of one flight, each refined, with the evidence for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from skytrace.estimation import two_view
from skytrace.estimation.candidates import Candidate, ranked_candidates
from skytrace.estimation.confidence import confidence
from skytrace.estimation.correspond import ImagePath
from skytrace.estimation.motion_shape import sampled_shape
from skytrace.estimation.sync_settings import SyncSettings
from skytrace.geometry.rigid import Rigid


@dataclass(frozen=True, eq=False, slots=True)
class PairMode:
    """A candidate offset of a pair.

    `evidence` is the overlap in seconds times how much better the pair fits than unrelated tracks would: the drop of
    the mean logarithmic loss (`two_view.misfit`) below its level by chance. It includes what hints add to it, of which
    `hinted_nats` is the logarithm of the odds.
    """

    geometry: two_view.PairGeometry
    evidence: float
    hinted_nats: float = 0.0

    @property
    def offset_s(self) -> float:
        """Camera time 1 less camera time 0 in the middle of the overlap."""
        return self.geometry.offset_s + (self.geometry.rate - 1) * self.geometry.centre_s


def find_modes(path0: ImagePath, path1: ImagePath, settings: SyncSettings, rate: float = 1.0) -> list[PairMode]:
    """The plausible offsets of a pair, best first, at least `distinct_s` apart.

    The candidates of `ranked_candidates` are refined together with the clock rate, and ranked by how well they then
    fit. Where the likeliest ones leave a doubt, many more are tried.
    """
    found: list[two_view.PairGeometry] = []
    modes: list[PairMode] = []
    for thorough in (False, True):
        most = len(found) + (settings.modes if thorough else settings.first_modes)
        for candidate in ranked_candidates(path0, path1, settings, thorough=thorough):
            if any(abs(_offset_at(g, candidate.centre_s) - candidate.offset_s) < settings.tolerance_s for g in found):
                continue
            geometry = _refined(path0, path1, candidate, rate, settings)
            if geometry is not None and geometry.overlap_s >= settings.min_mode_overlap_s:
                found.append(geometry)
            if len(found) == most:
                break
        modes = weigh(path0, path1, found, settings)
        if _convincing(modes, settings):
            break
    return modes


def _convincing(modes: Sequence[PairMode], settings: SyncSettings) -> bool:
    """Whether the best mode leaves no doubt."""
    if not modes:
        return False
    rival = modes[1].evidence if len(modes) > 1 else 0.0
    best = modes[0].geometry
    share = best.support_s / max(best.overlap_s, 1e-9)
    return confidence(modes[0].evidence, rival, share, best.overlap_s) >= settings.convincing


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

    Slow and straight flight fit some geometry whatever is paired; their fit by chance is as good as any, which leaves
    no evidence. Where the target hovers or keeps to a straight line all along, time runs only one way along it, so
    running backwards is no test: it counts as fitting perfectly by chance.
    """
    pairs = two_view.correspond(
        path0, path1, settings.rate_hz, geometry.offset_s, geometry.rate, settings.verify_samples
    )
    shapes = [sampled_shape(xy) for xy in (pairs.xy0, pairs.xy1)]
    if min(s.extent for s in shapes) < settings.min_extent or min(s.bend for s in shapes) < settings.min_bend:
        return 0.0
    backwards = replace(pairs, xy1=pairs.xy1[::-1])
    pose = two_view.five_point_pose(
        backwards, settings.mode_thresholds[-1], seed=0, max_samples=settings.verify_iterations, min_samples=50
    )
    return _LARGEST_CHANCE if pose is None else min(two_view.misfit(pose, backwards), _LARGEST_CHANCE)


_LARGEST_CHANCE = 6.8  # the loss of errors that all saturate
_FREE_S = 5.0  # seconds of any two tracks that some geometry, offset and rate explain


def _offset_at(geometry: two_view.PairGeometry, time0_s: float) -> float:
    """Camera time 1 less camera time 0 at camera 0's time."""
    return geometry.offset_s + (geometry.rate - 1) * time0_s


def _refined(
    path0: ImagePath, path1: ImagePath, candidate: Candidate, rate: float, settings: SyncSettings
) -> two_view.PairGeometry | None:
    """A candidate refined in its window, which is then widened until it holds the whole overlap."""
    begin, end = candidate.window_s
    offset_s, pose = _sharpened(path0.clipped(begin, end), path1, candidate, rate, settings)
    nominal = rate
    while True:
        whole = begin <= path0.begin_s and end >= path0.end_s
        geometry = two_view.refine(
            path0.clipped(begin, end),
            path1,
            pose,
            offset_s,
            rate,
            rate_hz=settings.rate_hz,
            thresholds=settings.mode_thresholds,
            rate_prior=settings.rate_prior,
            max_samples=settings.mode_samples,
            iterations=settings.mode_iterations,
            nominal_rate=nominal,
        )
        if geometry is None or whole:
            return geometry
        pose, offset_s, rate = geometry.camera1_from_camera0, geometry.offset_s, geometry.rate
        begin, end = begin - 0.5 * (end - begin), end + 0.5 * (end - begin)


_SHIFTS_S = (0.0, -0.1, 0.1, -0.2, 0.2, -0.3, 0.3)  # around a candidate: as far as the next one may be


def _sharpened(
    path0: ImagePath, path1: ImagePath, candidate: Candidate, rate: float, settings: SyncSettings
) -> tuple[float, Rigid]:
    """The offset near a candidate, with its pose, that fits best without any refinement.

    False detections leave local optima some frames apart, in which a descent from the candidate itself would end.
    """
    best = (np.inf, candidate.offset_s, candidate.camera1_from_camera0)
    for shift in _SHIFTS_S:
        offset_s = candidate.offset_s + shift
        pairs = two_view.correspond(path0, path1, settings.rate_hz, offset_s, rate, settings.verify_samples)
        pose = two_view.five_point_pose(
            pairs,
            settings.mode_thresholds[-1],
            seed=0,
            max_samples=settings.sharpen_iterations,
            min_samples=settings.sharpen_iterations // 2,
        )
        if pose is not None:
            best = min(best, (two_view.misfit(pose, pairs), offset_s, pose), key=lambda b: b[0])
    return best[1], best[2]
