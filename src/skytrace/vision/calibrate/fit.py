"""One lens model fitted to all views: noise and motion learnt on the way, false corners and bad views left out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from skytrace.geometry.arrays import BoolArray, FloatArray, IntArray
from skytrace.vision.calibrate.problem import DECENTRING, TURN, Beliefs, Corners, State
from skytrace.vision.calibrate.residuals import predict
from skytrace.vision.calibrate.solve import Solution, minimise, view_covariance

FEWEST_CORNERS = 9  # in a view
_ROUNDS = 12
_SETTLED = 0.01  # relative change of noise and motion at which rounds end
_LEAST_NOISE_PX = 0.02
_ROUGH_NOISE = 1e-3  # image widths, before anything is known
_ROUGH_TURN_RAD, _LEAST_TURN_RAD = 0.02, 1e-5
_ROUGH_DECENTRING, _LEAST_DECENTRING = 0.002, 1e-6
_COMMON_CORNERS = 10.0  # corners that the noise common to all views counts as in a view's own
_FALSE_CORNER = 6.0  # deviations of the noise
_BAD_VIEW = 6.0  # deviations of the views' root mean square residuals from their median
_MAD = 1.4826  # deviation of normal numbers over their median absolute deviation


@dataclass(frozen=True, eq=False, slots=True)
class Fit:
    """A lens, and what of the data agrees with it."""

    solution: Solution  # of lens and views together
    fitted: State  # the same lens, each view's pose and movement fitted to its own corners
    corners: Corners  # that were used
    views: IntArray  # (v,) index of each used view among those given
    used: BoolArray  # (n,) which of the given corners were used
    beliefs: Beliefs
    rms_px: FloatArray  # (given,) of each view's good corners when it was last judged

    @property
    def state(self) -> State:
        return self.solution.state

    @property
    def residual_px(self) -> FloatArray:
        """(n, 2) predicted minus seen, of the used corners."""
        return predict(self.corners, self.fitted) - self.corners.xy_px

    @property
    def total_rms_px(self) -> float:
        """Root mean square length of the residuals."""
        return float(np.sqrt((self.residual_px**2).sum(1).mean()))


def fit_lens(corners: Corners, start: State, *, aspect_free: bool = False) -> Fit:
    """Fit a lens from a start whose boards are at rest.

    Rounds of a fit and of learning from its residuals: each view's noise, how much boards move while the rows are read
    out, which corners and views do not belong. Raises ValueError where no view is left.
    """
    rough = np.full(corners.n_views, _ROUGH_NOISE * corners.size_px[0])
    at_rest = Beliefs(rough, aspect_free=aspect_free)
    state = minimise(corners, start, at_rest).state
    beliefs = replace(
        at_rest,
        turn_sigma_rad=_ROUGH_TURN_RAD,
        decentring_sigma=_ROUGH_DECENTRING if state.lens.model == "pinhole" else 0.0,
        shape_free=bool(corners.shaped.any()),
    )
    views, used = np.arange(corners.n_views), np.ones(len(corners), bool)
    rms = np.full(corners.n_views, np.nan)
    for _ in range(_ROUNDS):
        solution = minimise(corners.take(used), state, beliefs)
        present = corners.of_views(views)
        length = _lengths(predict(present, _fitted(present, solution.state, beliefs)) - present.xy_px)
        learnt = _learnt(present, length, solution, beliefs)
        kept, good, rms[views] = _judge(present, length, learnt.noise_px)
        if not kept.any():
            raise ValueError("corners: no view agrees with the lens")
        now_used = np.zeros(len(corners), bool)
        now_used[np.isin(corners.view, views)] = good
        settled = _settled(beliefs, learnt) and bool((now_used == used).all())
        used, views = now_used, views[kept]
        beliefs, state = learnt.of_views(np.flatnonzero(kept)), solution.state.of_views(np.flatnonzero(kept))
        if settled:
            break
    subset = corners.take(used)
    solution = minimise(subset, state, beliefs)
    return Fit(solution, _fitted(subset, solution.state, beliefs), subset, views, used, beliefs, rms)


def _fitted(corners: Corners, state: State, beliefs: Beliefs) -> State:
    """The state with every view fitted to its corners.

    What no model says is common to the views, and inflates the noise only where it comes to what they have in common.
    """
    return minimise(corners, state, replace(beliefs, inflation=1.0, lens_free=False)).state


def _learnt(corners: Corners, length_px: FloatArray, solution: Solution, beliefs: Beliefs) -> Beliefs:
    """The beliefs that the views' residuals, of lengths (n,), and their motions themselves suggest."""
    # One step of expectation-maximisation: squares of what was found plus what remains uncertain of it.
    variance = np.diagonal(view_covariance(solution.equations), axis1=1, axis2=2)
    turn = np.sqrt((solution.state.turn_rad**2 + variance[:, TURN]).mean())
    decentring = np.sqrt((solution.state.decentring**2 + variance[:, DECENTRING]).mean())
    return replace(
        beliefs,
        noise_px=_view_noise(corners, length_px),
        turn_sigma_rad=max(float(turn), _LEAST_TURN_RAD),
        decentring_sigma=max(float(decentring), _LEAST_DECENTRING) if beliefs.decentring_sigma else 0.0,
    )


def _settled(before: Beliefs, after: Beliefs) -> bool:
    pairs = [(float(np.median(b.noise_px)), b.turn_sigma_rad) for b in (before, after)]
    return bool(np.allclose(*pairs, rtol=_SETTLED, atol=0))


def _lengths(residual_px: FloatArray) -> FloatArray:
    """Lengths (n,) of residuals (n, 2); infinite where a corner is not predicted."""
    length = np.linalg.norm(residual_px, axis=1)
    return np.where(np.isfinite(length), length, np.inf)


def _view_noise(corners: Corners, length_px: FloatArray) -> FloatArray:
    """Deviation per axis of each view's corners (v,): its own, drawn towards the one all views have in common."""
    # The median length of two normal residuals is sqrt(2 ln 2) deviations.
    common = max(float(np.median(length_px)) / np.sqrt(2 * np.log(2)), _LEAST_NOISE_PX)
    bounded = np.minimum(length_px, 0.5 * _FALSE_CORNER * common)
    squares = 0.5 * corners.per_view(bounded**2) + _COMMON_CORNERS * common**2
    return np.sqrt(squares / (corners.counts + _COMMON_CORNERS))


def _judge(corners: Corners, length_px: FloatArray, noise_px: FloatArray) -> tuple[BoolArray, BoolArray, FloatArray]:
    """Which views (v,) stay, which corners (n,) are used then, and the views' residuals (v,)."""
    good = length_px < _FALSE_CORNER * noise_px[corners.view]
    count = corners.per_view(good.astype(int))
    rms = np.sqrt(corners.per_view(np.where(good, length_px, 0.0) ** 2) / np.maximum(count, 1))
    enough = (count >= FEWEST_CORNERS) & (count >= 0.5 * corners.counts)
    if not enough.any():
        return enough, np.zeros(len(corners), bool), rms
    middle = float(np.median(rms[enough]))
    spread = max(_MAD * float(np.median(np.abs(rms[enough] - middle))), 0.1 * middle)
    kept = enough & (rms <= middle + _BAD_VIEW * spread)
    return kept, good & kept[corners.view], rms
