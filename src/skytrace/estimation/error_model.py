"""What the residuals tell of the errors of the detections: white noise, and errors that last for seconds.

Detections drift, and lenses deviate a little from their models: the residuals of a camera stay alike for seconds. Two
things hide such slow errors from the residuals. The trajectory follows them, those of a camera that outweighs the
others nearly altogether; and poses, clocks and lenses follow them, the more the shorter the flight. Both are known from
the linearised adjustment, so the errors' variances are those that would leave the residuals that were found: the method
of moments for variance components (Henderson, "Estimation of variance and covariance components", 1953).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.estimation import noise
from skytrace.estimation.adjust import reference
from skytrace.estimation.influence import Influence
from skytrace.estimation.slow_errors import absorbed_at, slow_gradient
from skytrace.geometry.arrays import FloatArray

_STEP_S = 0.1  # residuals are compared at multiples of this
_LONGEST_S = 10.0
_FLIGHTS = 6.0  # at most so many lags fit into the time that was seen
_SHORTEST_CORRELATION_S, _LONGEST_CORRELATION_S = 0.3, 8.0
_ALIKE = 1.0  # how far cameras' slow variances are from a common one, relative to the larger of the two
_LEFT_ERROR = 0.03  # of what a slow error leaves in residuals: that of a lasting bias stands for one that wanders
_ITERATIONS = 3
_LEAST_WHITE = 0.05  # share of the residuals' variance that is white at least
_LEAST_LEFT = 0.1  # where the fit spends nearly all detections, residuals tell nothing


@dataclass(frozen=True, eq=False, slots=True)
class ErrorModel:
    """Errors of a camera's detections along either axis: white ones, and ones with autocorrelation exp(-lag / T)."""

    white_px2: FloatArray  # (c,) variances
    slow_px2: FloatArray  # (c,) variances
    correlation_s: float  # T
    hidden: float  # share of the slow errors' variance that poses, clocks and lenses took out of the residuals


@dataclass(frozen=True, eq=False, slots=True)
class _Seen:
    """What residuals show of slow errors."""

    lag_s: FloatArray  # (l,)
    covariance: FloatArray  # (c, l) of each camera's effective errors
    variance: FloatArray  # (c,)
    span_s: float  # of the flight


def error_model(influence: Influence) -> ErrorModel:
    """Estimate the errors behind the residuals of an adjustment."""
    seen = _covariances(influence)
    left = influence.left_in_residuals()
    relative = 1 / np.maximum(seen.variance, 1e-300)
    hidden, correlation_s = np.zeros(len(seen.lag_s)), _SHORTEST_CORRELATION_S
    slow_px2 = seen_px2 = np.zeros(len(left))
    for _ in range(_ITERATIONS):
        correlation_s = _correlation_time(seen.lag_s, relative @ seen.covariance, hidden)
        shape = np.exp(-seen.lag_s / correlation_s) - hidden
        seen_px2 = np.maximum(seen.covariance @ shape / (shape @ shape), 0.0)
        slow_px2 = _variances(left, seen_px2, relative, np.sqrt(correlation_s / seen.span_s))
        if not slow_px2.any():
            break
        hidden = _hidden(influence, slow_px2, correlation_s, left, seen.lag_s)
    white_px2 = np.maximum(seen.variance - (1 - hidden[0]) * seen_px2, _LEAST_WHITE * seen.variance)
    white_px2 /= np.maximum(influence.white_left(), _LEAST_LEFT)
    return ErrorModel(white_px2, slow_px2, correlation_s, float(hidden[0]))


def _covariances(influence: Influence) -> _Seen:
    adjusted = influence.adjusted
    camera, error = adjusted.problem.observations.camera, influence.effective_px
    used = np.flatnonzero(np.isfinite(error[:, 0]))
    time_s = reference.exposure_s(adjusted.problem, adjusted.state, used)
    camera, error = camera[used], error[used]
    step = np.floor((time_s - time_s.min()) / _STEP_S).astype(np.int64)
    span_s = float(np.ptp(time_s))
    longest = max(2, int(min(_LONGEST_S, span_s / _FLIGHTS) / _STEP_S))
    edges = np.unique(np.geomspace(1, longest + 1, 24).astype(np.int64))  # long lags are many and alike
    covariance, variance = np.zeros((len(influence.blocks), len(edges) - 1)), np.zeros(len(influence.blocks))
    for c in np.unique(camera):
        own = camera == c
        sums = np.stack(noise.lagged_products(step[own], error[own], longest + 1))
        pairs, products = np.add.reduceat(sums, edges[:-1], axis=1)
        covariance[c] = products / np.maximum(2 * pairs, 1)
        variance[c] = 0.5 * (error[own] ** 2).sum(axis=1).mean()
    lag_s = np.asarray(0.5 * _STEP_S * (edges[:-1] + edges[1:] - 1), np.float64)
    return _Seen(lag_s, covariance, variance, max(span_s, _STEP_S))


def _correlation_time(lag_s: FloatArray, covariance: FloatArray, hidden: FloatArray) -> float:
    """The T whose exp(-lag / T) - hidden (l,), times what fits best, comes closest to covariances (l,)."""
    candidates = np.geomspace(_SHORTEST_CORRELATION_S, min(_LONGEST_CORRELATION_S, lag_s[-1]), 40)
    shape = np.exp(-lag_s / candidates[:, None]) - hidden
    scale = np.maximum(shape @ covariance, 0) / (shape**2).sum(axis=1)
    misfit = ((covariance - scale[:, None] * shape) ** 2).sum(axis=1)
    k = int(np.argmin(misfit))
    if not 0 < k < len(candidates) - 1:
        return float(candidates[k])
    # Between candidates, or the choice would jump with the last digit of the residuals.
    before, least, after = misfit[k - 1 : k + 2]
    step = np.log(candidates[1] / candidates[0])
    return float(candidates[k] * np.exp(0.5 * step * (before - after) / max(before - 2 * least + after, 1e-300)))


def _variances(left: FloatArray, seen_px2: FloatArray, relative: FloatArray, error: float) -> FloatArray:
    """Variances (c,) of slow errors that leave those seen (c,), known to a relative `error`; `left` (c, c) of each.

    A camera that the trajectory follows shows little of its own: cameras' errors are taken to be alike, in pixels,
    within a factor of about two, as far as the residuals do not say otherwise.
    """
    from scipy.optimize import nnls

    common = float(relative @ seen_px2) / max(float(relative @ left.sum(axis=1)), 1e-300)
    if common <= 0:
        return np.zeros(len(seen_px2))
    found = np.full(len(left), common)
    for _ in range(_ITERATIONS):
        moment = 1 / np.hypot(error * np.maximum(left @ found, seen_px2), _LEFT_ERROR * common)
        alike = 1 / (_ALIKE * np.maximum(found, common))
        found = nnls(np.vstack([left * moment[:, None], np.diag(alike)]), np.r_[seen_px2 * moment, alike * common])[0]
    return found


def _hidden(
    influence: Influence, slow_px2: FloatArray, correlation_s: float, left: FloatArray, lag_s: FloatArray
) -> FloatArray:
    """What fitting the cameras' unknowns takes out of the covariances of residuals at lags (l,).

    As a share of the variance that the residuals would have with the cameras held.
    """
    gradient = slow_gradient(influence, slow_px2, correlation_s)
    weight = np.array([b.weight.sum() for b in influence.blocks])
    held = max(2 * float(weight @ left @ slow_px2), 1e-300)
    knots_s, absorbed = absorbed_at(influence, slow_px2, correlation_s, gradient, float(lag_s[-1]))
    return np.interp(lag_s, knots_s, np.clip(absorbed / held, 0.0, 0.9))
