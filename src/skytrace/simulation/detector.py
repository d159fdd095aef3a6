"""What a detector makes of the true image positions: noise, absences, false detections."""

from __future__ import annotations

import numpy as np

from skytrace.geometry.arrays import BoolArray, FloatArray, IntArray
from skytrace.simulation.scenario import Scenario
from skytrace.simulation.wander import wander

_ABSENCE_S = 1.5
_CLUSTER_S = 1.0


def random_spans(n: int, share: float, mean_length: float, rng: np.random.Generator) -> IntArray:
    """Label n consecutive frames: -1, or the number of the random span a frame belongs to.

    The spans last 0.5 to 1.5 times the mean length and together cover the share of the frames, to a frame.
    """
    label = np.full(n, -1, np.int64)
    missing, k = round(share * n), 0
    while missing > 0:
        length = max(1, round(mean_length * rng.uniform(0.5, 1.5)))
        start = int(rng.integers(1 - length, n))
        free = np.flatnonzero(label[max(start, 0) : start + length] < 0)[:missing] + max(start, 0)
        label[free] = k
        missing -= len(free)
        k += 1
    return label


def detect(
    true_xy_px: FloatArray, frame_rate_hz: float, size_px: tuple[int, int], scenario: Scenario, rng: np.random.Generator
) -> tuple[IntArray, FloatArray, BoolArray]:
    """One detection at most for each of n consecutive frames, given true positions (n, 2), NaN where not in view.

    Returns the indices (m,) of the frames with a detection, their measured pixels (m, 2), and which are false (m,).
    """
    absence_rng, false_rng, cluster_rng, noise_rng, drift_rng = rng.spawn(5)
    n = len(true_xy_px)
    absent = random_spans(n, scenario.dropout_fraction, _ABSENCE_S * frame_rate_hz, absence_rng) >= 0
    true_seen = np.isfinite(true_xy_px[:, 0]) & ~absent
    uniform_share, clustered_share = _false_shares(scenario, n, int(true_seen.sum()))

    xy_px = true_xy_px + scenario.noise_px * noise_rng.normal(size=(n, 2))
    if scenario.drift_px > 0 and n:
        xy_px += _drift(n, frame_rate_hz, scenario, drift_rng)
    span = random_spans(n, clustered_share, _CLUSTER_S * frame_rate_hz, cluster_rng)
    for k in range(span.max(initial=-1) + 1):
        frames = np.flatnonzero(span == k)
        if len(frames):
            xy_px[frames] = _cluster(frames, true_xy_px, frame_rate_hz, size_px, scenario.noise_px, cluster_rng)
    free = np.flatnonzero(span < 0)
    uniform = false_rng.permutation(free)[: round(uniform_share * n)]
    xy_px[uniform] = false_rng.uniform(0, 1, (len(uniform), 2)) * (np.array(size_px) - 1)

    false = span >= 0
    false[uniform] = True
    if scenario.quantise:
        xy_px = np.rint(xy_px)
    with np.errstate(invalid="ignore"):
        inside = (xy_px >= 0).all(1) & (xy_px <= np.array(size_px) - 1).all(1)
    index = np.flatnonzero((true_seen | false) & inside)
    return index, xy_px[index], false[index]


def _drift(n: int, frame_rate_hz: float, scenario: Scenario, rng: np.random.Generator) -> FloatArray:
    """A bias (n, 2) that wanders, of half to one and a half times the scenario's deviation in any one camera."""
    deviation_px = scenario.drift_px * rng.uniform(0.5, 1.5)
    correlation = float(np.exp(-1 / (scenario.drift_s * frame_rate_hz)))
    return deviation_px * np.column_stack([wander(n, correlation, rng), wander(n, correlation, rng)])


def _false_shares(scenario: Scenario, n_frames: int, n_seen: int) -> tuple[float, float]:
    """Shares of all frames that hold a uniform and a clustered false detection.

    A false detection hides the true one of its frame, or fills a frame without one. The shares are such that false
    detections are the scenario's fractions of all detections, however much of the time the target is in view.
    """
    fraction = scenario.outlier_fraction + scenario.clustered_fraction
    if fraction == 0 or n_frames == 0:
        return 0.0, 0.0
    share = fraction * n_seen / (n_frames * (1 - fraction) + fraction * n_seen)
    return share * scenario.outlier_fraction / fraction, share * scenario.clustered_fraction / fraction


def _cluster(
    frames: IntArray,
    true_xy_px: FloatArray,
    frame_rate_hz: float,
    size_px: tuple[int, int],
    noise_px: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Pixels (k, 2) of a false blob in frames (k,): stuck in one place, or a bird that crosses at constant velocity.

    Half of the stuck blobs stay some pixels off a place where the target was, as a detector caught by a cloud does.
    """
    size = np.array(size_px) - 1.0
    start, goal = rng.uniform(0.05, 0.95, (2, 2)) * size
    distance = float(np.linalg.norm(goal - start))
    heading = (goal - start) / distance
    velocity = np.zeros(2)
    elapsed_s = (frames - frames[0]) / frame_rate_hz
    if rng.uniform() < 0.5:
        # Not past the goal, so that the bird stays in the image.
        speed_px_s = min(rng.uniform(0.02, 0.15) * size_px[0], distance / max(elapsed_s[-1], 1e-9))
        velocity = heading * speed_px_s
    elif rng.uniform() < 0.5 and np.isfinite(true_xy_px[frames[0]]).all():
        start = np.clip(true_xy_px[frames[0]] + heading * rng.uniform(0.005, 0.02) * size_px[0], 0, size)
    return start + velocity * elapsed_s[:, None] + noise_px * rng.normal(size=(len(frames), 2))
