"""Uniform cubic B-splines: basis, evaluation and the integrals of squared derivatives.

On interval i, with u in [0, 1) the position inside it and h the knot spacing, the curve is
sum_k basis(u)[k] * c[i + k], k = 0..3 (de Boor, A Practical Guide to Splines; matrix form after Qin, 1998).
"""

from __future__ import annotations

from functools import cache
from math import factorial

import numpy as np

from skytrace.geometry.arrays import FloatArray, IntArray

# Row k holds the coefficients of u^0..u^3 of the weight of control point i + k.
BASIS = np.array([[1, -3, 3, -1], [4, 0, -6, 3], [1, 3, 3, -3], [0, 0, 0, 1]]) / 6.0


def locate(time_s: FloatArray, start_s: float, spacing_s: float, n_intervals: int) -> tuple[IntArray, FloatArray]:
    """Interval (n,) and position inside it (n,) of times (n,); times beyond the ends belong to the end intervals."""
    position = (np.asarray(time_s, float) - start_s) / spacing_s
    interval = np.clip(np.floor(position), 0, n_intervals - 1).astype(np.int64)
    return interval, position - interval


def basis(u: FloatArray, derivative: int = 0) -> FloatArray:
    """Weights (n, 4) of the four active control points at u (n,), or of their derivative with respect to u."""
    powers = np.zeros((len(u), 4))
    for p in range(derivative, 4):
        powers[:, p] = factorial(p) / factorial(p - derivative) * u ** (p - derivative)
    return powers @ BASIS.T


def evaluate(
    control: FloatArray, interval: IntArray, u: FloatArray, spacing_s: float, derivative: int = 0
) -> FloatArray:
    """Values (n, d) at located times of the curve with control points (m, d), or of its derivative in time."""
    weights = basis(u, derivative) / spacing_s**derivative
    return np.einsum("nk,nkd->nd", weights, control[interval[:, None] + np.arange(4)])


@cache
def energy_matrix(derivative: int) -> FloatArray:
    """Matrix (4, 4) whose quadratic form is the integral over one interval, u in [0, 1], of (d^k f / du^k)^2.

    In time the integral is that form times h^(1 - 2 k), k the order of the derivative.
    """
    nodes, weights = np.polynomial.legendre.leggauss(4)  # exact up to degree 7
    B = basis(0.5 * (nodes + 1), derivative)
    matrix = B.T @ (0.5 * weights[:, None] * B)
    matrix.setflags(write=False)
    return matrix
