"""Robust losses, each two small functions: what a squared deviation costs, and how much its detection still counts.

With s the squared length of a residual in its camera's deviations and c the scale, the objective adds rho(s) / 2 and
iteratively reweighted least squares weighs the detection by rho'(s). All losses equal s near zero (Zhang, "Parameter
estimation techniques", 1997; Barron, "A general and adaptive robust loss function", CVPR 2019).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from skytrace.geometry.arrays import FloatArray

LossKind = Literal["cauchy", "huber", "geman-mcclure", "none"]
# The compiled loops know losses by number.
CAUCHY, HUBER, GEMAN_MCCLURE, NONE = range(4)


@dataclass(frozen=True, slots=True)
class Loss:
    """rho and its derivative, of squared deviations (n,) and the squared scale."""

    code: int
    value: Callable[[FloatArray, float], FloatArray]
    weight: Callable[[FloatArray, float], FloatArray]


LOSSES: dict[LossKind, Loss] = {
    "cauchy": Loss(CAUCHY, lambda s, c2: c2 * np.log1p(s / c2), lambda s, c2: 1 / (1 + s / c2)),
    "huber": Loss(
        HUBER,
        lambda s, c2: np.where(s <= c2, s, 2 * np.sqrt(c2 * s) - c2),
        lambda s, c2: np.sqrt(c2 / np.maximum(s, c2)),
    ),
    "geman-mcclure": Loss(GEMAN_MCCLURE, lambda s, c2: s / (1 + s / c2), lambda s, c2: (1 + s / c2) ** -2.0),
    "none": Loss(NONE, lambda s, c2: np.asarray(s, float), lambda s, c2: np.ones_like(s)),
}
