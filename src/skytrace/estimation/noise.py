"""How large residuals are, and how much independent information each of them carries."""

from __future__ import annotations

import numpy as np

from skytrace.estimation.adjust.losses import LOSSES, LossKind
from skytrace.geometry.arrays import FloatArray, IntArray
from skytrace.solvers.correlation import autocorrelation

_SMALLEST_SIGMA_PX = 1e-7  # exact data would otherwise divide by zero


def robust_sigma(residual_px: FloatArray) -> float:
    """Standard deviation per axis of residuals (n, 2) from the median of their magnitudes; NaN rows are ignored."""
    finite = np.isfinite(residual_px[:, 0])
    if not finite.any():
        return 1.0
    return max(1.4826 * float(np.median(np.abs(residual_px[finite]))), _SMALLEST_SIGMA_PX)


def inflation(
    residual_px: FloatArray,
    frame: IntArray,
    sigma_px: float,
    frame_rate_hz: float,
    longest_s: float = 3.0,
    loss_scale: float = 2.0,
    loss: LossKind = "cauchy",
) -> float:
    """How many frames' residuals (n, 2) at frames (n,) carry the information of one: 1 + 2 sum of autocorrelations.

    The sum runs over lags up to the first that is not positive (Geyer, "Practical Markov chain Monte Carlo", 1992), at
    most `longest_s`. What counts is the pull of a residual on the estimate, residual times its weight under the loss
    of `loss_scale` deviations, so outliers neither hide nor feign correlation (the middle of Huber's sandwich, "The
    behavior of maximum likelihood estimates under nonstandard conditions", 1967).
    """
    finite = np.isfinite(residual_px[:, 0])
    if finite.sum() < 10:
        return 1.0
    position = frame[finite] - frame[finite].min()
    pull = residual_px[finite] / sigma_px
    pull = pull * LOSSES[loss].weight((pull**2).sum(axis=1, keepdims=True), loss_scale**2)
    # Very long recordings are judged by the stretch that fits; correlations are local.
    within = position < 2_000_000
    position, pull = position[within], pull[within]
    lags = max(2, min(int(position.max()) + 1, round(longest_s * frame_rate_hz)))
    pairs, products = lagged_products(position, pull, lags)
    known = np.flatnonzero(pairs > 0)  # detections in every other frame have no pairs at odd lags
    covariance = np.interp(np.arange(lags), known, products[known] / pairs[known])
    if covariance[0] <= 0:
        return 1.0
    rho = covariance[1:] / covariance[0]
    stop = np.flatnonzero(rho <= 0)
    return float(1 + 2 * rho[: stop[0] if len(stop) else len(rho)].sum())


def lagged_products(position: IntArray, values: FloatArray, n_lags: int) -> tuple[FloatArray, FloatArray]:
    """Numbers of pairs (n_lags,) of values (n, d) at positions (n,) >= 0 so far apart, and their summed products."""
    n = int(position.max()) + 1
    counted = np.column_stack([np.ones(len(values)), values])
    signal = np.stack([np.bincount(position, column, n) for column in counted.T]).astype(np.float64)
    correlation = autocorrelation(signal, n_lags)
    return np.rint(correlation[0]), correlation[1:].sum(axis=0)
