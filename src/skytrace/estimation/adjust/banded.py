"""Compiled algebra of symmetric banded matrices, the spline's part of the normal equations.

A matrix of n unknowns and w - 1 off-diagonals is kept as (n, w): entry [i, d] couples unknown i with i + d. This is the
transpose of LAPACK's lower band storage. Its Cholesky factor takes its place: row i holds column i of the lower factor.
Golub & Van Loan, Matrix Computations, section 4.3.
"""

from __future__ import annotations

import numpy as np
from numba import njit

_compiled = njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "arcp", "reassoc"})


@_compiled
def factorise(band):
    """Replace the matrix by its Cholesky factor; False where it is not positive definite or not finite."""
    n, width = band.shape
    for i in range(n):
        row = band[i]
        if not 0 < row[0] < np.inf:
            return False
        scale = 1 / np.sqrt(row[0])
        for d in range(width):
            row[d] *= scale
        for d in range(1, min(width, n - i)):
            factor, below = row[d], band[i + d]
            for k in range(width - d):
                below[k] -= factor * row[k + d]
    return True


@_compiled
def half_solve(factor, coupling, unknown, columns, gradient):
    """L^-1 [C, g] (n, columns + 1) for coupling (n, q) and gradient g (n,).

    Column j of the coupling adds to column unknown[j] of C, or to none where that is negative.
    """
    n, width = factor.shape
    out = np.zeros((n, columns + 1))
    for i in range(n):
        y = out[i]
        for j in range(len(unknown)):
            if unknown[j] >= 0:
                y[unknown[j]] += coupling[i, j]
        y[columns] = gradient[i]
        d = min(width - 1, i)
        while d >= 4:  # four rows at once: the sum is read and written a quarter as often
            f0, f1, f2, f3 = (
                factor[i - d, d],
                factor[i - d + 1, d - 1],
                factor[i - d + 2, d - 2],
                factor[i - d + 3, d - 3],
            )
            y0, y1, y2, y3 = out[i - d], out[i - d + 1], out[i - d + 2], out[i - d + 3]
            for j in range(len(y)):
                y[j] -= f0 * y0[j] + f1 * y1[j] + f2 * y2[j] + f3 * y3[j]
            d -= 4
        while d > 0:
            f0, y0 = factor[i - d, d], out[i - d]
            for j in range(len(y)):
                y[j] -= f0 * y0[j]
            d -= 1
        scale = 1 / factor[i, 0]
        for j in range(len(y)):
            y[j] *= scale
    return out


@_compiled
def back_solve(factor, y):
    """Replace y (n, k) by L^-T y."""
    n, width = factor.shape
    for i in range(n - 1, -1, -1):
        for d in range(1, min(width, n - i)):
            f = factor[i, d]
            for j in range(y.shape[1]):
                y[i, j] -= f * y[i + d, j]
        scale = 1 / factor[i, 0]
        for j in range(y.shape[1]):
            y[i, j] *= scale


@_compiled
def inverse_band(factor):
    """The band (n, w) of the inverse from the Cholesky factor: entry [i, d] is that of unknowns i and i + d.

    Takahashi, Fagan & Chen 1973; Erisman & Tinney 1975: only entries inside the band are formed.
    """
    n, width = factor.shape
    Z = np.zeros((n, width))
    for i in range(n - 1, -1, -1):
        last = min(width - 1, n - 1 - i)
        scale = 1 / factor[i, 0]
        for d in range(last, -1, -1):
            total = 0.0
            for k in range(1, d + 1):
                total += factor[i, k] * Z[i + k, d - k]
            for k in range(d + 1, last + 1):
                total += factor[i, k] * Z[i + d, k - d]
            Z[i, d] = -total * scale if d > 0 else (scale - total) * scale
    return Z
