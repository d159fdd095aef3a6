"""When each camera filmed, from the tracks alone: every offset searched, all pairs reconciled, refined to sub-frame."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from skytrace.errors import ReconstructionError
from skytrace.estimation import two_view
from skytrace.estimation.correspond import ImagePath
from skytrace.estimation.growing_steps import rough_modes, rough_offsets, steps_s
from skytrace.estimation.hint_search import favoured, hinted_modes, searched_span_s
from skytrace.estimation.hint_ties import HintTie, decided_by_hints, join_by_hints
from skytrace.estimation.hint_verdicts import Clocks, HintVerdict, decision_sentence, judge_hints, tie_sentences
from skytrace.estimation.hints import Hints, PairHint
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
_OUT_OF_REACH = "its rough offset leads to none that its track and the other cameras' agree on"


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
    blind_confidence: float | None = None  # without the hints that bear on the pair; none where there are none
    rival_evidence: float = 0.0  # for the best other offset, plausible or not


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
    hints: tuple[HintVerdict, ...] = ()  # what became of each hint


def synchronize(
    paths: Mapping[str, ImagePath],
    settings: SyncSettings,
    rng: np.random.Generator,
    hints: Hints | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Synchronisation:
    """Synchronise cameras given where each saw the target in its own time.

    `hints` say where to look and decide where the tracks cannot; what the tracks contradict is not believed. A camera
    that cannot be tied to the others at its nominal frame rate is tried at different ones. Raises ReconstructionError
    where no pair of cameras can be tied together.
    """
    found = weigh_offsets(paths, settings, rng, hints, progress)
    if not found.clocks:
        raise _failure(paths, found, settings)
    return found


def weigh_offsets(
    paths: Mapping[str, ImagePath],
    settings: SyncSettings,
    rng: np.random.Generator,
    hints: Hints | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Synchronisation:
    """As `synchronize`, but where nothing can be tied together the evidence is returned without clocks."""
    if settings.method == "given":
        raise ValueError("settings.method: expected a search, got 'given': see given_offsets")
    strands = {c: main_strand(p) for c, p in paths.items()}
    if settings.method == "paper":
        # Rough offsets are where it starts: nothing is left in them to weigh or to judge.
        search, hints = _RoughSearch(strands, settings, rng, rough_offsets(paths, hints or Hints())), None
    else:
        search = _Search(strands, settings, rng, hints or Hints())
    couples = list(combinations(paths, 2))
    for done, (a, b) in enumerate(couples):
        progress(done, len(couples))
        search.compare(a, b)
    tied = search.tie()
    loose = search.loose(tied)
    for camera in loose:
        search.stretch(camera, search.rate(camera, tied))
    if search.is_stretched(loose):
        tied = search.tie()
    if hints and search.is_stretched(search.alone(tied)):
        # What a hint alone ties is tied at the rate given: no track confirmed another one.
        for camera in search.alone(tied):
            search.stretch(camera, 1.0)
        tied = search.tie()
    tied = search.join(tied)
    if tied.clocks:  # a stage that fails is not over
        progress(len(couples), len(couples))
    return _judged(_on_given_clocks(tied, search.factors), hints or Hints(), search)


class _Search:
    """The evidence gathered so far, pair by pair."""

    def __init__(
        self,
        paths: dict[str, ImagePath],
        settings: SyncSettings,
        rng: np.random.Generator,
        hints: Hints,
    ) -> None:
        self.given, self.settings, self.rng, self.hints = paths, settings, rng, hints
        self.paths, self.factors = dict(paths), dict.fromkeys(paths, 1.0)
        self.modes: dict[tuple[str, str], list[PairMode]] = {}
        self.measured: list[Measured] = []
        self.groups: list[TiedGroup] = []
        self.ties: list[HintTie] = []

    def compare(self, a: str, b: str) -> None:
        """Find the plausible offsets of a pair."""
        path0, path1 = self.paths[a], self.paths[b]
        blind = find_modes(path0, path1, self.settings)
        self.modes[a, b] = hinted_modes(path0, path1, self._hints(a, b), blind, self.settings)

    def _hints(self, a: str, b: str) -> tuple[PairHint, ...]:
        return self.hints.between(a, b, self.settings.rate_prior)

    def loose(self, tied: Synchronisation) -> list[str]:
        """Cameras whose frame rates are in doubt, as they fit to no other; without any tie, those that hints doubt."""
        if tied.clocks:
            return self.alone(tied)
        return [c for c in list(self.paths)[1:] if self._hinted_rates(c, list(self.paths))]

    def alone(self, tied: Synchronisation) -> list[str]:
        """Cameras that are tied to no other."""
        return [c for c in tied.untied if not any(c in group for group in tied.groups)]

    def rate(self, camera: str, tied: Synchronisation) -> float:
        """By what factor to stretch a camera's clock; 1 where nothing tells another one."""
        hinted = self._hinted_rates(camera, list(self.paths))
        if not tied.clocks:
            return hinted[0]
        partners = sorted(tied.clocks, key=lambda c: -self.given[c].seen_s)[:2]
        found = search_rate(self.given[camera], [self.paths[c] for c in partners], self.settings, hinted)
        return 1.0 if found is None else found

    def is_stretched(self, cameras: Sequence[str]) -> bool:
        """Whether any of these cameras is on another clock than its own."""
        return any(self.factors[c] != 1.0 for c in cameras)

    def _hinted_rates(self, camera: str, partners: Sequence[str]) -> list[float]:
        rates = (self.hints.stretch(camera, p, self.settings.rate_prior) for p in partners if p != camera)
        return [rate for rate in rates if rate is not None]

    def stretch(self, camera: str, factor: float) -> None:
        """Compare a camera anew on a clock that runs `factor` times as fast as its own."""
        if factor == self.factors[camera]:
            return
        self.hints = self.hints.stretched(camera, factor / self.factors[camera])
        self.paths[camera], self.factors[camera] = self.given[camera].stretched(factor), factor
        for other in self.paths:
            if other != camera:
                self.compare(*((camera, other) if (camera, other) in self.modes else (other, camera)))

    def tie(self) -> Synchronisation:
        """Reconcile all pairs; without any trusted pair, a synchronisation that ties no camera."""
        ids = list(self.paths)
        index = {c: k for k, c in enumerate(ids)}
        modes = {
            (index[a], index[b]): [Mode(m.offset_s, m.evidence) for m in found if m.evidence > 0]
            for (a, b), found in self.modes.items()
        }
        groups = consistent_offsets(modes, len(ids), self.settings.tolerance_s)
        self.measured = []
        for (a, b), found in sorted(self.modes.items(), key=lambda item: (index[item[0][0]], index[item[0][1]])):
            i, j = index[a], index[b]
            group = next((g for g in groups if i in g and j in g), None)
            pair = self._measure(a, b, found, None if group is None else group[j] - group[i])
            if pair is not None:
                self.measured.append(Measured(i, j, *pair, consistent=group is not None))
        self.groups = tie_groups(self.measured, len(ids), self.settings)
        return _assembled(ids, self.measured, self.modes, self.groups, self.settings)

    def join(self, tied: Synchronisation) -> Synchronisation:
        """What was tied, with what hints alone tie."""
        groups, self.ties = join_by_hints(self.groups, self.paths, self.hints, self.settings)
        if all(t.objected for t in self.ties):
            return tied
        replaced = {(t.i, t.j): t.measured for t in self.ties if t.measured is not None}
        measured = [m for m in self.measured if (m.i, m.j) not in replaced] + list(replaced.values())
        measured.sort(key=lambda m: (m.i, m.j))
        return _assembled(list(self.paths), measured, self.modes, groups, self.settings)

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
        near = [m for m in weigh(path0, path1, [geometry], settings) if abs(m.offset_s - offset_s) < 1.0]
        return [favoured(m, self._hints(a, b), searched_span_s(path0, path1)) for m in near]


class _RoughSearch(_Search):
    """As the paper does it: each pair from its rough offset alone, at nominal rates."""

    def __init__(
        self,
        paths: dict[str, ImagePath],
        settings: SyncSettings,
        rng: np.random.Generator,
        rough_s: Mapping[str, float],
    ) -> None:
        super().__init__(paths, settings, rng, Hints())
        self.rough_s = rough_s

    def compare(self, a: str, b: str) -> None:
        path0, path1 = self.paths[a], self.paths[b]
        offset_s = self.rough_s[a] - self.rough_s[b]
        self.modes[a, b] = rough_modes(path0, path1, offset_s, self.settings, self.rng)

    def loose(self, tied: Synchronisation) -> list[str]:
        return []


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
    elif settings.method == "paper":
        reason = "no two cameras can be tied together from the rough offsets: they are too far off, or share no view"
        hint = f"Its longest step is {steps_s(settings)[-1]:.1f} s; the exhaustive search needs no rough offsets"
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
    alone = _OUT_OF_REACH if settings.method == "paper" else _ALONE
    used = {(m.i, m.j) for group in groups for m in group.pairs}
    evidence = tuple(
        _evidence(ids[m.i], ids[m.j], m, modes[ids[m.i], ids[m.j]], (m.i, m.j) in used, settings) for m in measured
    )
    if not groups:
        return Synchronisation(ids[0], {}, (), np.zeros(0), dict.fromkeys(ids, alone), evidence=evidence)
    first, reference = groups[0], ids[groups[0].reference]
    untied = {ids[c]: alone for c in range(len(ids)) if c not in first.clocks}
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
        and r.evidence >= settings.rival_evidence * m.mode.evidence > 0
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
        m.pair.blind_confidence,
        m.pair.rival_evidence,
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
            rivals=tuple((offset_s / factors[p.camera1], score) for offset_s, score in p.rivals),
        )
        for p in tied.evidence
    )
    groups = tuple(given(g) for g in tied.groups)
    return replace(tied, clocks=given(tied.clocks), pairs=pairs, groups=groups, evidence=evidence)


def _judged(found: Synchronisation, hints: Hints, search: _Search) -> Synchronisation:
    """With a verdict on every hint, and in words what users should know of them."""
    if not hints:
        return found
    ids = list(search.given)
    middle_s = {c: 0.5 * (p.begin_s + p.end_s) for c, p in search.given.items()}
    clocks = Clocks(found.groups, found.deviations, middle_s)
    verdicts = judge_hints(hints, clocks, search.settings.rate_prior, search.ties)
    decided = [(ids[m.i], ids[m.j]) for m in decided_by_hints(search.measured, search.groups, search.settings)]
    sentences = [v.text for v in verdicts if v.text] + tie_sentences(ids, search.ties)
    sentences += [
        decision_sentence(p.camera0, p.camera1, p.blind_confidence or 0.0, [at - p.offset_s for at, _ in p.rivals])
        for p in found.evidence
        if (p.camera0, p.camera1) in decided
    ]
    return replace(found, warnings=(*found.warnings, *sentences), hints=verdicts)
