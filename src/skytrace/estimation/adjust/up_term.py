"""The vertical in a camera's frame, as an accelerometer at rest tells it, as knowledge of the adjustment."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from skytrace.estimation.adjust.problem import N_PARAMETERS, ROTATION, State
from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import hat


@dataclass(frozen=True, eq=False, slots=True)
class UpTerm:
    """The direction `up_in_camera` (3,) of a camera is the world's z, with a standard deviation."""

    camera: int
    up_in_camera: FloatArray  # (3,) unit
    sigma_rad: float

    def residual(self, state: State) -> FloatArray:
        """The difference (3,) of the directions in deviations; for small angles its length is the angle's."""
        return (state.rotation[self.camera].T @ self.up_in_camera - [0.0, 0.0, 1.0]) / self.sigma_rad

    def cost(self, state: State) -> float:
        r = self.residual(state)
        return 0.5 * float(r @ r)

    def linearised(self, state: State) -> tuple[FloatArray, FloatArray]:
        # R <- exp(omega) R turns R^T u by R^T (u x omega).
        J = np.zeros((3, len(state.centre), N_PARAMETERS))
        J[:, self.camera, ROTATION] = state.rotation[self.camera].T @ hat(self.up_in_camera) / self.sigma_rad
        rows = J.reshape(3, -1)
        return self.residual(state) @ rows, rows.T @ rows

    def tightened(self, inflation: float) -> UpTerm:
        return replace(self, sigma_rad=self.sigma_rad / np.sqrt(inflation))
