"""Two cameras: from a rough time offset to their relative geometry, offset and clock rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.estimation.correspond import ImagePath
from skytrace.estimation.noise import inflation
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
    misfit: float = np.inf  # see `misfit`
    inflation: float = 1.0  # residuals per independent one, by their correlation in time


_MISFIT_SCALE = 1e-3
_SATURATION = 0.03
_SMALLEST_THRESHOLD = 5e-4
_LONGEST_CORRELATION_S = 10.0
_BLOCK_S = 3.0
_FOCAL_SIGMA = 0.007  # relative: what calibrations are commonly wrong by


def correspond(
    path0: ImagePath, path1: ImagePath, rate_hz: float, offset_s: float, rate: float, count: int | None = None
) -> Correspondences:
    """Correspondences at multiples of 1 / rate_hz of camera 0's time where both paths are defined.

    With `count`, at most that many, evenly chosen.
    """
    time0 = common_times(path0, path1, rate_hz, offset_s, rate)
    return correspond_at(path0, path1, time0 if count is None else evenly(time0, count), offset_s, rate)


def correspond_at(
    path0: ImagePath, path1: ImagePath, time0_s: FloatArray, offset_s: float, rate: float
) -> Correspondences:
    """Correspondences at camera 0's times (n,), at which both paths must be defined."""
    time1 = offset_s + rate * time0_s
    return Correspondences(time0_s, time1, path0.evaluate(time0_s), path1.evaluate(time1), path1.evaluate(time1, 1))


def evenly(values: FloatArray, count: int) -> FloatArray:
    """At most `count` of the values (n,), evenly chosen."""
    if len(values) <= count:
        return values
    return values[np.linspace(0, len(values) - 1, count).round().astype(int)]


def common_times(path0: ImagePath, path1: ImagePath, rate_hz: float, offset_s: float, rate: float) -> FloatArray:
    """The multiples (n,) of 1 / rate_hz of camera 0's time at which both paths are defined."""
    begin = max(path0.begin_s, (path1.begin_s - offset_s) / rate)
    end = min(path0.end_s, (path1.end_s - offset_s) / rate)
    time0 = np.arange(np.ceil(begin * rate_hz), np.floor(end * rate_hz) + 1) / rate_hz
    return time0[path0.defined(time0) & path1.defined(offset_s + rate * time0)]


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
    pairs: Correspondences, threshold: float, max_shift_s: float, rng: np.random.Generator, max_samples: int = 600
) -> tuple[Rigid, float] | None:
    """Relative pose and the correction of the offset by the eight-point solver with time shift, in RANSAC."""
    problem = TimeShiftProblem(pairs.xy0, pairs.xy1, pairs.velocity1, max_shift_s)
    found = ransac(problem, threshold, rng, max_samples=max_samples)
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
    nominal_rate: float | None = None,
    adapt: bool = False,
    residuals_per_independent: float = 1.0,
) -> PairGeometry | None:
    """Minimise the Cauchy loss of the Sampson errors over rotation, baseline direction, offset and clock rate.

    One pass for each threshold (on the plane z = 1), the loss tightening from the first to the last; the rate is held
    near `nominal_rate`, by default the one given, by a Cauchy prior of scale `rate_prior`: clocks are good to far
    better, but nominal frame rates are often another, similar number. Residuals that follow one another in time weigh
    less against it by `residuals_per_independent`. With `adapt` a further pass tightens the loss to what the residuals
    allow. Returns None when too little overlap remains.
    """
    nominal = rate if nominal_rate is None else nominal_rate
    prior = _RatePrior(nominal, rate_prior, residuals_per_independent)
    model = _Model(pose, offset_s, rate)
    fitted: tuple[float, float, FloatArray, FloatArray, Correspondences] | None = None
    passes = [*thresholds, None] if adapt else [*thresholds]
    for threshold in passes:
        pairs = correspond(path0, path1, rate_hz, model.offset_s, model.rate, max_samples)
        if len(pairs) < 16:
            return None
        if threshold is None:
            error = _sampson_jacobian(model.pose, pairs, 0.0)[0]
            threshold = float(np.clip(3 * 1.4826 * np.median(np.abs(error)), _SMALLEST_THRESHOLD, thresholds[-1]))
        centre = float(np.median(pairs.time0_s))
        model, error, J, pairs = _descend(model, pairs, path1, centre, threshold, prior, iterations)
        if len(pairs) < 16:
            return None
        fitted = threshold, centre, error, J, pairs
    if fitted is None:
        raise ValueError("thresholds: expected at least one")
    last, centre, error, J, used = fitted
    correlated = _inflation(error, used.time0_s)
    rate_sigma = float(np.hypot(rate_prior, model.rate - nominal))
    covariance = _covariance(model.pose, used, error, J, last, rate_sigma, correlated)
    overlap_s = len(common_times(path0, path1, rate_hz, model.offset_s, model.rate)) / rate_hz
    pairs = correspond(path0, path1, rate_hz, model.offset_s, model.rate, max_samples)
    good = support(model.pose, pairs, 3 * thresholds[-1])
    return PairGeometry(
        model.pose,
        model.offset_s,
        model.rate,
        centre,
        float(good.mean() * overlap_s) if len(good) else 0.0,
        overlap_s,
        float(np.sqrt(covariance[5, 5])),
        float(np.sqrt(covariance[6, 6])),
        misfit(model.pose, pairs),
        correlated,
    )


@dataclass(frozen=True, eq=False, slots=True)
class _Model:
    """What `refine` estimates."""

    pose: Rigid
    offset_s: float
    rate: float


@dataclass(frozen=True, slots=True)
class _RatePrior:
    """A Cauchy prior of the clock rate, and how many residuals count as one against it."""

    nominal: float
    scale: float
    residuals_per_independent: float

    def loss(self, rate: float) -> float:
        """In units of the sum of the residuals' losses."""
        return self.residuals_per_independent * float(np.log1p(((rate - self.nominal) / self.scale) ** 2))

    def information(self, rate: float) -> float:
        return self.residuals_per_independent / (self.scale**2 + (rate - self.nominal) ** 2)


def _descend(
    model: _Model,
    pairs: Correspondences,
    path1: ImagePath,
    centre: float,
    threshold: float,
    prior: _RatePrior,
    iterations: int,
) -> tuple[_Model, FloatArray, FloatArray, Correspondences]:
    """Levenberg-Marquardt steps at camera 0's times of the pairs; the model, its errors, Jacobian and pairs."""

    def loss(error: FloatArray, rate: float) -> float:
        return float(np.log1p((error / threshold) ** 2).mean()) + prior.loss(rate) / len(error)

    damping = 1e-3
    half_span = max(float(np.ptp(pairs.time0_s)) / 2, 1.0)
    error, J = _sampson_jacobian(model.pose, pairs, centre)
    for _ in range(iterations):
        weight = 1 / (1 + (error / threshold) ** 2)
        H = (J * weight[:, None]).T @ J / threshold**2
        g = J.T @ (weight * error) / threshold**2
        H[6, 6] += prior.information(model.rate)
        g[6] += (model.rate - prior.nominal) * prior.information(model.rate)
        step = -np.asarray(np.linalg.solve(H + damping * np.diag(np.diag(H) + 1e-12), g), np.float64)
        candidate = _Model(*_step(model.pose, model.offset_s, model.rate, centre, step))
        moved = _moved(pairs, path1, candidate.offset_s, candidate.rate)
        if len(moved) < 16:
            break
        moved_error, moved_J = _sampson_jacobian(candidate.pose, moved, centre)
        if loss(moved_error, candidate.rate) < loss(error, model.rate):
            model, pairs, error, J = candidate, moved, moved_error, moved_J
            damping = max(damping / 5, 1e-9)
            if abs(step[5]) < 1e-6 and abs(step[6]) * half_span < 1e-6 and np.abs(step[:5]).max() < 1e-7:
                break
        else:
            damping *= 10
            if damping > 1e6:
                break
    return model, error, J, pairs


def _moved(pairs: Correspondences, path1: ImagePath, offset_s: float, rate: float) -> Correspondences:
    """The same times of camera 0 paired with others of camera 1, where that is defined."""
    time1 = offset_s + rate * pairs.time0_s
    xy1 = path1.evaluate(time1)
    seen = np.isfinite(xy1[:, 0])
    if not seen.all():
        time1, xy1 = time1[seen], xy1[seen]
    time0, xy0 = (pairs.time0_s, pairs.xy0) if seen.all() else (pairs.time0_s[seen], pairs.xy0[seen])
    return Correspondences(time0, time1, xy0, xy1, path1.evaluate(time1, 1))


def _inflation(error: FloatArray, time_s: FloatArray) -> float:
    """Residuals (n,) per independent one."""
    sigma = max(1.4826 * float(np.median(np.abs(error))), 1e-9)
    step_s = max(float(np.median(np.diff(time_s))), 1e-9) if len(time_s) > 1 else 1.0
    index = np.rint((time_s - time_s[0]) / step_s).astype(np.int64)
    signed = np.column_stack([error, np.zeros_like(error)])
    return inflation(signed, index, sigma, 1 / step_s, _LONGEST_CORRELATION_S)


def _covariance(
    pose: Rigid,
    pairs: Correspondences,
    error: FloatArray,
    J: FloatArray,
    threshold: float,
    rate_sigma: float,
    correlated: float,
) -> FloatArray:
    """Covariance (7, 7) of the refined parameters, from noise and from what the calibration may be wrong by.

    Residuals that follow one another in time count as fewer. Focal lengths that were held although they are known to
    `_FOCAL_SIGMA` only add what their deviation would have moved the parameters by.
    """
    weight = 1 / (1 + (error / threshold) ** 2)
    sigma = max(1.4826 * float(np.median(np.abs(error))), 1e-9)
    H = (J * weight[:, None]).T @ J
    H[6, 6] += sigma**2 * correlated / rate_sigma**2
    inverse = np.linalg.pinv(H, hermitian=True)
    moved = inverse @ ((J * weight[:, None]).T @ _focal_jacobian(pose, pairs)) * _FOCAL_SIGMA
    formal = inverse * (sigma**2 * correlated)
    spread = inverse @ _scatter(J * (weight * error)[:, None], pairs.time0_s) @ inverse
    # Where stretches of false detections remain, residuals pull together and the spread exceeds the formal figure.
    larger = np.sqrt(np.maximum(np.diag(spread) / np.maximum(np.diag(formal), 1e-300), 1.0))
    return formal * np.outer(larger, larger) + moved @ moved.T


def _scatter(pull: FloatArray, time_s: FloatArray) -> FloatArray:
    """Second moment (k, k) of the residuals' pulls (n, k) on the parameters, summed in blocks of a few seconds."""
    block = ((time_s - time_s[0]) // _BLOCK_S).astype(np.int64)
    sums = np.zeros((int(block.max()) + 1, pull.shape[1]))
    np.add.at(sums, block, pull)
    used = max(len(np.unique(block)), 1)
    return sums.T @ sums * used / max(used - pull.shape[1], 1)


def _focal_jacobian(pose: Rigid, pairs: Correspondences) -> FloatArray:
    """Derivatives (n, 2) of the Sampson errors by the relative errors of both focal lengths."""
    x0, x1 = epipolar.homogeneous(pairs.xy0), epipolar.homogeneous(pairs.xy1)
    E = epipolar.essential_matrix(pose)
    line1, line0 = x0 @ E.T, x1 @ E
    norm = np.sqrt(np.maximum((line1[:, :2] ** 2).sum(1) + (line0[:, :2] ** 2).sum(1), 1e-300))
    # x^T E y is linear in either point, and a focal length scales the first two coordinates of one.
    return np.column_stack([(line0[:, :2] * pairs.xy0).sum(1), (line1[:, :2] * pairs.xy1).sum(1)]) / norm[:, None]


def misfit(pose: Rigid, pairs: Correspondences) -> float:
    """Mean logarithmic loss of a pose: near 0 for exact pairs, 4 to 7 for a pose fitted to unrelated tracks.

    Its scale is one milliradian, about what calibration errors leave; errors saturate, so that no outlier dominates.
    """
    error = np.abs(epipolar.sampson_error(epipolar.essential_matrix(pose), pairs.xy0, pairs.xy1))
    depth0, depth1 = epipolar.relative_depths(pose, pairs.xy0, pairs.xy1)
    error = np.where((depth0 > 0) & (depth1 > 0), np.minimum(error, _SATURATION), _SATURATION)
    return float(np.log1p((error / _MISFIT_SCALE) ** 2).mean()) if len(pairs) else np.inf


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
    directions = np.stack(
        [t_hat @ hat(axis) @ R for axis in np.eye(3)] + [hat(tangent) @ R for tangent in _tangent(pose.translation).T]
    )
    line1, line0 = x0 @ E.T, x1 @ E
    numerator = (line1 * x1).sum(1)
    norm2 = np.maximum((line1[:, :2] ** 2).sum(1) + (line0[:, :2] ** 2).sum(1), 1e-300)

    d_line1 = np.empty((n, 6, 3))
    d_line0 = np.empty((n, 6, 3))
    d_line1[:, :5] = (x0 @ directions.reshape(15, 3).T).reshape(n, 5, 3)
    d_line0[:, :5] = (x1 @ directions.transpose(1, 0, 2).reshape(3, 15)).reshape(n, 5, 3)
    # A later time moves the point of camera 1 and with it the line in camera 0 only.
    v = np.column_stack([pairs.velocity1, np.zeros(n)])
    d_line1[:, 5], d_line0[:, 5] = 0.0, v @ E
    d_numerator = np.einsum("nkc,nc->nk", d_line1, x1)
    d_numerator[:, 5] = (line1 * v).sum(1)
    d_half_norm2 = np.einsum("nkc,nc->nk", d_line1[:, :, :2], line1[:, :2])
    d_half_norm2 += np.einsum("nkc,nc->nk", d_line0[:, :, :2], line0[:, :2])
    norm = np.sqrt(norm2)
    J = np.empty((n, 7))
    J[:, :6] = (d_numerator - (numerator / norm2)[:, None] * d_half_norm2) / norm[:, None]
    J[:, 6] = J[:, 5] * (pairs.time0_s - centre_s)
    return numerator / norm, J


def inliers(pose: Rigid, pairs: Correspondences, threshold: float) -> BoolArray:
    """Correspondences (n,) in front of both cameras with a Sampson error below the threshold."""
    return support(pose, pairs, threshold) > 0
