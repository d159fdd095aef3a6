"""How well a set of views determines its lens: by its equations, by halves of it, and by what was assumed of motion."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from skytrace.geometry.arrays import FloatArray, IntArray
from skytrace.vision.calibrate.fit import Fit
from skytrace.vision.calibrate.problem import ASPECT, BENDING, FOCAL, PRINCIPAL
from skytrace.vision.calibrate.solve import minimise, shared_covariance

_SPLITS = 8
_FEWEST_IN_HALF = 3
_MOTION_FACTORS = (0.5, 2.0)


@dataclass(frozen=True, eq=False, slots=True)
class Certainty:
    """Deviations of a lens. Focal lengths' are relative."""

    focal_formal: float  # by the equations
    halves: FloatArray  # (splits,) differences of the focal lengths that two random halves give; empty if too few views
    motion_sensitivity: float  # largest change of the focal length when the assumed motion is halved or doubled
    focal: float  # all of it
    aspect: float | None  # of fy / fx, None where it was not estimated
    principal_px: FloatArray  # (2,)
    distortion: FloatArray  # (5 or 4,)

    @property
    def halves_rms(self) -> float | None:
        """Root mean square difference between halves; None where there were too few views to halve."""
        return float(np.sqrt((self.halves**2).mean())) if len(self.halves) else None


def assess(fit: Fit, rng: np.random.Generator) -> Certainty:
    """The deviations of a fit. Half a set knows a focal length half as well in variance, so halves differ twice as much
    as the whole set errs; the larger of that and of what the equations say is taken, and the assumptions' share added.
    """
    covariance = shared_covariance(fit.solution.equations)
    deviation = np.sqrt(np.diag(covariance))
    lens = fit.state.lens
    halves = _halves(fit, rng)
    sensitivity = max(abs(_log_focal(fit, factor) - np.log(lens.focal_px[0])) for factor in _MOTION_FACTORS)
    formal = float(deviation[FOCAL])
    random = max(formal, 0.5 * float(np.sqrt((halves**2).mean()))) if len(halves) else formal
    return Certainty(
        formal,
        halves,
        float(sensitivity),
        float(np.hypot(random, sensitivity)),
        float(deviation[ASPECT]) if fit.beliefs.aspect_free else None,
        deviation[PRINCIPAL] * lens.size_px[0],
        deviation[BENDING],
    )


def at_rest(fit: Fit) -> float:
    """The focal length's relative deviation if no view moved while its rows were read out."""
    still = replace(fit.beliefs, turn_sigma_rad=0.0)
    state = replace(fit.state, turn_rad=np.zeros_like(fit.state.turn_rad))
    return float(np.sqrt(shared_covariance(minimise(fit.corners, state, still).equations)[FOCAL, FOCAL]))


def _halves(fit: Fit, rng: np.random.Generator) -> FloatArray:
    """Relative differences between the focal lengths of random halves of the views."""
    n = fit.corners.n_views
    if n < 2 * _FEWEST_IN_HALF:
        return np.zeros(0)
    differences = []
    for _ in range(_SPLITS):
        first = _random_half(n, rng)
        second = np.setdiff1d(np.arange(n), first)
        a, b = (_half(fit, views) for views in (first, second))
        differences.append(np.log(a / b))
    return np.array(differences)


def _random_half(n: int, rng: np.random.Generator) -> IntArray:
    """One of every two views that follow each other, which look most alike: halves that see the same, by and large."""
    pairs = np.arange(n - n % 2).reshape(-1, 2)
    return pairs[np.arange(len(pairs)), rng.integers(0, 2, len(pairs))]


def _half(fit: Fit, views: IntArray) -> float:
    solution = minimise(fit.corners.of_views(views), fit.state.of_views(views), fit.beliefs.of_views(views))
    return float(solution.state.lens.focal_px[0])


def _log_focal(fit: Fit, factor: float) -> float:
    """The focal length's logarithm with the deviations of the motion multiplied."""
    beliefs = replace(fit.beliefs, turn_sigma_rad=factor * fit.beliefs.turn_sigma_rad)
    return float(np.log(minimise(fit.corners, fit.state, beliefs).state.lens.focal_px[0]))
