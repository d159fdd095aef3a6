"""Which cameras the trusted pairs tie together, when each of a group ran, and how sure that is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from skytrace.estimation.offset_graph import PairClock, solve_clocks
from skytrace.estimation.pair_modes import PairMode
from skytrace.estimation.pair_refine import RefinedPair
from skytrace.estimation.sync_settings import SyncSettings
from skytrace.geometry.arrays import FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class Measured:
    """Cameras i and j at one offset; `consistent` where that is the one all pairs agree on."""

    i: int
    j: int
    mode: PairMode
    pair: RefinedPair
    consistent: bool


@dataclass(frozen=True, eq=False, slots=True)
class TiedGroup:
    """Cameras tied together: clocks on that of `reference`, their deviations, and how sure each tie is."""

    reference: int
    clocks: Mapping[int, tuple[float, float]]
    deviations: Mapping[int, tuple[float, float]]
    confidence: Mapping[int, float]
    pairs: tuple[Measured, ...]
    disagreement_s: FloatArray  # (pairs,)


def tie_groups(measured: Sequence[Measured], n_cameras: int, settings: SyncSettings) -> list[TiedGroup]:
    """Groups of cameras that confident pairs, or several less confident ones that agree, tie together; largest first.

    Inside a group every pair counts that holds at the common offsets, confident or not.
    """
    holding = [
        m
        for m in measured
        if m.consistent and m.pair.support >= settings.min_support and m.pair.geometry.support_s >= 8.0
    ]
    label = list(range(n_cameras))
    while True:
        doubt: dict[tuple[int, int], float] = {}
        for m in holding:
            if label[m.i] != label[m.j]:
                key = (min(label[m.i], label[m.j]), max(label[m.i], label[m.j]))
                doubt[key] = doubt.get(key, 1.0) * (1 - m.pair.confidence)
        ties = [key for key, d in doubt.items() if 1 - d >= settings.min_confidence]
        if not ties:
            break
        a, b = min(ties, key=lambda key: doubt[key])
        label = [a if x == b else x for x in label]
    groups = []
    for name in sorted(set(label)):
        cameras = [c for c in range(n_cameras) if label[c] == name]
        if len(cameras) > 1:
            groups.append(_solved(cameras, [m for m in holding if label[m.i] == name == label[m.j]], settings))
    return sorted(groups, key=lambda g: (-len(g.clocks), g.reference))


def _solved(cameras: Sequence[int], pairs: Sequence[Measured], settings: SyncSettings) -> TiedGroup:
    reference = min(cameras)
    clocks = [pair_clock(m, settings) for m in pairs]
    solution = solve_clocks(clocks, cameras, reference, settings.rate_prior)
    return TiedGroup(
        reference,
        solution.clocks,
        solution.deviations,
        camera_confidence(cameras, pairs, reference),
        tuple(pairs),
        solution.disagreement_s,
    )


def pair_clock(m: Measured, settings: SyncSettings) -> PairClock:
    """A pair for the joint solution: weighted at two times so that offset and rate count as well as they are known."""
    g = m.pair.geometry
    sigma_s = max(g.offset_sigma_s, 1e-4)
    half_span_s = min(max(sigma_s / max(g.rate_sigma, 1e-9), 1.0), max(g.overlap_s, 1.0))
    return PairClock(m.i, m.j, g.offset_s, g.rate, g.centre_s, half_span_s, 0.5 / sigma_s**2)


def camera_confidence(cameras: Sequence[int], pairs: Sequence[Measured], reference: int) -> dict[int, float]:
    """Probability that each camera is at the right offset: wrong only if every pair that ties it in is.

    Cameras are added in order of certainty, each by its pairs with those before it; the reference is as sure as the
    first tie to it.
    """
    known = {reference: 1.0}
    while len(known) < len(cameras):
        doubt: dict[int, float] = {}
        for m in pairs:
            for a, b in ((m.i, m.j), (m.j, m.i)):
                if a in known and b not in known:
                    doubt[b] = doubt.get(b, 1.0) * (1 - known[a] * m.pair.confidence)
        nearest = min(doubt, key=lambda c: doubt[c])
        known[nearest] = 1 - doubt[nearest]
    known[reference] = max(p for c, p in known.items() if c != reference)
    return known
