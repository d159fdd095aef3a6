"""The first two cameras: the pair whose evidence is best, its geometry, and what it can triangulate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from skytrace.errors import ReconstructionError
from skytrace.estimation import two_view
from skytrace.estimation.correspond import ImagePath
from skytrace.estimation.motion_shape import MOTION_WORDS, image_extent
from skytrace.estimation.scene import N_LENS, CameraState, Scene
from skytrace.estimation.structure import Structure, StructureSettings, triangulate_scene
from skytrace.estimation.synchronize import Synchronisation
from skytrace.geometry.rigid import Rigid
from skytrace.model.reconstruction import TwoView
from skytrace.model.track import Recording


@dataclass(frozen=True, slots=True)
class InitialSettings:
    threshold: float = 0.005  # Sampson error on the plane z = 1
    refine_thresholds: tuple[float, ...] = (0.006, 0.003)
    good_angle_rad: float = 0.35  # parallax beyond which more is no better
    min_angle_rad: float = 0.09  # median parallax of the best pair: below, depth is a guess
    min_support_s: float = 8.0
    min_extent: float = 0.02  # second-largest over largest extent of the flight: below, it is a straight line
    min_image_extent: float = 0.01  # of the image motion on the plane z = 1: below, the target hovers
    rotation_share: float = 0.9  # of the support that a pure rotation may explain


@dataclass(frozen=True, eq=False, slots=True)
class InitialPair:
    """A scene of two cameras with unit baseline, and why it was chosen."""

    scene: Scene
    structure: Structure
    score: float


def initial_pairs(
    synchronisation: Synchronisation,
    paths: Mapping[str, ImagePath],
    recordings: Mapping[str, Recording],
    settings: InitialSettings,
    structure_settings: StructureSettings,
    readout_fraction: float,
) -> list[InitialPair]:
    """All usable initial pairs, best first: triangulated seconds times parallax (up to a good angle).

    Raises ReconstructionError that says which degeneracy rules out every pair.
    """
    found, failures = [], []
    for pair in synchronisation.pairs:
        outcome = _try_pair(pair, synchronisation, paths, recordings, settings, structure_settings, readout_fraction)
        if isinstance(outcome, InitialPair):
            found.append(outcome)
        else:
            failures.append((pair, outcome))
    if not found:
        raise _why_none(failures, settings)
    return sorted(found, key=lambda p: -p.score)


@dataclass(frozen=True, slots=True)
class _Failure:
    reason: str
    value: float


def _try_pair(
    pair: TwoView,
    synchronisation: Synchronisation,
    paths: Mapping[str, ImagePath],
    recordings: Mapping[str, Recording],
    settings: InitialSettings,
    structure_settings: StructureSettings,
    readout_fraction: float,
) -> InitialPair | _Failure:
    path0, path1 = paths[pair.camera0], paths[pair.camera1]
    clock0, clock1 = synchronisation.clocks[pair.camera0], synchronisation.clocks[pair.camera1]
    rate = clock0[1] / clock1[1]
    offset = (clock0[0] - clock1[0]) / clock1[1]
    hz = structure_settings.rate_hz
    pairs = two_view.correspond(path0, path1, hz, offset, rate)
    extent = min(image_extent(pairs.xy0), image_extent(pairs.xy1)) if len(pairs) > 2 else 0.0
    if extent < settings.min_image_extent:
        return _Failure("hover", extent)
    geometry = _pair_pose(pair, path0, path1, pairs, offset, rate, settings, hz)
    if geometry is None:
        return _Failure("support", 0.0)
    # The joint clocks stand; only the pose is taken from the pair.
    share = rotation_share(pairs, geometry, 3 * settings.refine_thresholds[-1])
    if share > settings.rotation_share:
        return _Failure("parallax", share)
    cameras = {
        c: CameraState(pose, clock[0], clock[1], readout_fraction / recordings[c].frame_rate_hz, np.zeros(N_LENS))
        for c, pose, clock in (
            (pair.camera0, Rigid.identity(), clock0),
            (pair.camera1, geometry, clock1),
        )
    }
    scene = Scene(pair.camera0, cameras)
    structure = triangulate_scene(scene, paths, structure_settings)
    seconds = len(structure.time_s) / hz
    if seconds < settings.min_support_s:
        return _Failure("support", seconds)
    angle = float(np.median(structure.angle_rad))
    if angle < settings.min_angle_rad:
        return _Failure("parallax", angle)
    shape = flight_extent(structure)
    if shape < settings.min_extent:
        return _Failure("straight", shape)
    return InitialPair(scene, structure, seconds * min(1.0, angle / settings.good_angle_rad))


def _pair_pose(
    pair: TwoView,
    path0: ImagePath,
    path1: ImagePath,
    pairs: two_view.Correspondences,
    offset: float,
    rate: float,
    settings: InitialSettings,
    hz: float,
) -> Rigid | None:
    """The pose with most support among a fresh five-point estimate and the synchronisation's, both refined."""
    five = two_view.five_point_pose(two_view.thin(pairs, 2000), settings.threshold, seed=0)
    best, best_support = None, 0.0
    for start in (five, pair.camera1_from_camera0):
        if start is None:
            continue
        refined = two_view.refine(
            path0, path1, start, offset, rate, rate_hz=hz, thresholds=settings.refine_thresholds, rate_prior=1e-7
        )
        if refined is not None and refined.support_s > best_support:
            best, best_support = refined.camera1_from_camera0, refined.support_s
    return best


def flight_extent(structure: Structure) -> float:
    """Second-largest over largest extent of the triangulated flight: 0 for a straight line."""
    points = structure.point_in_world
    low, high = np.percentile(points, [2, 98], axis=0)
    inside = ((points >= low) & (points <= high)).all(axis=1)
    centred = points[inside] - points[inside].mean(axis=0)
    extents = np.linalg.svd(centred, compute_uv=False)
    return float(extents[1] / max(extents[0], 1e-300))


def rotation_share(pairs: two_view.Correspondences, pose: Rigid, threshold: float) -> float:
    """How many of a pose's inliers a pure rotation explains as well: cameras in one place leave nothing else."""
    from skytrace.geometry.projection import to_rays
    from skytrace.geometry.rigid import align_similarity

    good = two_view.inliers(pose, pairs, threshold)
    if good.sum() < 10:
        return 0.0
    ray0, ray1 = to_rays(pairs.xy0[good]), to_rays(pairs.xy1[good])
    weight = np.ones(len(ray0))
    error = np.zeros(len(ray0))
    for _ in range(10):
        rotation = align_similarity(ray0, ray1, weight, with_scale=False).rotation
        error = np.linalg.norm(np.cross(ray0 @ rotation.T, ray1), axis=1)
        weight = 1 / (1 + (error / threshold) ** 2)
    return float(np.mean(error < threshold))


_EXPLANATIONS: dict[str, tuple[str, str]] = {
    **MOTION_WORDS,
    "parallax": (
        "the cameras see the target from the same direction: they stand in one place or in line with the flight",
        "Move the cameras apart, so that they see the target at angles of 20 degrees and more",
    ),
    "support": (
        "no pair of cameras has enough common view that one geometry explains",
        "The cameras need at least 20 s of common view; check calibrations, frame rates and columns",
    ),
}


def _why_none(failures: Sequence[tuple[TwoView, _Failure]], settings: InitialSettings) -> ReconstructionError:
    """The commonest degeneracy as an error."""
    thresholds = {
        "hover": settings.min_image_extent,
        "parallax": settings.min_angle_rad,
        "straight": settings.min_extent,
        "support": settings.min_support_s,
    }
    reasons = [f.reason for _, f in failures] or ["support"]
    # A geometric degeneracy says more than missing support that follows from it.
    chosen = max(set(reasons), key=lambda r: (reasons.count(r) * (0.5 if r == "support" else 1.0), r))
    text, hint = _EXPLANATIONS[chosen]
    counts = {f"{p.camera0}-{p.camera1} {f.reason}": f.value for p, f in failures[:6]}
    return ReconstructionError("initialise", text, counts=counts, threshold=thresholds[chosen], hint=hint)
