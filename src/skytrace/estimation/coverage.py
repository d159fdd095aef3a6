"""Where the trajectory may be claimed: supported by two cameras that agree with it, and known well enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
    camera_times_s: Sequence[FloatArray],
    settings: CoverageSettings,
) -> Trajectory:
    """The spline cut to covered segments.

    `knot_sigma` (knots,) are posterior deviations at the knots of each run, `camera_times_s` the ascending times of
    each camera's agreeing detections.
    """
    pieces = list(_runs(grid, control, knot_sigma))
    limit = settings.max_sigma_ratio * _median_sigma(pieces, grid.spacing_s, camera_times_s, settings)
    segments = []
    for start_s, run_control, sigma in pieces:
        end_s = start_s + grid.spacing_s * (len(run_control) - 3)
        time = np.arange(np.ceil(start_s / settings.step_s), np.floor(end_s / settings.step_s) + 1) * settings.step_s
        time = time[(time >= start_s) & (time < end_s)]
        deviation = np.interp(time, start_s + grid.spacing_s * np.arange(len(sigma)), sigma)
        good = (support(time, camera_times_s, settings.window_s) >= settings.min_cameras) & (deviation <= limit)
        edges = np.flatnonzero(np.diff(np.r_[False, good, False].astype(int)))
        for a, b in zip(edges[::2], edges[1::2] - 1, strict=True):
            if time[b] - time[a] >= settings.min_segment_s:
                segments.append(_cut(start_s, grid.spacing_s, run_control, sigma, float(time[a]), float(time[b])))
    return Trajectory(tuple(segments))


def _runs(grid: KnotGrid, control: FloatArray, knot_sigma: FloatArray):
    """(start time, control points, knot deviations) of each run of the grid."""
    c = k = 0
    for a, b in grid.runs:
        n = b - a
        yield a * grid.spacing_s, control[c : c + n + 3], knot_sigma[k : k + n + 1]
        c, k = c + n + 3, k + n + 1


def _median_sigma(
    pieces: list, spacing_s: float, camera_times_s: Sequence[FloatArray], settings: CoverageSettings
) -> float:
    """Median deviation over the knots that enough cameras support."""
    values = []
    for start_s, _, sigma in pieces:
        knots = start_s + spacing_s * np.arange(len(sigma))
        values.append(sigma[support(knots, camera_times_s, settings.window_s) >= settings.min_cameras])
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
