"""Distance of a reconstructed path from a true one that has neither time stamps nor the same frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.evaluation.clockfit import MINIMUM_SAMPLES, ClockFit, TruthClock, fit_clock
from skytrace.evaluation.path import SampledPath
from skytrace.evaluation.search import match_score, search_clock
from skytrace.evaluation.statistics import ErrorGroup, ErrorStatistics, by_count, by_quantile, keep_within
from skytrace.geometry.arrays import BoolArray, FloatArray, IntArray, frozen_array
from skytrace.geometry.rigid import Similarity

DROP_FACTOR = 10.0  # the published evaluation leaves out errors above ten times their mean
MAX_SCALE_ERROR = 0.01
_MAX_ROUNDS = 10
_MINIMUM_OVERLAP_S = 2.0


@dataclass(frozen=True, eq=False, slots=True)
class TrajectoryErrors:
    """Errors of the covered truth samples under one clock and similarity, in the truth's unit and frame."""

    statistics: ErrorStatistics
    n_total: int  # truth samples with a position, covered or not
    n_dropped: int  # covered samples that a rule left out
    clock: TruthClock
    truth_from_world: Similarity
    unexplained: float  # squared errors over the squared spread of the truth, 0 for a perfect match
    truth_index: IntArray  # (n,) row of the truth
    time_s: FloatArray  # (n,) on the reconstruction's clock
    error_vector: FloatArray  # (n, 3) truth minus reconstruction
    n_cameras: IntArray | None  # (n,)
    sigma: FloatArray | None  # (n,) posterior deviation

    def __post_init__(self) -> None:
        object.__setattr__(self, "truth_index", frozen_array(self.truth_index, (None,), "truth_index", np.int64))
        n = len(self.truth_index)
        object.__setattr__(self, "time_s", frozen_array(self.time_s, (n,), "time_s"))
        object.__setattr__(self, "error_vector", frozen_array(self.error_vector, (n, 3), "error_vector"))
        if self.n_cameras is not None:
            object.__setattr__(self, "n_cameras", frozen_array(self.n_cameras, (n,), "n_cameras", np.int64))
        if self.sigma is not None:
            object.__setattr__(self, "sigma", frozen_array(self.sigma, (n,), "sigma", finite=False))

    @property
    def error(self) -> FloatArray:
        """Distance (n,) of reconstruction and truth."""
        return np.linalg.norm(self.error_vector, axis=1)

    @property
    def velocity_error_vector(self) -> FloatArray:
        """True minus reconstructed velocity (m, 3) at the samples with neighbours, averaged over the two steps there.

        A truth of positions tells no more of the velocity than this: how far the target got between two samples.
        """
        if len(self.truth_index) < 3:
            return np.zeros((0, 3))
        step_s = (self.time_s[-1] - self.time_s[0]) / (self.truth_index[-1] - self.truth_index[0])
        joined = self.truth_index[2:] - self.truth_index[:-2] == 2
        return (self.error_vector[2:] - self.error_vector[:-2])[joined] / (2 * step_s)

    @property
    def velocity(self) -> ErrorStatistics | None:
        """Statistics of the velocity's errors per second; None where no three samples follow each other."""
        error = np.linalg.norm(self.velocity_error_vector, axis=1)
        return ErrorStatistics.of(error) if len(error) else None

    @property
    def by_n_cameras(self) -> tuple[ErrorGroup, ...]:
        """Statistics by the number of cameras that saw the target; empty where it is not known."""
        return () if self.n_cameras is None else by_count(self.error, self.n_cameras)

    @property
    def by_sigma(self) -> tuple[ErrorGroup, ...]:
        """Statistics by quarters of the posterior deviation, most certain first; empty where it is not known."""
        return () if self.sigma is None else by_quantile(self.error, self.sigma)


@dataclass(frozen=True, eq=False, slots=True)
class TrajectoryEvaluation:
    """The same comparison with every covered sample, and without those that err by more than 10 x the mean."""

    complete: TrajectoryErrors
    without_large: TrajectoryErrors
    rival_score: float  # score of the best clock more than a second away, relative to the chosen clock's


def evaluate_trajectory(
    path: SampledPath, truth: FloatArray, rate_hz: float, max_scale_error: float = MAX_SCALE_ERROR
) -> TrajectoryEvaluation:
    """Errors of a path against true positions (m, 3) taken at a constant rate near `rate_hz`, by least squares.

    Rows of NaN are samples without a position. Every offset of the truth's clock is tried that lets the two overlap by
    20 s, or 30 % of the shorter one if that is less. Raises ValueError when they cannot overlap enough or no motion
    is left to compare.
    """
    truth = frozen_array(truth, (None, 3), "truth", finite=False)
    known = np.asarray(np.isfinite(truth).all(axis=1))
    if not (np.isfinite(rate_hz) and rate_hz > 0):
        raise ValueError(f"rate_hz: expected a positive number, got {rate_hz}")
    if known.sum() < MINIMUM_SAMPLES:
        raise ValueError(f"truth: expected at least {MINIMUM_SAMPLES} positions, got {int(known.sum())}")
    elapsed_s = np.arange(len(truth)) / rate_hz
    clean = path.without_far_samples()
    start, rival_score = _best_start(clean, truth, elapsed_s, known, rate_hz, max_scale_error)
    fit = fit_clock(path, truth, elapsed_s, known, (start.clock.offset_s, start.clock.scale), max_scale_error)
    if fit is None:
        raise ValueError(f"truth: fewer than {MINIMUM_SAMPLES} samples with a position lie in the reconstructed time")
    complete = _errors(path, fit, elapsed_s, known, n_dropped=0)
    # Points thrown to the horizon spoil the fit to all samples so much that none stands out: judge them by the start.
    kept, usable = _drop_large(path, truth, elapsed_s, known, fit if clean is path else start, max_scale_error)
    fit = fit if usable is known else kept
    n_dropped = int((known & ~usable & path.locate(fit.clock.time_s(elapsed_s))[1]).sum())
    return TrajectoryEvaluation(complete, _errors(path, fit, elapsed_s, known, n_dropped), rival_score)


def _drop_large(
    path: SampledPath, truth: FloatArray, elapsed_s: FloatArray, known: BoolArray, fit: ClockFit, max_scale_error: float
) -> tuple[ClockFit, BoolArray]:
    """The fit without errors above 10 x the mean, repeated until none is left, and the samples (m,) it may use."""
    usable = known
    for _ in range(_MAX_ROUNDS):
        position, _ = path.evaluate(fit.clock.time_s(elapsed_s))
        error = np.linalg.norm(truth - fit.truth_from_world.apply(position), axis=1)
        covered = np.flatnonzero(usable & np.isfinite(error))
        large = covered[~keep_within(error[covered], DROP_FACTOR)]
        if len(large) == 0:
            break
        fewer = usable.copy()
        fewer[large] = False
        refit = fit_clock(path, truth, elapsed_s, fewer, (fit.clock.offset_s, fit.clock.scale), max_scale_error)
        if refit is None:
            break
        fit, usable = refit, fewer
    return fit, usable


def _best_start(
    path: SampledPath,
    truth: FloatArray,
    elapsed_s: FloatArray,
    known: BoolArray,
    rate_hz: float,
    max_scale_error: float,
) -> tuple[ClockFit, float]:
    """The most convincing clock after refinement, and the best distant rival's score relative to it."""
    truth_s = float(known.sum()) / rate_hz
    floor_s = max(_MINIMUM_OVERLAP_S, MINIMUM_SAMPLES / rate_hz)
    shorter_s = min(path.covered_s, truth_s)
    if shorter_s < floor_s:
        raise ValueError(
            f"the reconstruction covers {path.covered_s:.1f} s and the truth {truth_s:.1f} s: "
            f"at least {floor_s:.1f} s of both are needed"
        )
    overlap_s = max(min(20.0, 0.3 * shorter_s), floor_s)
    fits = []
    for candidate in search_clock(path, truth, elapsed_s, overlap_s, max_scale_error):
        fit = fit_clock(path, truth, elapsed_s, known, (candidate.offset_s, candidate.scale), max_scale_error)
        if fit is not None:
            fits.append((_refined_score(fit, rate_hz, overlap_s), fit))
    if not fits:
        raise ValueError(
            f"no offset of the truth's clock lets it overlap the reconstruction ({path.covered_s:.1f} s) for "
            f"{overlap_s:.1f} s while the target moves"
        )
    fits.sort(key=lambda item: -item[0])
    best_score, best = fits[0]
    middle_s = elapsed_s[best.covered].mean()
    rivals = [s for s, f in fits if abs(f.clock.time_s(middle_s) - best.clock.time_s(middle_s)) > 1.0]
    if best_score <= 0:
        rival_score = 1.0  # no better than chance: any other clock would do as well
    else:
        rival_score = max(rivals[0] / best_score, 0.0) if rivals else 0.0
    return best, rival_score


def _refined_score(fit: ClockFit, rate_hz: float, minimum_overlap_s: float) -> float:
    overlap_s = np.array([fit.covered.sum() / rate_hz])
    return float(match_score(np.array([fit.unexplained]), overlap_s, minimum_overlap_s)[0])


def _errors(
    path: SampledPath, fit: ClockFit, elapsed_s: FloatArray, known: BoolArray, n_dropped: int
) -> TrajectoryErrors:
    index = np.flatnonzero(fit.covered)
    time_s = fit.clock.time_s(elapsed_s[index])
    sigma = path.sigma_at(time_s)
    return TrajectoryErrors(
        statistics=ErrorStatistics.of(np.linalg.norm(fit.residual[index], axis=1)),
        n_total=int(known.sum()),
        n_dropped=n_dropped,
        clock=fit.clock,
        truth_from_world=fit.truth_from_world,
        unexplained=fit.unexplained,
        truth_index=index,
        time_s=time_s,
        error_vector=fit.residual[index],
        n_cameras=path.n_cameras_at(time_s),
        sigma=None if sigma is None else sigma * fit.truth_from_world.scale,
    )
