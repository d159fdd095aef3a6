"""A known distance between two cameras, as knowledge of the adjustment."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from skytrace.estimation.adjust.problem import CENTRE, N_PARAMETERS, State
from skytrace.geometry.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class DistanceTerm:
    """The centres of cameras i and j lie `metres` apart, with a standard deviation."""

    i: int
    j: int
    metres: float
    sigma_m: float

    def residual(self, state: State) -> float:
        """How many deviations the distance is too long."""
        return (float(np.linalg.norm(state.centre[self.j] - state.centre[self.i])) - self.metres) / self.sigma_m

    def cost(self, state: State) -> float:
        return 0.5 * self.residual(state) ** 2

    def linearised(self, state: State) -> tuple[FloatArray, FloatArray]:
        apart = state.centre[self.j] - state.centre[self.i]
        along = apart / (max(float(np.linalg.norm(apart)), 1e-300) * self.sigma_m)
        J = np.zeros((len(state.centre), N_PARAMETERS))
        J[self.j, CENTRE], J[self.i, CENTRE] = along, -along
        row = J.ravel()
        return self.residual(state) * row, np.outer(row, row)

    def tightened(self, inflation: float) -> DistanceTerm:
        return replace(self, sigma_m=self.sigma_m / np.sqrt(inflation))
