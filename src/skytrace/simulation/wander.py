"""Noise with a memory: what drifts instead of jumping."""

from __future__ import annotations

import numpy as np

from skytrace.geometry.arrays import FloatArray

_NEGLIGIBLE = 4.5e-4  # of the first weight: where the memory is cut off


def wander(n: int, correlation: float, rng: np.random.Generator) -> FloatArray:
    """A stationary walk (n,) of unit deviation whose autocorrelation is `correlation` (0 to 1) from step to step."""
    memory = correlation ** np.arange(int(np.log(_NEGLIGIBLE) / np.log(correlation)))
    memory /= np.linalg.norm(memory)
    return np.convolve(np.clip(rng.normal(size=n + len(memory) - 1), -5, 5), memory, mode="valid")
