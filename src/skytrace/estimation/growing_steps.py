"""The paper's pairwise synchronisation: from a rough offset, by the eight-point solver over growing time steps.

Li, Murray, Ismaili, Schindler, Albl, "Reconstruction of 3D flight trajectories from ad-hoc camera networks", IROS 2020,
section III-A, after the iteration of Albl et al., "On the two-view geometry of unsynchronized cameras", CVPR 2017.

The solver takes the track of camera 1 for a straight line, (x1(t) + beta v1)^T F x0(t) = 0. With v1 the velocity at t
that holds for shifts of a few frames. With v1 = (x1(t + d) - x1(t)) / d, the chord to where the target is d later, it
holds for shifts up to about d, exactly for beta = d; so d grows, 2^k frames into the future and into the past.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from skytrace.estimation import two_view
from skytrace.estimation.correspond import ImagePath
from skytrace.estimation.hints import Hints
from skytrace.estimation.pair_modes import PairMode, weigh
from skytrace.estimation.sync_settings import SyncSettings
from skytrace.geometry.rigid import Rigid


@dataclass(frozen=True, eq=False, slots=True)
class Iterate:
    """One outcome of the solver: the chord it was given, the shift it found, and what that explains."""

    step_s: float  # of the chord, negative into the past
    shift_s: float
    offset_s: float  # with the shift applied
    pose: Rigid  # camera1_from_camera0
    inlier_share: float  # of the correspondences at the new offset, read off the track and not off the chord


@dataclass(frozen=True, eq=False, slots=True)
class GrowingSteps:
    """What became of a rough offset: the geometry it led to, or why it led to none, and the iterates on the way."""

    geometry: two_view.PairGeometry | None
    iterates: tuple[Iterate, ...]
    failure: str = ""


def synchronise_by_growing_steps(
    path0: ImagePath, path1: ImagePath, offset_s: float, settings: SyncSettings, rng: np.random.Generator
) -> GrowingSteps:
    """Offset, rate and relative pose of a pair from a rough offset (camera time 1 = offset_s + camera time 0).

    Each round keeps the iterate with most inliers and starts again from its offset, until the shift settles or no step
    finds more. The last iterate is refined on the tracks themselves. Offsets beyond the longest step are out of reach
    and end in a failure, as does a refined geometry that less than `min_support` of the overlap obeys.
    """
    kept: list[Iterate] = []
    for _ in range(settings.growing.rounds):
        found = grow_step(path0, path1, offset_s, settings, rng)
        if found is None or (kept and found.inlier_share <= kept[-1].inlier_share):
            break
        kept.append(found)
        offset_s = found.offset_s
        if abs(found.shift_s) <= settings.growing.settled_s:
            break
    if not kept:
        overlap_s = len(two_view.common_times(path0, path1, settings.rate_hz, offset_s, 1.0)) / settings.rate_hz
        return GrowingSteps(None, (), f"no shift of the rough offset explains the {overlap_s:.1f} s in common view")
    geometry = two_view.refine(
        path0,
        path1,
        kept[-1].pose,
        offset_s,
        1.0,
        rate_hz=settings.rate_hz,
        thresholds=settings.mode_thresholds,
        rate_prior=settings.rate_prior,
        max_samples=settings.mode_samples,
    )
    failure = _failure(geometry, settings)
    return GrowingSteps(None if failure else geometry, tuple(kept), failure)


def rough_offsets(camera_ids: Iterable[str], hints: Hints) -> dict[str, float]:
    """The `offset_s` of every camera. Raises ValueError where one has none."""
    ids, given_s = list(camera_ids), hints.offsets_s
    missing = [c for c in ids if c not in given_s]
    if missing:
        raise ValueError(f"hints: expected an offset_s of every camera, got none of {', '.join(missing)}")
    return {c: given_s[c] for c in ids}


def grow_step(
    path0: ImagePath, path1: ImagePath, offset_s: float, settings: SyncSettings, rng: np.random.Generator
) -> Iterate | None:
    """The iterate with most inliers over growing steps; None where no step gives a geometry.

    The steps stop growing at the first whose shift lies inside its chord and explains `min_support` of the overlap:
    longer chords only cut more corners of the track, and shifts beyond shorter ones are stretches of what they show.
    """
    best: Iterate | None = None
    for step_s in steps_s(settings):
        tried = [_iterate(path0, path1, offset_s, signed_s, settings, rng) for signed_s in (step_s, -step_s)]
        found = max((i for i in tried if i is not None), key=lambda i: i.inlier_share, default=None)
        if found is None:
            continue
        if found.inlier_share >= settings.min_support and abs(found.shift_s) <= step_s:
            return found
        if best is None or found.inlier_share > best.inlier_share:
            best = found
    return best


def steps_s(settings: SyncSettings) -> tuple[float, ...]:
    """The lengths of the chords: 2^k frames, shortest first."""
    return tuple(2.0**k * settings.growing.frame_s for k in range(settings.growing.steps))


def chords(
    path0: ImagePath, path1: ImagePath, offset_s: float, step_s: float, settings: SyncSettings
) -> two_view.Correspondences:
    """Correspondences whose velocity in camera 1 is that of the chord to `step_s` later, where it ends on the track."""
    pairs = two_view.correspond(path0, path1, settings.rate_hz, offset_s, 1.0, settings.growing.samples)
    end = path1.evaluate(pairs.time1_s + step_s)
    seen = np.isfinite(end[:, 0])
    xy1 = pairs.xy1[seen]
    return two_view.Correspondences(
        pairs.time0_s[seen], pairs.time1_s[seen], pairs.xy0[seen], xy1, (end[seen] - xy1) / step_s
    )


def rough_modes(
    path0: ImagePath, path1: ImagePath, offset_s: float, settings: SyncSettings, rng: np.random.Generator
) -> list[PairMode]:
    """The one candidate that a rough offset leads to, weighed as those of the search are; none where it fails."""
    found = synchronise_by_growing_steps(path0, path1, offset_s, settings, rng)
    return [] if found.geometry is None else weigh(path0, path1, [found.geometry], settings)


def _iterate(
    path0: ImagePath,
    path1: ImagePath,
    offset_s: float,
    step_s: float,
    settings: SyncSettings,
    rng: np.random.Generator,
) -> Iterate | None:
    pairs = chords(path0, path1, offset_s, step_s, settings)
    if len(pairs) < settings.growing.min_samples:
        return None
    threshold = settings.verify_threshold
    found = two_view.time_shift_pose(
        pairs, threshold, settings.growing.reach * abs(step_s), rng, settings.growing.draws
    )
    if found is None:
        return None
    pose, shift_s = found
    moved = two_view.correspond(path0, path1, settings.rate_hz, offset_s + shift_s, 1.0, settings.growing.samples)
    if len(moved) < settings.growing.min_samples:
        return None
    share = float(two_view.inliers(pose, moved, threshold).mean())
    return Iterate(step_s, shift_s, offset_s + shift_s, pose, share)


def _failure(geometry: two_view.PairGeometry | None, settings: SyncSettings) -> str:
    """Why a refined geometry is not believed, in words; empty where it is."""
    if geometry is None or geometry.overlap_s < settings.min_mode_overlap_s:
        return f"less than {settings.min_mode_overlap_s:g} s in common view are left at the offset found"
    share = geometry.support_s / geometry.overlap_s
    if share < settings.min_support:
        return (
            f"the geometry found explains only {100 * share:.0f} % of {geometry.overlap_s:.1f} s in common view: "
            "the rough offset is out of reach"
        )
    return ""
