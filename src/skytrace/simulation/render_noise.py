"""Random fields the pictures are made of."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Field = NDArray[Any]  # of float32, which cv2 works on


def fractal_tile(size: int, slope: float, rng: np.random.Generator) -> Field:
    """A periodic field (size, size) of mean 0 and deviation 1, octave upon octave.

    The amplitude falls with frequency to the power of -slope: 1 is rough, 2 smooth.
    """
    white = np.fft.rfft2(rng.normal(size=(size, size)))
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None, :])
    frequency[0, 0] = np.inf
    shaped = white * frequency**-slope
    return _standard(np.fft.irfft2(shaped, s=(size, size)))


def fractal_line(n: int, slope: float, rng: np.random.Generator) -> Field:
    """A periodic row (n,) of mean 0 and deviation 1."""
    white = np.fft.rfft(rng.normal(size=n))
    frequency = np.fft.rfftfreq(n)
    frequency[0] = np.inf
    return _standard(np.fft.irfft(white * frequency**-slope, n=n))


def sensor_noise(shape: tuple[int, int], rng: np.random.Generator) -> Field:
    """Noise (h, w) of deviation 1 as video shows it: neighbouring pixels share some of it."""
    import cv2

    white = rng.standard_normal(shape, np.float32)
    return _standard(cv2.GaussianBlur(white, (0, 0), 0.6) + 0.15 * white)


def _standard(values: NDArray) -> Field:
    return ((values - values.mean()) / values.std()).astype(np.float32)
