"""One offset per camera from the candidate offsets of all pairs: the set that most evidence agrees on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from skytrace.geometry.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class Mode:
    """A candidate: camera time 1 = offset_s + camera time 0, with the evidence for it."""

    offset_s: float
    score: float


Modes = Mapping[tuple[int, int], Sequence[Mode]]


def consistent_offsets(modes: Modes, n_cameras: int, tolerance_s: float, beam: int = 64) -> list[dict[int, float]]:
    """Offsets of cameras that agree with as much evidence as possible, in groups that no evidence connects.

    `modes[i, j]`, i < j, are candidates for t_j - t_i. A beam search adds one camera at a time; a hypothesis scores the
    sum, over all pairs inside it, of the best mode within `tolerance_s` of what it implies. Each group maps cameras to
    t_camera - t_first, largest group first; a camera without any candidate is a group of its own.
    """
    remaining = set(range(n_cameras))
    groups: list[dict[int, float]] = []
    while remaining:
        best = _best_group(modes, remaining, tolerance_s, beam)
        groups.append(best)
        remaining -= set(best)
    return sorted(groups, key=lambda g: (-len(g), min(g)))


def _candidates(modes: Modes, i: int, j: int) -> list[Mode]:
    """Candidates for t_j - t_i, whichever way round the pair is stored."""
    if (i, j) in modes:
        return list(modes[i, j])
    return [Mode(-m.offset_s, m.score) for m in modes.get((j, i), ())]


def _best_group(modes: Modes, available: set[int], tolerance_s: float, beam: int) -> dict[int, float]:
    pairs = [(i, j) for i, j in modes if i in available and j in available and modes[i, j]]
    if not pairs:
        return {min(available): 0.0}
    states = [({i: 0.0, j: m.offset_s}, m.score) for i, j in pairs for m in modes[i, j]]
    states = _prune(states, beam)
    while True:
        grown = []
        for offsets, score in states:
            for k in sorted(available - set(offsets)):
                proposals = [offsets[i] + m.offset_s for i in offsets for m in _candidates(modes, i, k)]
                for t in proposals:
                    gain = sum(_agreeing_score(_candidates(modes, i, k), t - offsets[i], tolerance_s) for i in offsets)
                    grown.append(({**offsets, k: t}, score + gain))
        if not grown:
            return max(states, key=lambda s: s[1])[0]
        states = _prune(grown, beam)


def _agreeing_score(modes: Sequence[Mode], offset_s: float, tolerance_s: float) -> float:
    return max((m.score for m in modes if abs(m.offset_s - offset_s) <= tolerance_s), default=0.0)


def _prune(states: list[tuple[dict[int, float], float]], beam: int) -> list[tuple[dict[int, float], float]]:
    """The best states, those that say the same (to 0.1 s) only once."""
    unique: dict[tuple, tuple[dict[int, float], float]] = {}
    for offsets, score in sorted(states, key=lambda s: -s[1]):
        origin = offsets[min(offsets)]
        key = tuple((c, round((offsets[c] - origin) * 5)) for c in sorted(offsets))
        unique.setdefault(key, (offsets, score))
        if len(unique) >= beam:
            break
    return list(unique.values())


@dataclass(frozen=True, slots=True)
class PairClock:
    """A measured relation camera time j = offset_s + rate * camera time i, best known around `centre_s`."""

    i: int
    j: int
    offset_s: float
    rate: float
    centre_s: float
    half_span_s: float
    weight: float


@dataclass(frozen=True, eq=False, slots=True)
class JointClocks:
    """Clocks world time = offset + rate * camera time, their deviations, and each pair's disagreement with them."""

    clocks: dict[int, tuple[float, float]]
    deviations: dict[int, tuple[float, float]]  # of the offset in the middle of the camera's overlaps, and of the rate
    disagreement_s: FloatArray  # (pairs,)


def solve_clocks(pairs: Sequence[PairClock], cameras: Sequence[int], reference: int, rate_prior: float) -> JointClocks:
    """`joint_clocks` of pairs whose weights are inverse variances, with the deviations that follow.

    A pair known to sigma in its offset and to sigma_r in its rate has the weight 1 / (2 sigma^2) at the two times
    sigma / sigma_r from its centre. Where pairs disagree by more than their deviations, those are taken to be larger.
    """
    solution = _solve(pairs, cameras, reference, 1 / rate_prior**2, 20)
    z2 = np.array([2 * p.weight for p in pairs]) * solution.residual_s.reshape(-1, 2).mean(axis=1) ** 2
    redundant = 2 * len(pairs) - 2 * (len(cameras) - 1)
    scale = max(1.0, float(np.median(z2)) / _MEDIAN_CHI2) if redundant > 0 else 1.0
    deviation = np.sqrt(np.maximum(np.diag(np.linalg.pinv(solution.normal, hermitian=True)), 0.0) * scale)
    deviations = {reference: (0.0, 0.0)}
    for c, k in solution.column.items():
        deviations[c] = float(deviation[k]), float(deviation[k + 1])
    return JointClocks(solution.clocks, deviations, np.abs(solution.residual_s).reshape(-1, 2).max(axis=1))


_MEDIAN_CHI2 = 0.455


def joint_clocks(
    pairs: Sequence[PairClock], cameras: Sequence[int], reference: int, rate_prior: float, iterations: int = 20
) -> tuple[dict[int, tuple[float, float]], FloatArray]:
    """Offsets and rates of all cameras at once, world time = offset + rate * camera time, robustly.

    Each pair says that its relation holds at both ends of the overlap; Cauchy weights let the majority overrule a pair.
    Rates are held near one by a prior of deviation `rate_prior`; the reference has offset 0 and rate 1. Returns the
    clocks and the disagreement in seconds (n,) of each pair with them.
    """
    information = (_ROBUST_SCALE_S / rate_prior) ** 2 * float(np.mean([p.weight for p in pairs]))
    solution = _solve(pairs, cameras, reference, information, iterations)
    return solution.clocks, np.abs(solution.residual_s).reshape(-1, 2).max(axis=1)


_ROBUST_SCALE_S = 0.02  # disagreements beyond it lose their say


@dataclass(frozen=True, eq=False, slots=True)
class _Solution:
    clocks: dict[int, tuple[float, float]]
    residual_s: FloatArray  # (2 pairs,)
    normal: FloatArray  # normal matrix of the unknowns
    column: dict[int, int]  # camera -> column of its offset; its rate follows


def _solve(
    pairs: Sequence[PairClock], cameras: Sequence[int], reference: int, rate_information: float, iterations: int
) -> _Solution:
    unknown = [c for c in cameras if c != reference]
    column = {c: 2 * k for k, c in enumerate(unknown)}
    centre = {
        c: np.mean(
            [p.centre_s if p.i == c else p.offset_s + p.rate * p.centre_s for p in pairs if c in (p.i, p.j)] or [0.0]
        )
        for c in cameras
    }
    rows, rhs, base = [], [], []
    for p in pairs:
        for end in (-1.0, 1.0):
            ti = p.centre_s + end * p.half_span_s
            tj = p.offset_s + p.rate * ti
            row, value = np.zeros(2 * len(unknown)), 0.0
            # world_i(ti) - world_j(tj) = 0 with world_c(t) = t + a_c + b_c (t - centre_c)
            for c, t, sign in ((p.i, ti, 1.0), (p.j, tj, -1.0)):
                value -= sign * t
                if c != reference:
                    row[column[c]] += sign
                    row[column[c] + 1] += sign * (t - centre[c])
            rows.append(row)
            rhs.append(value)
            base.append(np.sqrt(p.weight))
    A, b, w = np.array(rows), np.array(rhs), np.array(base)
    robust = np.ones(len(b))
    x = np.zeros(2 * len(unknown))
    prior = np.tile([0.0, rate_information], len(unknown))
    W = w[:, None]
    for _ in range(iterations):
        W = (w * robust)[:, None]
        x = np.linalg.lstsq(
            np.vstack([W * A, np.diag(np.sqrt(prior))]), np.concatenate([W[:, 0] * b, np.zeros(len(x))]), rcond=None
        )[0]
        residual = A @ x - b
        worst = np.abs(residual).reshape(-1, 2).max(axis=1).repeat(2)
        robust = 1 / np.sqrt(1 + (worst / _ROBUST_SCALE_S) ** 2)
    clocks = {reference: (0.0, 1.0)}
    for c in unknown:
        a, slope = x[column[c]], x[column[c] + 1]
        clocks[c] = (float(a - slope * centre[c]), float(1 + slope))
    return _Solution(clocks, np.asarray(A @ x - b, np.float64), (W * A).T @ (W * A) + np.diag(prior), column)
