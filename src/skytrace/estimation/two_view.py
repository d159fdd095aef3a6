"""Two cameras: from a rough time offset to their relative geometry, offset and clock rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.estimation.correspond import ImagePath
from skytrace.geometry import epipolar
from skytrace.geometry.arrays import BoolArray, FloatArray
from skytrace.geometry.rigid import Rigid, hat, so3_exp
from skytrace.solvers.ransac import ransac
from skytrace.solvers.time_shift import TimeShiftProblem


@dataclass(frozen=True, eq=False, slots=True)
class Correspondences:
    """Where both cameras saw the target at one time: camera times of both, positions, and velocity in camera 1."""

    time0_s: FloatArray  # (n,)
    time1_s: FloatArray  # (n,)
    xy0: FloatArray  # (n, 2) on the plane z = 1
    xy1: FloatArray  # (n, 2)
    velocity1: FloatArray  # (n, 2) per second

    def __len__(self) -> int:
        return len(self.time0_s)


@dataclass(frozen=True, eq=False, slots=True)
class PairGeometry:
    """camera1_from_camera0 with unit baseline; camera time 1 = offset_s + rate * camera time 0."""

    camera1_from_camera0: Rigid
    offset_s: float
    rate: float
    centre_s: float  # camera time 0 in the middle of the overlap, where the offset is best known
    support_s: float  # seconds of overlap that obey the geometry, each sample weighted by 1 - (error / threshold)^2
    overlap_s: float
    offset_sigma_s: float = np.inf  # formal, at the middle of the overlap
    rate_sigma: float = np.inf


def correspond(path0: ImagePath, path1: ImagePath, rate_hz: float, offset_s: float, rate: float) -> Correspondences:
    """Correspondences at multiples of 1 / rate_hz of camera 0's time where both paths are defined."""
    begin = max(path0.begin_s, (path1.begin_s - offset_s) / rate)
    end = min(path0.end_s, (path1.end_s - offset_s) / rate)
    time0 = np.arange(np.ceil(begin * rate_hz), np.floor(end * rate_hz) + 1) / rate_hz
    time1 = offset_s + rate * time0
    xy0, xy1 = path0.evaluate(time0), path1.evaluate(time1)
    both = np.isfinite(xy0[:, 0]) & np.isfinite(xy1[:, 0])
    return Correspondences(time0[both], time1[both], xy0[both], xy1[both], path1.evaluate(time1[both], 1))


def thin(pairs: Correspondences, count: int) -> Correspondences:
    """At most `count` correspondences, evenly chosen."""
    if len(pairs) <= count:
        return pairs
    rows = np.linspace(0, len(pairs) - 1, count).round().astype(int)
    return Correspondences(
        pairs.time0_s[rows], pairs.time1_s[rows], pairs.xy0[rows], pairs.xy1[rows], pairs.velocity1[rows]
    )


def five_point_pose(
    pairs: Correspondences, threshold: float, seed: int, max_samples: int = 1000, min_samples: int = 100
) -> Rigid | None:
    """Relative pose where the offset is known, by five points in a locally optimised RANSAC (Nister 2004, PoseLib).

    `threshold` is a Sampson error on the plane z = 1. None where no pose explains at least ten correspondences.
    """
    import poselib

    if len(pairs) < 10:
        return None
    camera = {"model": "SIMPLE_PINHOLE", "width": 2, "height": 2, "params": [1.0, 0.0, 0.0]}
    options = {
        "max_epipolar_error": threshold,
        "max_iterations": max_samples,
        "min_iterations": min_samples,
        "seed": seed,
    }
    pose, info = poselib.estimate_relative_pose(pairs.xy0, pairs.xy1, camera, camera, options, {})
    translation = np.asarray(pose.t, float)
    if info["num_inliers"] < 10 or not np.linalg.norm(translation) > 0 or not np.isfinite(translation).all():
        return None
    return Rigid(np.asarray(pose.R, float), translation / np.linalg.norm(translation))


def time_shift_pose(
    pairs: Correspondences, threshold: float, max_shift_s: float, rng: np.random.Generator
) -> tuple[Rigid, float] | None:
    """Relative pose and the correction of the offset by the eight-point solver with time shift, in RANSAC."""
    problem = TimeShiftProblem(pairs.xy0, pairs.xy1, pairs.velocity1, max_shift_s)
    found = ransac(problem, threshold, rng, max_samples=600)
    if found is None or found.inlier.sum() < 16:
        return None
    F, shift_s = found.model[:9].reshape(3, 3), float(found.model[9])
    xy0, xy1 = pairs.xy0[found.inlier], (pairs.xy1 + shift_s * pairs.velocity1)[found.inlier]
    pose, in_front = epipolar.choose_pose(epipolar.decompose_essential(F), xy0, xy1)
    return (pose, shift_s) if in_front > 0.5 else None


def support(pose: Rigid, pairs: Correspondences, threshold: float) -> FloatArray:
    """How well each correspondence (n,) obeys a pose: 1 - (Sampson error / threshold)^2, 0 for outliers."""
    error = epipolar.sampson_error(epipolar.essential_matrix(pose), pairs.xy0, pairs.xy1)
    depth0, depth1 = epipolar.relative_depths(pose, pairs.xy0, pairs.xy1)
    return np.where((depth0 > 0) & (depth1 > 0), np.maximum(0.0, 1 - (error / threshold) ** 2), 0.0)


def refine(
    path0: ImagePath,
    path1: ImagePath,
    pose: Rigid,
    offset_s: float,
    rate: float,
    *,
    rate_hz: float,
    thresholds: tuple[float, ...],
    rate_prior: float,
    max_samples: int = 2000,
    iterations: int = 12,
) -> PairGeometry | None:
    """Minimise the Cauchy loss of the Sampson errors over rotation, baseline direction, offset and clock rate.

    One pass for each threshold (on the plane z = 1), the loss tightening from the first to the last; the rate is held
    near the one given by a Gaussian prior of deviation `rate_prior`. Returns None when too little overlap remains.
    """
    nominal_rate = rate
    cov = np.full((7, 7), np.inf)
    pairs = correspond(path0, path1, rate_hz, offset_s, rate)
    for threshold in thresholds:
        damping = 1e-3
        pairs = thin(correspond(path0, path1, rate_hz, offset_s, rate), max_samples)
        if len(pairs) < 16:
            return None
        centre = float(np.median(pairs.time0_s))
        half_span = max(float(np.ptp(pairs.time0_s)) / 2, 1.0)
        error, J = _sampson_jacobian(pose, pairs, centre)
        for _ in range(iterations):
            weight = 1 / (1 + (error / threshold) ** 2)
            H = (J * weight[:, None]).T @ J / threshold**2
            g = J.T @ (weight * error) / threshold**2
            H[6, 6] += rate_prior**-2
            g[6] += (rate - nominal_rate) * rate_prior**-2
            cost = np.log1p((error / threshold) ** 2).mean() + ((rate - nominal_rate) / rate_prior) ** 2 / len(error)
            step = -np.asarray(np.linalg.solve(H + damping * np.diag(np.diag(H) + 1e-12), g), np.float64)
            candidate = _step(pose, offset_s, rate, centre, step)
            moved = thin(correspond(path0, path1, rate_hz, candidate[1], candidate[2]), max_samples)
            if len(moved) < 16:
                return None
            moved_error, moved_J = _sampson_jacobian(candidate[0], moved, centre)
            stray = (candidate[2] - nominal_rate) / rate_prior
            moved_cost = np.log1p((moved_error / threshold) ** 2).mean() + stray**2 / len(moved_error)
            if moved_cost < cost:
                (pose, offset_s, rate), pairs, error, J = candidate, moved, moved_error, moved_J
                damping = max(damping / 5, 1e-9)
                if abs(step[5]) < 1e-6 and abs(step[6]) * half_span < 1e-6 and np.abs(step[:5]).max() < 1e-7:
                    break
            else:
                damping *= 10
                if damping > 1e6:
                    break
        weight = 1 / (1 + (error / threshold) ** 2)
        sigma = max(1.4826 * float(np.median(np.abs(error))), 1e-9)
        H = (J * weight[:, None]).T @ J / sigma**2
        H[6, 6] += rate_prior**-2
        cov = np.linalg.pinv(H)
    pairs = correspond(path0, path1, rate_hz, offset_s, rate)
    good = support(pose, pairs, 3 * thresholds[-1])
    return PairGeometry(
        pose,
        offset_s,
        rate,
        centre,
        float(good.sum() / rate_hz),
        len(pairs) / rate_hz,
        float(np.sqrt(cov[5, 5])),
        float(np.sqrt(cov[6, 6])),
    )


def _step(pose: Rigid, offset_s: float, rate: float, centre_s: float, step: FloatArray) -> tuple[Rigid, float, float]:
    """Apply a step (7,): rotation (3), baseline direction (2), offset at `centre_s` (1), rate (1)."""
    baseline = pose.translation + _tangent(pose.translation) @ step[3:5]
    moved = Rigid(so3_exp(step[:3]) @ pose.rotation, baseline / np.linalg.norm(baseline))
    return moved, offset_s + step[5] - step[6] * centre_s, rate + step[6]


def _tangent(direction: FloatArray) -> FloatArray:
    """Two unit vectors (3, 2) orthogonal to a unit direction (3,)."""
    return np.linalg.svd(direction[None])[2][1:].T


def _sampson_jacobian(pose: Rigid, pairs: Correspondences, centre_s: float) -> tuple[FloatArray, FloatArray]:
    """Signed Sampson errors (n,) and their derivatives (n, 7) by the parameters of `_step`."""
    x0, x1 = epipolar.homogeneous(pairs.xy0), epipolar.homogeneous(pairs.xy1)
    n = len(x0)
    E = epipolar.essential_matrix(pose)
    t_hat, R = hat(pose.translation), pose.rotation
    directions = [t_hat @ hat(axis) @ R for axis in np.eye(3)]
    directions += [hat(tangent) @ R for tangent in _tangent(pose.translation).T]
    line1, line0 = x0 @ E.T, x1 @ E
    numerator = (line1 * x1).sum(1)
    norm2 = (line1[:, :2] ** 2).sum(1) + (line0[:, :2] ** 2).sum(1)
    norm = np.sqrt(np.maximum(norm2, 1e-300))

    J = np.empty((n, 7))
    for k, dE in enumerate(directions):
        d_line1, d_line0 = x0 @ dE.T, x1 @ dE
        d_numerator = (d_line1 * x1).sum(1)
        d_norm2 = 2 * ((line1[:, :2] * d_line1[:, :2]).sum(1) + (line0[:, :2] * d_line0[:, :2]).sum(1))
        J[:, k] = d_numerator / norm - 0.5 * numerator * d_norm2 / (norm2 * norm)
    v = np.column_stack([pairs.velocity1, np.zeros(n)])
    d_line0 = v @ E
    d_norm2 = 2 * (line0[:, :2] * d_line0[:, :2]).sum(1)
    J[:, 5] = (line1 * v).sum(1) / norm - 0.5 * numerator * d_norm2 / (norm2 * norm)
    J[:, 6] = J[:, 5] * (pairs.time0_s - centre_s)
    return numerator / norm, J


def inliers(pose: Rigid, pairs: Correspondences, threshold: float) -> BoolArray:
    """Correspondences (n,) in front of both cameras with a Sampson error below the threshold."""
    return support(pose, pairs, threshold) > 0
