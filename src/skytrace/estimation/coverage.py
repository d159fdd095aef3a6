"""Where the trajectory may be claimed: supported by cameras that agree with it, and known well enough."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from skytrace.estimation.adjust.problem import KnotGrid
from skytrace.geometry.arrays import BoolArray, FloatArray, IntArray
from skytrace.model.trajectory import Segment, Trajectory


@dataclass(frozen=True, slots=True)
class CoverageSettings:
    min_cameras: int = 2
    window_s: float = 0.25  # a camera supports a time if it has an agreeing detection this close
    min_segment_s: float = 1.0
    inlier_sigmas: float = 5.0
    max_sigma_ratio: float = 5.0  # of the posterior deviation to its median: beyond, a stretch is not claimed
    step_s: float = 0.05


# Why a time is not claimed, in the order in which reasons are looked for.
CLAIMED, TOO_FEW, DISAGREE, UNCERTAIN, SHORT = range(5)
CUT_REASONS: Mapping[int, str] = MappingProxyType(
    {
        TOO_FEW: "too_few_cameras",
        DISAGREE: "cameras_disagree",
        UNCERTAIN: "too_uncertain",
        SHORT: "too_short",
    }
)


@dataclass(frozen=True, slots=True)
class Cuts:
    """For how long the target was seen by any camera, and for how much of that nothing is claimed, by CUT_REASONS."""

    seen_s: float
    cut_s: Mapping[str, float]


def inliers(residual_px: FloatArray, sigma_px: float, sigmas: float) -> BoolArray:
    """Detections (n,) whose residuals (n, 2) agree with the estimate."""
    return np.nan_to_num(np.linalg.norm(residual_px, axis=1), nan=np.inf) <= sigmas * sigma_px


def support(time_s: FloatArray, camera_times_s: Sequence[FloatArray], window_s: float) -> IntArray:
    """Number of cameras (n,) that have a detection within a window of each time (n,); each camera's times ascend."""
    count = np.zeros(len(time_s), np.int64)
    for times in camera_times_s:
        count += np.searchsorted(times, time_s + window_s, "right") > np.searchsorted(times, time_s - window_s, "left")
    return count


def covered_trajectory(
    grid: KnotGrid,
    control: FloatArray,
    knot_sigma: FloatArray,
    agreeing_s: Sequence[FloatArray],
    settings: CoverageSettings,
    shape_sigma: FloatArray | None = None,
    seen_s: Sequence[FloatArray] | None = None,
) -> tuple[Trajectory, Cuts]:
    """The spline cut to covered segments, and why the rest is not claimed.

    `knot_sigma` (knots,) are posterior deviations at the knots of each run, `agreeing_s` the ascending times of each
    camera's agreeing detections, `seen_s` those of all its detections (by default the same). Deviations that tell what
    is claimed are `shape_sigma` (knots,) where given: how well the place of the whole is known does not tell good
    stretches from bad ones.
    """
    seen_s = agreeing_s if seen_s is None else seen_s
    pieces = list(_runs(grid, control, knot_sigma if shape_sigma is None else shape_sigma))
    limit = settings.max_sigma_ratio * _median_sigma(pieces, grid.spacing_s, agreeing_s, settings)
    segments, spans = [], []
    inside = np.zeros(len(CUT_REASONS) + 1)
    for (start_s, run_control, sigma), (_, _, claim) in zip(pieces, _runs(grid, control, knot_sigma), strict=True):
        time = _steps(start_s, start_s + grid.spacing_s * (len(run_control) - 3), settings.step_s)
        deviation = np.interp(time, start_s + grid.spacing_s * np.arange(len(sigma)), sigma)
        verdict = _verdicts(time, agreeing_s, seen_s, settings)
        verdict[(verdict == CLAIMED) & (deviation > limit)] = UNCERTAIN
        edges = np.flatnonzero(np.diff(np.r_[False, verdict == CLAIMED, False].astype(int)))
        for a, b in zip(edges[::2], edges[1::2] - 1, strict=True):
            if time[b] - time[a] >= settings.min_segment_s:
                segments.append(_cut(start_s, grid.spacing_s, run_control, claim, float(time[a]), float(time[b])))
            else:
                verdict[a : b + 1] = SHORT
        seen = support(time, seen_s, settings.window_s) > 0
        inside += np.bincount(verdict[seen], minlength=len(inside))
        if len(time):
            spans.append((time[0], time[-1]))
    total = inside + _beyond(spans, agreeing_s, seen_s, settings)
    cut_s = {name: settings.step_s * float(total[reason]) for reason, name in CUT_REASONS.items()}
    return Trajectory(tuple(segments)), Cuts(settings.step_s * float(total.sum()), MappingProxyType(cut_s))


def _verdicts(
    time_s: FloatArray, agreeing_s: Sequence[FloatArray], seen_s: Sequence[FloatArray], settings: CoverageSettings
) -> IntArray:
    """Whether enough cameras see the target and agree at times (n,): CLAIMED, DISAGREE or TOO_FEW."""
    seen, agreeing = (
        support(time_s, times, settings.window_s) >= settings.min_cameras for times in (seen_s, agreeing_s)
    )
    return np.where(agreeing, CLAIMED, np.where(seen, DISAGREE, TOO_FEW))


def _beyond(
    spans: Sequence[tuple[float, float]],
    agreeing_s: Sequence[FloatArray],
    seen_s: Sequence[FloatArray],
    settings: CoverageSettings,
) -> FloatArray:
    """Steps by verdict at which the target was seen where there is no spline, which enough cameras alone can build."""
    everything = [times for times in seen_s if len(times)]
    if not everything:
        return np.zeros(len(CUT_REASONS) + 1)
    window_s = settings.window_s
    time = _steps(min(t[0] for t in everything) - window_s, max(t[-1] for t in everything) + window_s, settings.step_s)
    half_s = 0.5 * settings.step_s
    for begin_s, end_s in spans:
        time = time[(time < begin_s - half_s) | (time > end_s + half_s)]
    time = time[support(time, seen_s, window_s) > 0]
    verdict = _verdicts(time, agreeing_s, seen_s, settings)
    # Cameras that see the target there did not meet anywhere.
    verdict[verdict == CLAIMED] = DISAGREE
    return np.bincount(verdict, minlength=len(CUT_REASONS) + 1).astype(np.float64)


def _steps(begin_s: float, end_s: float, step_s: float) -> FloatArray:
    """Multiples of a step from `begin_s` to before `end_s`."""
    time = np.arange(np.ceil(begin_s / step_s), np.floor(end_s / step_s) + 1) * step_s
    return np.asarray(time[(time >= begin_s) & (time < end_s)], np.float64)


def _runs(
    grid: KnotGrid, control: FloatArray, knot_sigma: FloatArray
) -> Iterator[tuple[float, FloatArray, FloatArray]]:
    """(start time, control points, knot deviations) of each run of the grid."""
    c = k = 0
    for a, b in grid.runs:
        n = b - a
        yield a * grid.spacing_s, control[c : c + n + 3], knot_sigma[k : k + n + 1]
        c, k = c + n + 3, k + n + 1


def _median_sigma(
    pieces: Sequence[tuple[float, FloatArray, FloatArray]],
    spacing_s: float,
    agreeing_s: Sequence[FloatArray],
    settings: CoverageSettings,
) -> float:
    """Median deviation over the knots that enough cameras support."""
    values = []
    for start_s, _, sigma in pieces:
        knots = np.asarray(start_s + spacing_s * np.arange(len(sigma)), np.float64)
        values.append(sigma[support(knots, agreeing_s, settings.window_s) >= settings.min_cameras])
    everything = np.concatenate(values) if values else np.zeros(0)
    return float(np.median(everything)) if len(everything) else np.inf


def _cut(
    start_s: float, spacing_s: float, control: FloatArray, sigma: FloatArray, begin_s: float, end_s: float
) -> Segment:
    """The part of a run that carries [begin_s, end_s]."""
    first = int(np.floor((begin_s - start_s) / spacing_s))
    last = min(int(np.floor((end_s - start_s) / spacing_s)), len(control) - 4)
    return Segment(
        start_s + first * spacing_s,
        spacing_s,
        control[first : last + 4],
        begin_s,
        end_s,
        sigma[first : last + 2],
    )
