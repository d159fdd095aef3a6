"""Rigid motions of the whole scene that nothing determines, held where they were.

The objective does not change under such a motion. Its minimum can be moved along it until nothing is left of this term,
so that however stiff the term is, it bends nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.estimation.adjust.problem import CENTRE, N_PARAMETERS, ROTATION, State
from skytrace.geometry.arrays import FloatArray

_SIGMA = 1e-5  # of the cameras' spread, or radians


@dataclass(frozen=True, eq=False, slots=True)
class HeldMotion:
    """Holds the part of the cameras' motion since a state that lies along rigid motions (6, q) of the world."""

    rotation: FloatArray  # (c, 3, 3) at that state
    centre: FloatArray  # (c, 3)
    by_centre: FloatArray  # (q, c, 3) displacements of the centres under each motion, as weights
    by_rotation: FloatArray  # (q, c, 3) turns of the cameras

    @classmethod
    def at(cls, state: State, motions: FloatArray) -> HeldMotion:
        """Hold motions (6, q), translations and rotations about the origin, at a state."""
        size = max(float(np.linalg.norm(state.centre - state.centre.mean(axis=0))), 1e-300)
        shift, turn = motions[:3].T, motions[3:].T
        moved = shift[:, None] + np.cross(turn[:, None], state.centre)  # (q, c, 3)
        # A world turned by w turns a camera R by -R w.
        turned = -np.einsum("cij,qj->qci", state.rotation, turn)
        both = np.sqrt((moved**2).sum(axis=(1, 2)) / size**2 + (turned**2).sum(axis=(1, 2)))[:, None, None]
        return cls(state.rotation, state.centre, moved / (both * size**2 * _SIGMA), turned / (both * _SIGMA))

    def residual(self, state: State) -> FloatArray:
        """How far (q,) the scene has moved, in the deviations of this term."""
        Q = state.rotation @ self.rotation.transpose(0, 2, 1)
        turn = 0.5 * np.stack([Q[:, 2, 1] - Q[:, 1, 2], Q[:, 0, 2] - Q[:, 2, 0], Q[:, 1, 0] - Q[:, 0, 1]], axis=1)
        return np.tensordot(self.by_centre, state.centre - self.centre, 2) + np.tensordot(self.by_rotation, turn, 2)

    def cost(self, state: State) -> float:
        r = self.residual(state)
        return 0.5 * float(r @ r)

    def linearised(self, state: State) -> tuple[FloatArray, FloatArray]:
        Q = state.rotation @ self.rotation.transpose(0, 2, 1)
        # The axial part of exp(omega) Q changes by (tr(Q) I - Q) omega / 2.
        by_step = 0.5 * (np.trace(Q, axis1=1, axis2=2)[:, None, None] * np.eye(3) - Q)
        J = np.zeros((len(self.by_centre), len(state.centre), N_PARAMETERS))
        J[:, :, CENTRE] = self.by_centre
        J[:, :, ROTATION] = np.einsum("qci,cij->qcj", self.by_rotation, by_step)
        rows = J.reshape(len(J), -1)
        return self.residual(state) @ rows, rows.T @ rows

    def tightened(self, inflation: float) -> HeldMotion:
        """Unchanged: it holds exactly."""
        del inflation
        return self
