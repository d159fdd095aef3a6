"""Epipolar geometry and time shift together, from eight correspondences.

Albl, Kukelova, Fitzgibbon, Heller, Smid, Pajdla, "On the two-view geometry of unsynchronized cameras", CVPR 2017:
with x1(t + beta) ~ x1 + beta v1 the constraint is (x1 + beta v1)^T F x0 = 0 and det F = 0.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from skytrace.geometry.arrays import BoolArray, FloatArray, IntArray
from skytrace.geometry.epipolar import homogeneous, sampson_error

_DEGREE = 16
_NODES = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))  # Chebyshev nodes on [-1, 1]
_FROM_NODES = np.linalg.inv(np.polynomial.chebyshev.chebvander(_NODES, _DEGREE))


def eight_point_time_shift(
    xy0: FloatArray, xy1: FloatArray, velocity1: FloatArray, max_shift: float
) -> tuple[FloatArray, FloatArray]:
    """Fundamental matrices and shifts from samples of eight correspondences.

    Positions (k, 8, 2) in both views and velocities (k, 8, 2) in view 1, for k samples at once. Returns matrices
    (m, 3, 3) of unit norm and shifts (m,), |shift| <= max_shift in the velocities' unit of time; up to 16 per sample.

    The third row of F is free of beta: projecting the eight equations on the left null space of its columns leaves a
    5 x 6 matrix pencil for the first two rows. Its null vector is a polynomial of degree 5 in beta (the 5 x 5 minors),
    the third row then one of degree 6, and det F = 0 one of degree 16, whose real roots are the shifts. The pencil is
    evaluated at Chebyshev nodes of the interval [-max_shift, max_shift], the basis in which real roots are stable, and
    the roots are eigenvalues of the colleague matrix.
    """
    x0, x1 = homogeneous(xy0), homogeneous(xy1)
    k = len(x0)
    A = np.einsum("kni,knj->knij", x1, x0)  # equation n: sum_ij A_nij F_ij = 0
    B = max_shift * np.einsum("kni,knj->knij", velocity1, x0).reshape(k, 8, 6)
    free = A[:, :, 2]  # (k, 8, 3), columns of the third row of F
    upper = A[:, :, :2].reshape(k, 8, 6)
    left = np.linalg.svd(free)[0]
    null = np.swapaxes(left[:, :, 3:], 1, 2)  # (k, 5, 8)
    pseudo_inverse = np.linalg.pinv(free)

    def matrices(beta: FloatArray, a: FloatArray, b: FloatArray, n: FloatArray, p: FloatArray) -> FloatArray:
        """Unnormalised F (..., 3, 3) on the solution curve of the pencil at scaled shifts."""
        pencil = a + beta[..., None, None] * b
        reduced = n @ pencil  # (..., 5, 6)
        minors = [(-1) ** c * np.linalg.det(np.delete(reduced, c, axis=-1)) for c in range(6)]
        rows = np.stack(minors, axis=-1)
        third = -(p @ (pencil @ rows[..., None]))[..., 0]
        return np.concatenate([rows, third], axis=-1).reshape(*rows.shape[:-1], 3, 3)

    stacked = (upper[:, None], B[:, None], null[:, None], pseudo_inverse[:, None])
    values = np.linalg.det(matrices(np.broadcast_to(_NODES, (k, _DEGREE + 1)), *stacked))
    owner, beta = _real_roots(values @ _FROM_NODES.T)
    pencils = (upper[owner], B[owner], null[owner], pseudo_inverse[owner])
    beta, converged = _polish_roots(lambda b: np.linalg.det(_unit(matrices(b, *pencils))), beta)
    F = matrices(beta, *pencils)
    norm = np.linalg.norm(F, axis=(1, 2))
    sound = converged & np.isfinite(norm) & (norm > 0) & (np.abs(beta) <= 1.0)
    return F[sound] / norm[sound, None, None], beta[sound] * max_shift


def _unit(F: FloatArray) -> FloatArray:
    return F / np.maximum(np.linalg.norm(F, axis=(-2, -1)), 1e-300)[..., None, None]


def _polish_roots(
    function: Callable[[FloatArray], FloatArray], root: FloatArray, iterations: int = 12, step: float = 1e-4
) -> tuple[FloatArray, BoolArray]:
    """Secant iterations on the determinant itself: the expanded polynomial has lost digits near its small roots."""
    previous, value_before = root + step, function(root + step)
    start = root
    for _ in range(iterations):
        value = function(root)
        slope = value - value_before
        safe = np.abs(slope) > 1e-300
        move = np.where(safe, value * (root - previous) / np.where(safe, slope, 1.0), 0.0)
        previous, value_before = root, value
        root = root - np.clip(move, -0.05, 0.05)
    return root, (np.abs(root - previous) < 1e-8) & (np.abs(root - start) < 0.1)


def _real_roots(coefficients: FloatArray) -> tuple[IntArray, FloatArray]:
    """Real roots in [-1, 1] of Chebyshev series (k, d + 1), lowest first: (index of the series, root)."""
    d = coefficients.shape[1] - 1
    largest = np.abs(coefficients).max(axis=1)
    owners = np.flatnonzero(np.isfinite(largest) & (largest > 0))
    c = coefficients[owners] / largest[owners, None]
    # A vanishing top coefficient only sends a root to infinity; a tiny one in its place keeps the matrix finite.
    top = np.where(np.abs(c[:, -1]) < 1e-14, 1e-14, c[:, -1])
    off = np.full(d - 1, 0.5)
    off[0] = np.sqrt(0.5)
    colleague = np.broadcast_to(np.diag(off, 1) + np.diag(off, -1), (len(owners), d, d)).copy()
    scale = np.r_[1.0, np.full(d - 1, np.sqrt(0.5))]
    colleague[:, :, -1] -= (c[:, :-1] / top[:, None]) * (scale / scale[-1]) * 0.5
    roots: NDArray[np.complex128] = np.asarray(np.linalg.eigvals(colleague), complex).reshape(-1, d)
    row, column = np.nonzero((np.abs(roots.imag) < 1e-2) & (np.abs(roots.real) <= 1.001))
    return owners[row], roots.real[row, column]


class TimeShiftProblem:
    """The RANSAC problem of `eight_point_time_shift`; a model is (10,): F row by row, then the shift."""

    sample_size = 8

    def __init__(self, xy0: FloatArray, xy1: FloatArray, velocity1: FloatArray, max_shift: float) -> None:
        self.xy0, self.xy1, self.velocity1, self.max_shift = xy0, xy1, velocity1, max_shift
        self.n_data = len(xy0)

    def generate(self, samples: IntArray) -> FloatArray:
        F, shift = eight_point_time_shift(self.xy0[samples], self.xy1[samples], self.velocity1[samples], self.max_shift)
        return np.column_stack([F.reshape(len(F), 9), shift])

    def residuals(self, models: FloatArray) -> FloatArray:
        return np.stack(
            [sampson_error(m[:9].reshape(3, 3), self.xy0, self.xy1 + m[9] * self.velocity1) for m in models]
        )

    def refine(self, model: FloatArray, inlier: BoolArray) -> FloatArray | None:
        """Least squares of the linearised constraint in F and beta by alternation, F of rank two."""
        if inlier.sum() < 2 * self.sample_size:
            return None
        xy0, xy1, v1 = self.xy0[inlier], self.xy1[inlier], self.velocity1[inlier]
        beta = float(model[9])
        for _ in range(3):
            F = eight_point(xy0, xy1 + beta * v1)
            x0 = homogeneous(xy0)
            line1 = x0 @ F.T
            slope = (line1[:, :2] * v1).sum(1)
            level = (line1 * homogeneous(xy1)).sum(1)
            weight = 1 / np.maximum((line1[:, :2] ** 2).sum(1), 1e-12)
            beta = float(
                np.clip(
                    -(weight * slope * level).sum() / max((weight * slope**2).sum(), 1e-300),
                    -self.max_shift,
                    self.max_shift,
                )
            )
        return np.append(eight_point(xy0, xy1 + beta * v1).ravel(), beta)


def eight_point(xy0: FloatArray, xy1: FloatArray) -> FloatArray:
    """Fundamental matrix (3, 3) of unit norm and rank two by the normalised eight-point algorithm (Hartley 1997)."""
    T0, T1 = _normalising(xy0), _normalising(xy1)
    y0, y1 = homogeneous(xy0) @ T0.T, homogeneous(xy1) @ T1.T
    A = np.einsum("ni,nj->nij", y1, y0).reshape(len(y0), 9)
    F = np.linalg.eigh(A.T @ A)[1][:, 0].reshape(3, 3)
    U, s, Vt = np.linalg.svd(F)
    F = T1.T @ (U @ np.diag([s[0], s[1], 0.0]) @ Vt) @ T0
    return F / np.linalg.norm(F)


def _normalising(xy: FloatArray) -> FloatArray:
    centre = xy.mean(axis=0)
    scale = np.sqrt(2) / max(float(np.linalg.norm(xy - centre, axis=1).mean()), 1e-12)
    return np.array([[scale, 0, -scale * centre[0]], [0, scale, -scale * centre[1]], [0, 0, 1]])
