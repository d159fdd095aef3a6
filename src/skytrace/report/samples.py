"""Excerpts of a reconstruction small enough for a page: a thinned path, sight intervals, thinned residuals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.geometry.arrays import FloatArray, IntArray, frozen_array
from skytrace.io.run_folder import SUPPORT_S, supporting_cameras
from skytrace.model.reconstruction import CameraEstimate, Reconstruction, Residuals

MAX_PATH_SAMPLES = 6000
MAX_PATH_RATE_HZ = 25.0
MAX_RESIDUALS = 2000
MAX_TRUTH_SAMPLES = 3000


@dataclass(frozen=True, eq=False, slots=True)
class PathSamples:
    """The covered trajectory at about MAX_PATH_SAMPLES times at most, segment after segment."""

    time_s: FloatArray  # (n,)
    position: FloatArray  # (n, 3) in the world
    speed: FloatArray  # (n,) per second
    sigma: FloatArray  # (n,) NaN where no posterior was computed
    n_cameras: IntArray  # (n,)
    segment: IntArray  # (n,)

    def __post_init__(self) -> None:
        object.__setattr__(self, "time_s", frozen_array(self.time_s, (None,), "time_s"))
        n = len(self.time_s)
        object.__setattr__(self, "position", frozen_array(self.position, (n, 3), "position"))
        object.__setattr__(self, "speed", frozen_array(self.speed, (n,), "speed"))
        object.__setattr__(self, "sigma", frozen_array(self.sigma, (n,), "sigma", finite=False))
        object.__setattr__(self, "n_cameras", frozen_array(self.n_cameras, (n,), "n_cameras", np.int64))
        object.__setattr__(self, "segment", frozen_array(self.segment, (n,), "segment", np.int64))


def path_samples(reconstruction: Reconstruction) -> PathSamples:
    """The trajectory sampled evenly, with both ends of every segment."""
    trajectory = reconstruction.trajectory
    # The ends of a segment come on top of its even samples.
    budget = max(MAX_PATH_SAMPLES - 3 * len(trajectory.segments), MAX_PATH_SAMPLES // 2)
    rate_hz = min(MAX_PATH_RATE_HZ, budget / max(trajectory.covered_s, 1.0))
    time_s = trajectory.sample_times(rate_hz)
    return PathSamples(
        time_s,
        trajectory.position(time_s),
        np.linalg.norm(trajectory.velocity(time_s), axis=1),
        trajectory.sigma(time_s),
        supporting_cameras(reconstruction, time_s),
        trajectory.segment_index(time_s),
    )


def sight_intervals(camera: CameraEstimate) -> FloatArray:
    """Begin and end (k, 2) in seconds of the stretches in which detections agreed with the estimate.

    A camera supports exactly the times up to SUPPORT_S outside of them.
    """
    time_s = np.sort(camera.residuals.time_s[camera.residuals.inlier])
    if not len(time_s):
        return np.zeros((0, 2))
    breaks = np.flatnonzero(np.diff(time_s) > 2 * SUPPORT_S)
    return np.column_stack([time_s[np.r_[0, breaks + 1]], time_s[np.r_[breaks, len(time_s) - 1]]])


def thin(n: int, most: int) -> IntArray:
    """Indices, evenly spread over range(n), first and last among them; all when there are not more than `most`."""
    return np.arange(n) if n <= most else np.round(np.linspace(0, n - 1, most)).astype(np.int64)


def running_median(residuals: Residuals, n_bins: int = 120) -> tuple[FloatArray, FloatArray]:
    """Middle times (m,) of equal bins of time and the median error length (m,) of the agreeing detections there.

    NaN in bins with fewer than three of them.
    """
    time_s = residuals.time_s[residuals.inlier]
    if not len(time_s):
        return np.zeros(0), np.zeros(0)
    length_px = np.linalg.norm(residuals.error_px[residuals.inlier], axis=1)
    edges = np.linspace(time_s.min(), time_s.max() + 1e-9, n_bins + 1)
    which = np.clip(np.searchsorted(edges, time_s, side="right") - 1, 0, n_bins - 1)
    median = [np.median(length_px[which == k]) if (which == k).sum() >= 3 else np.nan for k in range(n_bins)]
    return 0.5 * (edges[1:] + edges[:-1]), np.array(median)


def error_histogram(residuals: Residuals, reach_px: float, n_bins: int = 61) -> tuple[FloatArray, FloatArray]:
    """Bin centres (m,) within +-reach_px, and the density per pixel (m, 2) of the errors in x and in y.

    The density counts detections outside the reach too, so the area under it is what lies within.
    """
    edges = np.linspace(-reach_px, reach_px, n_bins + 1)
    counts = np.column_stack([np.histogram(residuals.error_px[:, axis], edges)[0] for axis in (0, 1)])
    width = edges[1] - edges[0]
    return 0.5 * (edges[1:] + edges[:-1]), counts / (max(len(residuals.frame), 1) * width)


def error_field(
    residuals: Residuals, size_px: tuple[int, int], n_columns: int = 12, at_least: int = 20
) -> tuple[FloatArray, FloatArray]:
    """Mean places (m, 2) and mean errors (m, 2), both in px, of the agreeing detections in each cell of the image."""
    xy, error = residuals.measured_px[residuals.inlier], residuals.error_px[residuals.inlier]
    return mean_field(xy, error, size_px, n_columns, at_least)


def mean_field(
    xy: FloatArray, error: FloatArray, size_px: tuple[int, int], n_columns: int, at_least: int
) -> tuple[FloatArray, FloatArray]:
    """Mean places (m, 2) and mean errors (m, 2) in each cell of the image, of places (n, 2) with errors (n, 2).

    Cells are about square; those with fewer than `at_least` places are left out.
    """
    width, height = size_px
    n_rows = max(1, round(n_columns * height / width))
    column = np.clip((xy[:, 0] + 0.5) / width * n_columns, 0, n_columns - 1).astype(np.int64)
    row = np.clip((xy[:, 1] + 0.5) / height * n_rows, 0, n_rows - 1).astype(np.int64)
    cell = row * n_columns + column
    count = np.bincount(cell, minlength=n_rows * n_columns)
    full = np.flatnonzero(count >= at_least)

    def mean(values: FloatArray) -> FloatArray:
        sums = [np.bincount(cell, values[:, axis], minlength=n_rows * n_columns)[full] for axis in (0, 1)]
        return np.column_stack(sums) / count[full, None]

    return mean(xy), mean(error)
