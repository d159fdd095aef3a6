"""What is known of the cameras' parameters before they are adjusted: independent priors, and terms that tie several."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from skytrace.estimation.adjust.problem import State
from skytrace.geometry.arrays import BoolArray, FloatArray, IntArray


class CameraTerm(Protocol):
    """Knowledge of several camera parameters together, as half a squared deviation.

    Parameters are the (c, 16) of all cameras, flattened; a rotation's are those of the update exp(omega) R.
    """

    def cost(self, state: State) -> float:
        """What it adds to the objective."""
        ...

    def linearised(self, state: State) -> tuple[FloatArray, FloatArray]:
        """Gradient (16 c,) and positive semi-definite Gauss-Newton matrix (16 c, 16 c)."""
        ...

    def tightened(self, inflation: float) -> CameraTerm:
        """The same knowledge against an objective that overstates the data by `inflation`."""
        ...


@dataclass(frozen=True, eq=False, slots=True)
class Priors:
    """Gaussian priors on camera parameters: mean and deviation (c, 16); 0 holds a parameter fixed, inf leaves it free.

    Deviations of rotations are 0 or inf; the mean of `lens` is the calibration. Terms come on top.
    """

    mean: FloatArray
    deviation: FloatArray
    terms: tuple[CameraTerm, ...] = ()

    @property
    def free(self) -> BoolArray:
        """Parameters (c, 16) that may move."""
        return self.deviation > 0

    @property
    def precision(self) -> FloatArray:
        """One over the deviations (c, 16) that are neither 0 nor inf, else 0."""
        with np.errstate(divide="ignore"):
            return np.where(self.free & np.isfinite(self.deviation), 1 / self.deviation, 0.0)

    def pull(self, state: State) -> FloatArray:
        """How many deviations (c, 16) the parameters lie from their means."""
        return np.where(self.precision > 0, (state.parameters() - self.mean) * self.precision, 0.0)

    def cost(self, state: State) -> float:
        """What all priors add to the objective."""
        return 0.5 * float((self.pull(state) ** 2).sum()) + sum(term.cost(state) for term in self.terms)

    def linearised(self, state: State) -> tuple[FloatArray, FloatArray]:
        """Gradient (16 c,) and Gauss-Newton matrix (16 c, 16 c) of the cost, held parameters included."""
        gradient, matrix = (self.pull(state) * self.precision).ravel(), np.diag(self.precision.ravel() ** 2)
        for term in self.terms:
            own_gradient, own_matrix = term.linearised(state)
            gradient, matrix = gradient + own_gradient, matrix + own_matrix
        return gradient, matrix


@dataclass(frozen=True, eq=False, slots=True)
class GaussianTerm:
    """A joint Gaussian prior on parameters that are coordinates (not rotations)."""

    index: IntArray  # (k,) into the flattened parameters (c, 16)
    mean: FloatArray  # (k,)
    precision: FloatArray  # (k, k) inverse covariance, positive semi-definite

    def cost(self, state: State) -> float:
        off = state.parameters().ravel()[self.index] - self.mean
        return 0.5 * float(off @ self.precision @ off)

    def linearised(self, state: State) -> tuple[FloatArray, FloatArray]:
        values = state.parameters().ravel()
        gradient, matrix = np.zeros(len(values)), np.zeros((len(values), len(values)))
        gradient[self.index] = self.precision @ (values[self.index] - self.mean)
        matrix[np.ix_(self.index, self.index)] = self.precision
        return gradient, matrix

    def tightened(self, inflation: float) -> GaussianTerm:
        return GaussianTerm(self.index, self.mean, inflation * self.precision)
