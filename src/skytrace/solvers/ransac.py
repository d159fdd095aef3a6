"""Random sample consensus as a small protocol: draw minimal samples, generate models, score them, refine the best."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from skytrace.geometry.arrays import BoolArray, FloatArray, IntArray


class Problem(Protocol):
    """A model-fitting problem over `n_data` data; models are arrays whose first axis runs over candidates."""

    n_data: int
    sample_size: int

    def generate(self, samples: IntArray) -> FloatArray:
        """Models (m, ...) of minimal samples (k, sample_size); any number of models per sample, none included."""
        ...

    def residuals(self, models: FloatArray) -> FloatArray:
        """Residuals (m, n_data) of models (m, ...), in the unit of the threshold."""
        ...

    def refine(self, model: FloatArray, inlier: BoolArray) -> FloatArray | None:
        """A model fitted to all inliers (n_data,), started from `model`; None where that is not possible."""
        ...


@dataclass(frozen=True, eq=False, slots=True)
class Consensus:
    """The best model, its inliers (n,), its truncated-quadratic cost per datum and the samples drawn."""

    model: FloatArray
    inlier: BoolArray
    cost: float
    n_samples: int


def ransac(
    problem: Problem,
    threshold: float,
    rng: np.random.Generator,
    *,
    max_samples: int = 2000,
    batch: int = 100,
    confidence: float = 0.999,
) -> Consensus | None:
    """MSAC with local refinement of each new best model (Torr & Zisserman 2000; Chum et al. 2003).

    Stops when a sample of inliers only has been drawn with `confidence`, or after `max_samples`. Returns None when
    there are fewer data than a sample needs or no sample gave a model.
    """
    n = problem.n_data
    if n < problem.sample_size:
        return None
    best: Consensus | None = None
    drawn = 0
    while drawn < max_samples:
        samples = np.argsort(rng.random((batch, n)), axis=1)[:, : problem.sample_size]
        drawn += batch
        models = problem.generate(samples)
        if len(models):
            costs = _truncated(problem.residuals(models), threshold)
            k = int(np.argmin(costs))
            if best is None or costs[k] < best.cost:
                best = _polish(problem, models[k], float(costs[k]), threshold, drawn)
        if best is not None and drawn >= _samples_needed(best.inlier.mean(), problem.sample_size, confidence):
            break
    return None if best is None else Consensus(best.model, best.inlier, best.cost, drawn)


def _truncated(residuals: FloatArray, threshold: float) -> FloatArray:
    return np.minimum((residuals / threshold) ** 2, 1.0).mean(axis=1)


def _polish(problem: Problem, model: FloatArray, cost: float, threshold: float, drawn: int) -> Consensus:
    """Refit on the inliers as long as that lowers the cost."""
    for _ in range(5):
        inlier = np.abs(problem.residuals(model[None])[0]) < threshold
        refined = problem.refine(model, inlier)
        if refined is None:
            break
        refined_cost = float(_truncated(problem.residuals(refined[None]), threshold)[0])
        if not refined_cost < cost:
            break
        model, cost = refined, refined_cost
    return Consensus(model, np.abs(problem.residuals(model[None])[0]) < threshold, cost, drawn)


def _samples_needed(inlier_ratio: float, sample_size: int, confidence: float) -> float:
    good = float(inlier_ratio) ** sample_size
    if good <= 0:
        return np.inf
    return np.log(1 - confidence) / np.log1p(-min(good, 1 - 1e-12))
