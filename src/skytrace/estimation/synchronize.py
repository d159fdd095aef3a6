"""When each camera filmed, from the tracks alone: every offset searched, all pairs reconciled, refined to sub-frame."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from skytrace.errors import ReconstructionError
from skytrace.estimation import two_view
from skytrace.estimation.correspond import ImagePath
from skytrace.estimation.motion_shape import MOTION_WORDS, motion_shape
from skytrace.estimation.offset_graph import Mode, consistent_offsets
from skytrace.estimation.pair_modes import PairMode, find_modes, weigh
from skytrace.estimation.pair_refine import RefinedPair, refine_mode
from skytrace.estimation.rate_search import search_rate
from skytrace.estimation.strand import main_strand
from skytrace.estimation.sync_groups import Measured, TiedGroup, tie_groups
from skytrace.estimation.sync_settings import SyncSettings
from skytrace.geometry.arrays import FloatArray
from skytrace.model.reconstruction import TwoView

__all__ = ["PairEvidence", "SyncSettings", "Synchronisation", "synchronize"]

_ALONE = "its track shares too little with the other cameras' to be synchronised"


@dataclass(frozen=True, eq=False, slots=True)
class PairEvidence:
    """What the tracks of two cameras say about their offset, whether that was believed or not."""

    camera0: str
    camera1: str
    offset_s: float  # camera time 1 = offset_s + rate * camera time 0
    rate: float
    offset_sigma_s: float  # in the middle of the overlap
    overlap_s: float
    support_s: float
    evidence: float
    confidence: float  # probability that the offset is right to a frame, from this pair alone
    accepted: bool
    rivals: tuple[tuple[float, float], ...]  # other plausible (offset_s, evidence), best first


@dataclass(frozen=True, eq=False, slots=True)
class Synchronisation:
    """World time = offset + rate * camera time, for the cameras that the evidence ties to the reference.

    Camera time is nominal: frame / nominal frame rate, or time stamps. A rate far from one says that the nominal frame
    rate is wrong. Where cameras fall into groups without a tie between them, `groups` holds the clocks of each, the
    largest first, on the clock of its own first camera; `clocks` is the first of them.
    """

    reference: str
    clocks: Mapping[str, tuple[float, float]]  # camera id -> (offset_s, rate)
    pairs: tuple[TwoView, ...]
    disagreement_s: FloatArray  # (pairs,) each pair against the joint solution
    untied: Mapping[str, str]  # camera id -> why it could not be tied in
    groups: tuple[Mapping[str, tuple[float, float]], ...] = ()
    deviations: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # of offset (mid-overlap) and rate
    confidence: Mapping[str, float] = field(default_factory=dict)  # that the camera is tied in at the right offset
    evidence: tuple[PairEvidence, ...] = ()  # of every pair with a plausible offset
    warnings: tuple[str, ...] = ()


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
    found = weigh_offsets(paths, settings, rng, hints_s, progress)
    if not found.clocks:
        raise _failure(paths, found, settings)
    return found


def weigh_offsets(
    paths: Mapping[str, ImagePath],
    settings: SyncSettings,
    rng: np.random.Generator,
    hints_s: Mapping[str, float] | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Synchronisation:
    """As `synchronize`, but where nothing can be tied together the evidence is returned without clocks."""
    search = _Search({c: main_strand(p) for c, p in paths.items()}, settings, rng, hints_s or {})
    couples = list(combinations(paths, 2))
    for done, (a, b) in enumerate(couples):
        progress(done, len(couples))
        search.compare(a, b)
    given = dict(search.paths)
    factors = dict.fromkeys(paths, 1.0)
    tied = search.tie()
    for camera in tied.untied if tied.clocks else ():
        if any(camera in group for group in tied.groups):
            continue
        partners = sorted(tied.clocks, key=lambda c: -given[c].seen_s)[:2]
        factor = search_rate(given[camera], [search.paths[c] for c in partners], settings)
        if factor is not None:
            factors[camera] = factor
            search.paths[camera] = given[camera].stretched(factor)
            for other in paths:
                if other != camera:
                    search.compare(*((camera, other) if (camera, other) in search.modes else (other, camera)))
    if any(f != 1.0 for f in factors.values()):
        tied = search.tie()
    if tied.clocks:  # a stage that fails is not over
        progress(len(couples), len(couples))
    found = _on_given_clocks(tied, factors)
    return replace(found, warnings=tuple(hint_warnings(found, hints_s or {})))


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
        self.modes: dict[tuple[str, str], list[PairMode]] = {}

    def compare(self, a: str, b: str) -> None:
        """Find the plausible offsets of a pair."""
        hints = [self.hints_s[a] - self.hints_s[b]] if a in self.hints_s and b in self.hints_s else []
        self.modes[a, b] = find_modes(self.paths[a], self.paths[b], hints, self.settings)

    def tie(self) -> Synchronisation:
        """Reconcile all pairs; without any trusted pair, a synchronisation that ties no camera."""
        ids = list(self.paths)
        index = {c: k for k, c in enumerate(ids)}
        modes = {
            (index[a], index[b]): [Mode(m.offset_s, m.evidence) for m in found if m.evidence > 0]
            for (a, b), found in self.modes.items()
        }
        groups = consistent_offsets(modes, len(ids), self.settings.tolerance_s)
        measured = []
        for (a, b), found in sorted(self.modes.items(), key=lambda item: (index[item[0][0]], index[item[0][1]])):
            i, j = index[a], index[b]
            group = next((g for g in groups if i in g and j in g), None)
            pair = self._measure(a, b, found, None if group is None else group[j] - group[i])
            if pair is not None:
                measured.append(Measured(i, j, *pair, consistent=group is not None))
        return _assembled(ids, measured, self.modes, tie_groups(measured, len(ids), self.settings), self.settings)

    def _measure(
        self, a: str, b: str, modes: Sequence[PairMode], offset_s: float | None
    ) -> tuple[PairMode, RefinedPair] | None:
        """The pair refined at the offset that all pairs agree on, else at its own best."""
        reach = 2 * self.settings.tolerance_s
        near = [m for m in modes if offset_s is None or abs(m.offset_s - offset_s) <= reach]
        if not near and offset_s is not None:
            near = self._near(a, b, offset_s)
        if not near:
            return None
        chosen = max(near, key=lambda m: m.evidence)
        rivals = [m for m in modes if abs(m.offset_s - chosen.offset_s) > reach]
        refined = refine_mode(self.paths[a], self.paths[b], chosen, rivals, self.settings)
        return None if refined is None else (chosen, refined)

    def _near(self, a: str, b: str, offset_s: float) -> list[PairMode]:
        """A mode that the pair's own search missed, by the eight-point solver with time shift (Li et al. 2020)."""
        path0, path1, settings = self.paths[a], self.paths[b], self.settings
        pairs = two_view.correspond(path0, path1, settings.rate_hz, offset_s, 1.0, 400)
        if len(pairs) < 30:
            return []
        shifted = two_view.time_shift_pose(pairs, settings.refine_thresholds[0], settings.tolerance_s, self.rng)
        if shifted is None:
            return []
        geometry = two_view.refine(
            path0,
            path1,
            shifted[0],
            offset_s + shifted[1],
            1.0,
            rate_hz=settings.rate_hz,
            thresholds=settings.mode_thresholds,
            rate_prior=settings.rate_prior,
            max_samples=settings.mode_samples,
        )
        if geometry is None:
            return []
        return [m for m in weigh(path0, path1, [geometry], settings) if abs(m.offset_s - offset_s) < 1.0]


def _failure(paths: Mapping[str, ImagePath], found: Synchronisation, settings: SyncSettings) -> ReconstructionError:
    """Why no two cameras could be tied: what the tracks look like decides the explanation."""
    counts = {
        "cameras": len(paths),
        "pairs with enough overlap at some offset": len(found.evidence),
        "largest confidence of a pair": round(max((p.confidence for p in found.evidence), default=0.0), 2),
    }
    shapes = [motion_shape(path) for path in paths.values()]
    if float(np.median([s.extent for s in shapes])) < settings.min_extent:
        reason, hint = MOTION_WORDS["hover"]
    elif float(np.median([s.bend for s in shapes])) < settings.min_bend:
        reason, hint = MOTION_WORDS["straight"]
    else:
        reason = "no two cameras can be tied together: no time offset makes their tracks views of one flight"
        hint = (
            "The cameras need at least 20 s of common view of a target that moves in more than a straight line; "
            "check the calibration files, the frame rates and the columns of the detections"
        )
    return ReconstructionError("synchronise", reason, counts=counts, threshold=settings.min_confidence, hint=hint)


def _assembled(
    ids: Sequence[str],
    measured: Sequence[Measured],
    modes: Mapping[tuple[str, str], Sequence[PairMode]],
    groups: Sequence[TiedGroup],
    settings: SyncSettings,
) -> Synchronisation:
    """Camera numbers back to names; the first group is the one that the reconstruction goes on with."""
    used = {(m.i, m.j) for group in groups for m in group.pairs}
    evidence = tuple(
        _evidence(ids[m.i], ids[m.j], m, modes[ids[m.i], ids[m.j]], (m.i, m.j) in used, settings) for m in measured
    )
    if not groups:
        return Synchronisation(ids[0], {}, (), np.zeros(0), dict.fromkeys(ids, _ALONE), evidence=evidence)
    first, reference = groups[0], ids[groups[0].reference]
    untied = {ids[c]: _ALONE for c in range(len(ids)) if c not in first.clocks}
    for group in groups[1:]:
        names = [ids[c] for c in sorted(group.clocks)]
        for c in names:
            others = ", ".join(n for n in names if n != c)
            untied[c] = f"it is synchronised with {others}, but this group with none of the cameras of {reference}"
    views = tuple(
        TwoView(ids[m.i], ids[m.j], g.camera1_from_camera0, g.offset_s, g.rate, g.support_s, m.mode.evidence)
        for m in first.pairs
        for g in (m.pair.geometry,)
    )
    return Synchronisation(
        reference,
        {ids[c]: clock for c, clock in first.clocks.items()},
        views,
        first.disagreement_s,
        untied,
        tuple({ids[c]: clock for c, clock in group.clocks.items()} for group in groups),
        {ids[c]: d for group in groups for c, d in group.deviations.items()},
        {ids[c]: p for group in groups for c, p in group.confidence.items()},
        evidence,
    )


def _evidence(
    a: str, b: str, m: Measured, modes: Sequence[PairMode], accepted: bool, settings: SyncSettings
) -> PairEvidence:
    g = m.pair.geometry
    rivals = tuple(
        (r.offset_s, r.evidence)
        for r in modes
        if abs(r.offset_s - m.mode.offset_s) > 2 * settings.tolerance_s
        and r.evidence >= settings.rival_evidence * m.mode.evidence
    )
    return PairEvidence(
        a,
        b,
        g.offset_s,
        g.rate,
        g.offset_sigma_s,
        g.overlap_s,
        g.support_s,
        m.mode.evidence,
        m.pair.confidence,
        accepted,
        rivals,
    )


def _on_given_clocks(tied: Synchronisation, factors: Mapping[str, float]) -> Synchronisation:
    """Undo the stretching: clocks and pairs in terms of the camera times given."""

    def given(clocks: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
        return {c: (offset, rate * factors[c]) for c, (offset, rate) in clocks.items()}

    # Stretched: s1 = offset + rate s0, with s = f t; so t1 = offset / f1 + rate f0 / f1 t0.
    pairs = tuple(
        replace(
            p,
            offset_s=p.offset_s / factors[p.camera1],
            rate=p.rate * factors[p.camera0] / factors[p.camera1],
        )
        for p in tied.pairs
    )
    evidence = tuple(
        replace(
            p,
            offset_s=p.offset_s / factors[p.camera1],
            rate=p.rate * factors[p.camera0] / factors[p.camera1],
        )
        for p in tied.evidence
    )
    groups = tuple(given(g) for g in tied.groups)
    return replace(tied, clocks=given(tied.clocks), pairs=pairs, groups=groups, evidence=evidence)


def hint_warnings(found: Synchronisation, hints_s: Mapping[str, float], tolerance_s: float = 0.5) -> list[str]:
    """Which of the given offsets the tracks contradict: each is compared with what most of them agree on."""
    hinted = [c for c in found.clocks if c in hints_s]
    if len(hinted) < 2:
        return []
    difference = {c: found.clocks[c][0] - hints_s[c] for c in hinted}
    if len(hinted) == 2:
        a, b = hinted
        off = difference[b] - difference[a]
        if abs(off) <= tolerance_s:
            return []
        return [
            f"The offsets given for {a} and {b} are contradicted by their tracks: "
            f"offset_s of {b} should be {off:+.2f} s relative to what it is. They were not used."
        ]
    usual = float(np.median(list(difference.values())))
    return [
        f"The offset given for {c} is contradicted by the tracks: offset_s should be "
        f"{hints_s[c] + difference[c] - usual:.2f} s, not {hints_s[c]:.2f} s. It was not used."
        for c in hinted
        if abs(difference[c] - usual) > tolerance_s
    ]
