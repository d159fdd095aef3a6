"""Motion priors on the trajectory: the integral of a squared derivative of the spline.

Li et al. 2020, eq. 10-11 regularise by least kinetic energy (velocity) and least force (acceleration); least jerk,
the third derivative, leaves constant acceleration free. The weight follows from the data (see `automatic_weight`) or is
given, relative to the size of the flight (see `MotionPrior.relative_weight`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.solvers import bspline

PriorKind = Literal["jerk", "force", "kinetic", "none"]
_DERIVATIVE = {"kinetic": 1, "force": 2, "jerk": 3}
# Without a wanted prior, stretches that nobody saw would leave the equations singular; this much jerk does not bend.
_REGULARISING = 1e-9


@dataclass(frozen=True, eq=False, slots=True)
class MotionPrior:
    """weight * integral |d^k X / dt^k|^2 dt over runs of intervals with control points of their own."""

    derivative: int
    spacing_s: float
    run_lengths: tuple[int, ...]  # intervals of each run
    weight: float
    automatic: bool
    _band: FloatArray = field(repr=False)  # (4, m) lower band of the energy of one coordinate
    extent: FloatArray = field(repr=False)  # (m,) 1 for the control points that tell the flight's size, else 0
    determined: float  # degrees of freedom that the data determine, as `automatic_weight` counts them
    size: float = 1.0  # squared extent for which the cost of size is zero, so that costs do not depend on the unit

    @property
    def rank(self) -> int:
        """Rank of the energy of all three coordinates."""
        return 3 * sum(n + 3 - self.derivative for n in self.run_lengths)

    def energy(self, control: FloatArray) -> float:
        """The integral for control points (m, 3)."""
        return float((control * self.gradient(control)).sum())

    def gradient(self, control: FloatArray) -> FloatArray:
        """Half the derivative (m, 3) of the energy by the control points."""
        out = self._band[0][:, None] * control
        for d in range(1, 4):
            coupled = self._band[d, : len(control) - d, None]
            out[d:] += coupled * control[:-d]
            out[:-d] += coupled * control[d:]
        return out

    def band(self) -> FloatArray:
        """Lower band (12, 3 m) of the energy of all three coordinates, interleaved, in LAPACK's storage."""
        m = self._band.shape[1]
        out = np.zeros((12, 3 * m))
        for d in range(4):
            out[3 * d] = np.repeat(self._band[d], 3)
        return out

    def weighted(self, weight: float) -> MotionPrior:
        return replace(self, weight=weight)

    def cost(self, control: FloatArray) -> float:
        """What the prior adds to the objective: weight * energy / 2 - determined * ln(squared extent / size) / 2.

        A shorter path has less energy, so the energy alone shrinks the flight against the cameras, through focal
        lengths and depths, with the force of as many observations as the data determine of its shape. A prior on shape
        must not know size: the second term cancels that force. It stands for the determinant that integrating over the
        path, instead of maximising, would bring.
        """
        shape = 0.5 * self.weight * self.energy(control)
        if not self.extent.any():
            return shape
        return shape - 0.5 * self.determined * float(np.log(self._squared_extent(control) / self.size))

    def cost_gradient(self, control: FloatArray) -> FloatArray:
        """Derivative (m, 3) of `cost`."""
        shape = self.weight * self.gradient(control)
        if not self.extent.any():
            return shape
        outward = self.extent[:, None] * self._centred(control)
        return shape - self.determined / self._squared_extent(control) * outward

    def relative_weight(self, control: FloatArray) -> float:
        """The weight in s^(2 k - 1), with lengths counted in root mean square distances of the flight from its centre.

        In this unit it does not depend on the world's: lambda in lambda * integral |d^k (X / size) / dt^k|^2 dt, beside
        the squares of residuals in deviations.
        """
        return self.weight * self._squared_size(control)

    def _squared_size(self, control: FloatArray) -> float:
        if not self.extent.any():
            return float(((control - control.mean(axis=0)) ** 2).sum(axis=1).mean())
        return self._squared_extent(control) / float(self.extent.sum())

    def _centred(self, control: FloatArray) -> FloatArray:
        return control - self.extent @ control / self.extent.sum()

    def _squared_extent(self, control: FloatArray) -> float:
        return float(self.extent @ (self._centred(control) ** 2).sum(axis=1))


def motion_prior(kind: PriorKind, spacing_s: float, runs: tuple[tuple[int, int], ...], weight: float) -> MotionPrior:
    """The prior of a kind for a knot grid's runs (a, b), b - a intervals each."""
    derivative = _DERIVATIVE.get(kind, 3)
    per_interval = bspline.energy_matrix(derivative) * spacing_s ** (1 - 2 * derivative)
    lengths = tuple(b - a for a, b in runs)
    m = sum(n + 3 for n in lengths)
    band = np.zeros((4, m))
    start = 0
    for n in lengths:
        for i in range(4):
            for j in range(i + 1):
                band[i - j, start + j : start + j + n] += per_interval[i, j]
        start += n + 3
    automatic = kind != "none"
    weight = weight if automatic else _REGULARISING
    return MotionPrior(derivative, spacing_s, lengths, weight, automatic, band, np.zeros(m), 0.0)


def balanced(prior: MotionPrior, control: FloatArray, weight: float) -> MotionPrior:
    """The prior with a weight, and with no pull on the size of the flight of these control points."""
    size = prior._squared_extent(control) if prior.extent.any() else 1.0
    return replace(prior, weight=weight, determined=weight * prior.energy(control), size=size)


def given_weight(prior: MotionPrior, control: FloatArray, relative: float) -> float:
    """The weight in the unit of control points (m, 3) whose `relative_weight` is the one given."""
    return relative / max(prior._squared_size(control), 1e-300)


def automatic_weight(prior: MotionPrior, control: FloatArray, trace: float) -> float:
    """The weight at which the prior's energy is what it expects: (rank - weight trace(P H^-1)) / energy.

    MacKay, "Bayesian interpolation", 1992: a fixed point of evidence maximisation; `trace` is trace(P H^-1) with P the
    energy's matrix and H the spline's normal matrix at the present weight.
    """
    well_determined = max(prior.rank - prior.weight * trace, 1.0)
    return well_determined / max(prior.energy(control), 1e-300)


def energy_trace(prior: MotionPrior, inverse_band: FloatArray) -> float:
    """trace(P H^-1) from the band (12, 3 m) of H^-1."""
    P = prior.band()
    return float((P[0] * inverse_band[0]).sum() + 2 * (P[1:] * inverse_band[1:]).sum())
