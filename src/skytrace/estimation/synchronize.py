"""When each camera filmed, from the tracks alone: every offset searched, all pairs reconciled, refined to sub-frame."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from skytrace.errors import ReconstructionError
from skytrace.estimation import two_view
from skytrace.estimation.correspond import ImagePath, common_grid
from skytrace.estimation.motion_shape import MOTION_WORDS, motion_shape
from skytrace.estimation.offset_graph import Mode, PairClock, consistent_offsets, joint_clocks
from skytrace.estimation.offset_search import peaks, score_shifts, turn_rate_correlation
from skytrace.geometry.arrays import FloatArray
from skytrace.model.reconstruction import TwoView


@dataclass(frozen=True, slots=True)
class SyncSettings:
    """Angles are on the plane z = 1, so nearly radians."""

    rate_hz: float = 10.0
    min_overlap_s: float = 15.0
    candidates: int = 12  # of each search, verified by geometry
    modes: int = 10  # kept for the consensus of all pairs
    tolerance_s: float = 0.4
    verify_threshold: float = 0.012
    refine_thresholds: tuple[float, ...] = (0.012, 0.006, 0.003)
    rate_prior: float = 3e-4
    min_support: float = 0.6  # share of the overlap that must obey the refined geometry
    min_contrast: float = 1.3  # evidence for the chosen offset over that for the best other one
    min_pair_support_s: float = 8.0
    # Stretches tried for a camera that fits at no offset: one per cent apart, and around the factors of slow motion.
    rate_factors: tuple[float, ...] = tuple(
        round(float(f), 6) for f in np.r_[0.25, 0.5, 2.0, 4.0, 1.01 ** np.arange(-45, 46)]
    )
    min_rate_contrast: float = 2.0  # of the best stretch's evidence to the median one's
    min_extent: float = 0.01  # of the image motion on the plane z = 1: below, the target hovers
    min_bend: float = 0.02  # of the image path, see motion_shape: below, it is a straight line


@dataclass(frozen=True, eq=False, slots=True)
class Synchronisation:
    """World time = offset + rate * camera time, for the cameras that the evidence ties to the reference.

    Camera time is nominal: frame / nominal frame rate, or time stamps. A rate far from one says that the nominal frame
    rate is wrong.
    """

    reference: str
    clocks: Mapping[str, tuple[float, float]]  # camera id -> (offset_s, rate)
    pairs: tuple[TwoView, ...]
    disagreement_s: FloatArray  # (pairs,) each pair against the joint solution
    untied: Mapping[str, str]  # camera id -> why it could not be tied in


def synchronize(
    paths: Mapping[str, ImagePath],
    settings: SyncSettings,
    rng: np.random.Generator,
    hints_s: Mapping[str, float] | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Synchronisation:
    """Synchronise cameras given where each saw the target in its own time.

    `hints_s` are rough offsets, camera time 0 on a common clock: further candidates, believed only if the tracks agree.
    A camera that cannot be tied to the others at its nominal frame rate is tried at different ones. Raises
    ReconstructionError where no pair of cameras can be tied together.
    """
    search = _Search(dict(paths), settings, rng, hints_s or {})
    couples = list(combinations(paths, 2))
    for done, (a, b) in enumerate(couples):
        progress(done, len(couples))
        search.compare(a, b)
    factors = dict.fromkeys(paths, 1.0)
    tied = search.tie()
    for camera in tied.untied if tied.clocks else ():
        partners = sorted(tied.clocks, key=lambda c: -paths[c].seen_s)[:2]
        factor = search_rate(paths[camera], [search.paths[c] for c in partners], settings)
        if factor is not None:
            factors[camera] = factor
            search.paths[camera] = paths[camera].stretched(factor)
            for other in paths:
                if other != camera:
                    search.compare(*((camera, other) if (camera, other) in search.modes else (other, camera)))
    if any(f != 1.0 for f in factors.values()):
        tied = search.tie()
    if not tied.clocks:
        raise search.failure()
    progress(len(couples), len(couples))
    return _on_given_clocks(tied, factors)


class _Search:
    """The evidence gathered so far, pair by pair."""

    def __init__(
        self,
        paths: dict[str, ImagePath],
        settings: SyncSettings,
        rng: np.random.Generator,
        hints_s: Mapping[str, float],
    ) -> None:
        self.paths, self.settings, self.rng, self.hints_s = paths, settings, rng, hints_s
        self.modes: dict[tuple[str, str], list[Mode]] = {}
        self.n_held = 0

    def compare(self, a: str, b: str) -> None:
        """Find the plausible offsets of a pair."""
        hints = [self.hints_s[a] - self.hints_s[b]] if a in self.hints_s and b in self.hints_s else []
        self.modes[a, b] = pair_modes(self.paths[a], self.paths[b], hints, self.settings)

    def tie(self) -> Synchronisation:
        """Reconcile all pairs; without any trusted pair, a synchronisation that ties no camera."""
        ids = list(self.paths)
        index = {c: k for k, c in enumerate(ids)}
        modes = {(index[a], index[b]): m for (a, b), m in self.modes.items()}
        groups = consistent_offsets(modes, len(ids), self.settings.tolerance_s)
        measured = []
        for (i, j), candidates in sorted(modes.items()):
            group = next((g for g in groups if i in g and j in g), None)
            if group is not None:
                a, b = ids[i], ids[j]
                pair = refine_pair(
                    a, b, self.paths[a], self.paths[b], group[j] - group[i], candidates, self.settings, self.rng
                )
                if pair is not None:
                    measured.append((i, j, pair))
        self.n_held = len(measured)
        return _reconcile(ids, measured, self.settings)

    def failure(self) -> ReconstructionError:
        """Why no two cameras could be tied: what the tracks look like decides the explanation."""
        counts = {
            "cameras": len(self.paths),
            "pairs with enough overlap at some offset": sum(bool(m) for m in self.modes.values()),
            "pairs that hold": self.n_held,
        }
        shapes = [motion_shape(path) for path in self.paths.values()]
        if float(np.median([s.extent for s in shapes])) < self.settings.min_extent:
            reason, hint = MOTION_WORDS["hover"]
        elif float(np.median([s.bend for s in shapes])) < self.settings.min_bend:
            reason, hint = MOTION_WORDS["straight"]
        else:
            reason = "no two cameras can be tied together: no time offset makes their tracks views of one flight"
            hint = (
                "The cameras need at least 20 s of common view of a target that moves in more than a straight line; "
                "check the calibration files, the frame rates and the columns of the detections"
            )
        return ReconstructionError("synchronise", reason, counts=counts, hint=hint)


def search_rate(path: ImagePath, partners: Sequence[ImagePath], settings: SyncSettings) -> float | None:
    """By what factor a camera's clock must be stretched so that its track fits a partner's at some offset.

    Serves cameras whose given frame rate is grossly wrong (slow motion, variable rate, a wrong file). The offset search
    stands a stretch of one per cent, so a geometric grid of that step finds it; None where nothing stands out.
    """

    def best_score(factor: float, rate_hz: float) -> float:
        return max(_best_offset_score(path.stretched(factor), partner, rate_hz, settings) for partner in partners)

    coarse = {f: best_score(f, settings.rate_hz / 2) for f in settings.rate_factors}
    top = max(coarse, key=lambda f: coarse[f])
    chance = float(np.median(list(coarse.values())))
    if coarse[top] < settings.min_rate_contrast * max(chance, 1e-9):
        return None
    return max(top * np.linspace(0.985, 1.015, 31), key=lambda f: best_score(float(f), settings.rate_hz))


def _best_offset_score(path0: ImagePath, path1: ImagePath, rate_hz: float, settings: SyncSettings) -> float:
    (_, xy0), (_, xy1) = common_grid([path0, path1], rate_hz)
    return float(score_shifts(xy0, xy1, rate_hz, settings.min_overlap_s).score.max(initial=0.0))


def _on_given_clocks(tied: Synchronisation, factors: Mapping[str, float]) -> Synchronisation:
    """Undo the stretching: clocks and pairs in terms of the camera times given."""
    clocks = {c: (offset, rate * factors[c]) for c, (offset, rate) in tied.clocks.items()}
    # Stretched: s1 = offset + rate s0, with s = f t; so t1 = offset / f1 + rate f0 / f1 t0.
    pairs = tuple(
        replace(
            p,
            offset_s=p.offset_s / factors[p.camera1],
            rate=p.rate * factors[p.camera0] / factors[p.camera1],
        )
        for p in tied.pairs
    )
    return replace(tied, clocks=clocks, pairs=pairs)


def pair_modes(path0: ImagePath, path1: ImagePath, hints_s: Sequence[float], settings: SyncSettings) -> list[Mode]:
    """The most plausible offsets of a pair, best first, each with its evidence -overlap ln(misfit)."""
    rate = settings.rate_hz
    grid0, grid1 = common_grid([path0, path1], rate)
    start = grid1[0] - grid0[0]
    offsets: list[float] = list(hints_s)
    for search in (score_shifts, turn_rate_correlation):
        scores = search(grid0[1], grid1[1], rate, settings.min_overlap_s)
        best = peaks(scores.score, scores.shift, settings.candidates, round(0.5 * rate))
        offsets += [float(s / rate + start) for s in scores.shift[best]]
    modes: list[Mode] = []
    for offset in offsets:
        if any(abs(offset - m.offset_s) < 0.25 for m in modes):
            continue
        pairs = two_view.correspond(path0, path1, rate, offset, 1.0)
        sample = two_view.thin(pairs, 200)
        pose = two_view.five_point_pose(sample, settings.verify_threshold, seed=0, max_samples=150, min_samples=50)
        if pose is not None:
            misfit = 1 - float(two_view.support(pose, sample, settings.verify_threshold).mean())
            modes.append(Mode(offset, -(len(pairs) / rate) * float(np.log(max(misfit, 5e-3)))))
    return sorted(modes, key=lambda m: -m.score)[: settings.modes]


@dataclass(frozen=True, eq=False, slots=True)
class _Pair:
    geometry: two_view.PairGeometry
    score: float
    contrast: float
    view: TwoView


def refine_pair(
    id0: str,
    id1: str,
    path0: ImagePath,
    path1: ImagePath,
    offset_s: float,
    modes: Sequence[Mode],
    settings: SyncSettings,
    rng: np.random.Generator,
) -> _Pair | None:
    """Sub-frame offset, rate and geometry of a pair whose offset is roughly known; None where the pair does not hold.

    The eight-point solver with time shift takes up what the search's sampling left; local refinement does the rest.
    """
    t = settings.refine_thresholds
    pairs = two_view.thin(two_view.correspond(path0, path1, settings.rate_hz, offset_s, 1.0), 400)
    if len(pairs) < 30:
        return None
    starts = []
    shifted = two_view.time_shift_pose(pairs, t[1], 0.3, rng)
    if shifted is not None:
        starts.append((shifted[0], offset_s + shifted[1]))
    pose = two_view.five_point_pose(pairs, t[0], seed=0, max_samples=300)
    if pose is not None:
        starts.append((pose, offset_s))
    refined = [
        two_view.refine(path0, path1, p, o, 1.0, rate_hz=settings.rate_hz, thresholds=t, rate_prior=settings.rate_prior)
        for p, o in starts
    ]
    held = [g for g in refined if g is not None and abs(_offset_at_centre(g) - offset_s) < 1.0]
    if not held:
        return None
    best = max(held, key=lambda g: g.support_s)
    if best.support_s < max(settings.min_support * best.overlap_s, settings.min_pair_support_s):
        return None
    own = max((m.score for m in modes if abs(m.offset_s - offset_s) <= 2 * settings.tolerance_s), default=0.0)
    rival = max((m.score for m in modes if abs(m.offset_s - offset_s) > 2 * settings.tolerance_s), default=0.0)
    contrast = own / max(rival, 1e-9)
    view = TwoView(id0, id1, best.camera1_from_camera0, best.offset_s, best.rate, best.support_s, own)
    return _Pair(best, own, contrast, view)


def _offset_at_centre(geometry: two_view.PairGeometry) -> float:
    return geometry.offset_s + (geometry.rate - 1) * geometry.centre_s


def _reconcile(ids: list[str], measured: list[tuple[int, int, _Pair]], settings: SyncSettings) -> Synchronisation:
    """Keep the largest set of cameras tied by trusted pairs and solve their clocks jointly."""
    trusted = _trusted(measured, settings)
    group = _largest_component(len(ids), [(i, j) for i, j, _ in trusted])
    alone = "its track shares too little with the other cameras' to be synchronised"
    if len(group) < 2:
        return Synchronisation(ids[0], {}, (), np.zeros(0), dict.fromkeys(ids, alone))
    trusted = [(i, j, p) for i, j, p in trusted if i in group]
    reference = min(group)
    clocks, disagreement = joint_clocks(
        [
            PairClock(
                i, j, p.view.offset_s, p.view.rate, p.geometry.centre_s, p.geometry.overlap_s / 4, p.view.inlier_s
            )
            for i, j, p in trusted
        ],
        sorted(group),
        reference,
        settings.rate_prior,
    )
    untied = {ids[c]: alone for c in range(len(ids)) if c not in group}
    return Synchronisation(
        ids[reference],
        {ids[c]: clock for c, clock in clocks.items()},
        tuple(p.view for _, _, p in trusted),
        disagreement,
        untied,
    )


def _trusted(measured: list[tuple[int, int, _Pair]], settings: SyncSettings) -> list[tuple[int, int, _Pair]]:
    """Pairs that stand out against their own rival offsets, and pairs that a chain of such pairs confirms."""
    strong = [(i, j) for i, j, p in measured if p.contrast >= settings.min_contrast]
    keep = []
    for i, j, p in measured:
        connected = _largest_component(max(i, j) + 1, strong, start=i)
        if p.contrast >= settings.min_contrast or j in connected:
            keep.append((i, j, p))
    return keep


def _largest_component(n: int, edges: Sequence[tuple[int, int]], start: int | None = None) -> set[int]:
    """The largest connected set of nodes, or the one that contains `start`."""
    best: set[int] = set()
    for seed in range(n) if start is None else (start,):
        component, frontier = {seed}, [seed]
        while frontier:
            node = frontier.pop()
            for i, j in edges:
                for other in (j,) if i == node else (i,) if j == node else ():
                    if other not in component:
                        component.add(other)
                        frontier.append(other)
        if len(component) > len(best):
            best = component
    return best
