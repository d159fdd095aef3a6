"""The truth's clock and the similarity between the two frames, by least squares.

Only the clock's two numbers are iterated: at every clock the best similarity is known in closed form, and the step
accounts for how it follows (variable projection; Golub and Pereyra, 1973, with Kaufman's Jacobian).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.evaluation.path import SampledPath
from skytrace.geometry.arrays import BoolArray, FloatArray
from skytrace.geometry.rigid import Similarity, align_similarity, hat

MINIMUM_SAMPLES = 10  # nine parameters are fitted to three coordinates each


@dataclass(frozen=True, slots=True)
class TruthClock:
    """Sample k of the truth was taken at offset_s + scale * k / rate on the reconstruction's clock.

    The deviations hold for independent errors; where the motion determines no clock (a hovering target, a circle
    flown at constant speed) they are infinite.
    """

    offset_s: float
    scale: float
    shift_sd_s: float = float("inf")  # of the clock at the middle of the samples used, not of its extrapolated start
    scale_sd: float = float("inf")

    def time_s(self, elapsed_s: FloatArray) -> FloatArray:
        """Time (m,) on the reconstruction's clock of samples taken elapsed_s (m,) after the first by nominal rate."""
        return self.offset_s + self.scale * np.asarray(elapsed_s)


@dataclass(frozen=True, eq=False, slots=True)
class ClockFit:
    """A clock, the similarity that goes with it and what both leave over."""

    clock: TruthClock
    truth_from_world: Similarity
    covered: BoolArray  # (m,) truth samples that the path covers and that were not excluded
    residual: FloatArray  # (m, 3) truth minus reconstruction in the truth's frame; NaN where the path covers nothing
    unexplained: float  # squared residuals over the squared spread of the truth, covered samples only


@dataclass(frozen=True, eq=False, slots=True)
class _State:
    offset_s: float
    scale: float
    position: FloatArray  # (m, 3) reconstruction in its own world
    velocity: FloatArray  # (m, 3)
    used: BoolArray  # (m,)
    similarity: Similarity
    residual: FloatArray  # (m, 3)


def _state_at(
    path: SampledPath, truth: FloatArray, elapsed_s: FloatArray, usable: BoolArray, offset_s: float, scale: float
) -> _State | None:
    """Everything that follows from a clock; none where it leaves too few samples for a similarity."""
    position, velocity = path.evaluate(offset_s + scale * elapsed_s)
    used = usable & np.isfinite(position[:, 0])
    if used.sum() < MINIMUM_SAMPLES or np.ptp(position[used], axis=0).max() <= 0:
        return None
    similarity = align_similarity(position[used], truth[used])
    residual = truth - similarity.apply(position)
    return _State(offset_s, scale, position, velocity, used, similarity, residual)


def _reduced_equations(state: _State, lever_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Normal matrix (2, 2) and right-hand side (2,) of the clock (time shift, scale) with the similarity eliminated."""
    used, similarity = state.used, state.similarity
    frame = similarity.scale * similarity.rotation.T
    arm = (state.position[used] - state.position[used].mean(0)) @ frame
    arm /= np.sqrt((arm**2).mean())
    speed = state.velocity[used] @ frame
    n = len(arm)
    columns = np.empty((n, 3, 9))
    columns[:, :, 0:3] = np.eye(3)
    columns[:, :, 3] = arm
    columns[:, :, 4:7] = hat(arm)
    columns[:, :, 7] = speed
    columns[:, :, 8] = speed * lever_s[used, None]
    J = columns.reshape(3 * n, 9)
    H, g = J.T @ J, J.T @ state.residual[used].reshape(-1)
    gain = H[7:, :7] @ np.linalg.pinv(H[:7, :7], rcond=1e-12, hermitian=True)
    return H[7:, 7:] - gain @ H[:7, 7:], g[7:] - gain @ g[:7]


def _step(H: FloatArray, g: FloatArray, damping: float, scale_room: tuple[float, float]) -> tuple[float, float]:
    """Step of (time shift, scale) that keeps the change of scale inside `scale_room`."""
    damped = H + np.diag(damping * np.diag(H) + 1e-300)
    shift_s, scale = np.linalg.lstsq(damped, g, rcond=1e-15)[0]
    if not scale_room[0] <= scale <= scale_room[1]:
        scale = float(np.clip(scale, *scale_room))
        shift_s = (g[0] - H[0, 1] * scale) / damped[0, 0]
    return float(shift_s), float(scale)


def _deviations(state: _State, lever_s: FloatArray, variance: float) -> tuple[float, float]:
    """Standard deviations of time shift and scale; infinite where the normal matrix is singular to rounding."""
    H, _ = _reduced_equations(state, lever_s)
    squared_speed = (state.velocity[state.used] ** 2).sum(1) * state.similarity.scale**2
    unreduced = np.array([squared_speed.sum(), squared_speed @ lever_s[state.used] ** 2])
    if (np.diag(H) <= 1e-10 * unreduced).any():
        return float("inf"), float("inf")
    norm = np.sqrt(np.diag(H))
    values, vectors = np.linalg.eigh(H / np.outer(norm, norm))
    if values[0] < 1e-10:
        return float("inf"), float("inf")
    deviation = np.sqrt(variance * (vectors**2 / values).sum(1)) / norm
    return float(deviation[0]), float(deviation[1])


def fit_clock(
    path: SampledPath,
    truth: FloatArray,
    elapsed_s: FloatArray,
    usable: BoolArray,
    start: tuple[float, float],
    max_scale_error: float,
    max_iterations: int = 60,
) -> ClockFit | None:
    """The clock near `start` (offset_s, scale) and the similarity that minimise the squared distance to the truth.

    `truth` (m, 3) sampled elapsed_s (m,) after its first sample, of which those `usable` (m,) and covered by the path
    count; the scale stays within 1 +- max_scale_error. None when fewer than ten samples are covered at the start.
    """
    offset_s, scale = start
    state = _state_at(path, truth, elapsed_s, usable, offset_s, float(np.clip(scale, *_bounds(max_scale_error))))
    if state is None:
        return None
    # Shifting the clock at the middle of the overlap leaves shift and scale nearly independent.
    middle_s = float(elapsed_s[state.used].mean())
    lever_s = elapsed_s - middle_s
    extent_s = float(np.abs(lever_s).max())
    damping = 1e-4
    low, high = _bounds(max_scale_error)
    for _ in range(max_iterations):
        H, g = _reduced_equations(state, lever_s)
        if H[0, 0] <= 0:
            break
        shift_s, change = _step(H, g, damping, (low - state.scale, high - state.scale))
        new_scale = float(np.clip(state.scale + change, low, high))
        new_offset_s = state.offset_s + shift_s - (new_scale - state.scale) * middle_s
        trial = _state_at(path, truth, elapsed_s, usable, new_offset_s, new_scale)
        if trial is not None and _improves(trial, state):
            state, damping = trial, max(damping / 10, 1e-9)
        elif damping < 1e4:
            damping *= 10
        else:
            break
        if abs(shift_s) + abs(change) * extent_s < 1e-10:
            break
    return _finished(state, truth, elapsed_s)


def _bounds(max_scale_error: float) -> tuple[float, float]:
    return 1 - max_scale_error, 1 + max_scale_error


def _improves(trial: _State, state: _State) -> bool:
    """Compared on samples that both clocks cover: a sample that comes or goes is neither gain nor loss."""
    common = trial.used & state.used
    if common.sum() < MINIMUM_SAMPLES:
        return False
    return float((trial.residual[common] ** 2).sum()) <= float((state.residual[common] ** 2).sum())


def _finished(state: _State, truth: FloatArray, elapsed_s: FloatArray) -> ClockFit:
    used = state.used
    squared = float((state.residual[used] ** 2).sum())
    spread = float(((truth[used] - truth[used].mean(0)) ** 2).sum())
    lever_s = elapsed_s - elapsed_s[used].mean()
    deviations = _deviations(state, lever_s, squared / (3 * int(used.sum()) - 9))
    unexplained = min(squared / spread, 1.0) if spread > 0 else 1.0
    clock = TruthClock(state.offset_s, state.scale, *deviations)
    return ClockFit(clock, state.similarity, used, state.residual, unexplained)
