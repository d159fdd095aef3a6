"""Two views: the essential matrix, its residuals and its decomposition. All coordinates on the plane z = 1."""

from __future__ import annotations

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import Rigid, hat, nearest_rotation


def homogeneous(xy: FloatArray) -> FloatArray:
    """Append a one: (..., 2) -> (..., 3)."""
    return np.concatenate([xy, np.ones((*xy.shape[:-1], 1))], axis=-1)


def essential_matrix(camera1_from_camera0: Rigid) -> FloatArray:
    """E (3, 3) with x1^T E x0 = 0 (Longuet-Higgins 1981)."""
    return hat(camera1_from_camera0.translation) @ camera1_from_camera0.rotation


def sampson_error(F: FloatArray, xy0: FloatArray, xy1: FloatArray) -> FloatArray:
    """Signed Sampson error (..., n) of matrices (..., 3, 3) for correspondences (n, 2), (n, 2).

    The first-order distance to the epipolar constraint, in units of the plane z = 1 (Hartley & Zisserman, eq. 11.9).
    """
    x0, x1 = homogeneous(xy0), homogeneous(xy1)
    line1 = x0 @ np.swapaxes(F, -1, -2)  # (..., n, 3)
    line0 = x1 @ F
    numerator = (line1 * x1).sum(-1)
    squared = (line1[..., :2] ** 2).sum(-1) + (line0[..., :2] ** 2).sum(-1)
    return numerator / np.sqrt(np.maximum(squared, 1e-300))


def decompose_essential(E: FloatArray) -> list[Rigid]:
    """The four poses camera1_from_camera0 with unit baseline of an essential matrix, or of one near it."""
    U, _, Vt = np.linalg.svd(E)
    U, Vt = U * np.sign(np.linalg.det(U)), Vt * np.sign(np.linalg.det(Vt))
    W = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return [
        Rigid(nearest_rotation(U @ M @ Vt), sign * U[:, 2] / np.linalg.norm(U[:, 2]))
        for M in (W, W.T)
        for sign in (1.0, -1.0)
    ]


def relative_depths(camera1_from_camera0: Rigid, xy0: FloatArray, xy1: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Depths (n,), (n,) along z of the midpoint-triangulated points in camera 0 and camera 1."""
    x0, x1 = homogeneous(xy0), homogeneous(xy1)
    a = x0 @ camera1_from_camera0.rotation.T  # direction of ray 0 in camera 1
    t = camera1_from_camera0.translation
    aa, bb, ab = (a * a).sum(1), (x1 * x1).sum(1), (a * x1).sum(1)
    at, bt = a @ t, x1 @ t
    determinant = np.maximum(aa * bb - ab**2, 1e-300)
    return (ab * bt - bb * at) / determinant, (aa * bt - ab * at) / determinant


def choose_pose(candidates: list[Rigid], xy0: FloatArray, xy1: FloatArray) -> tuple[Rigid, float]:
    """The candidate that puts most points in front of both cameras, and the fraction it does (cheirality)."""
    fractions = [float(np.mean((d0 > 0) & (d1 > 0))) for d0, d1 in (relative_depths(c, xy0, xy1) for c in candidates)]
    best = int(np.argmax(fractions))
    return candidates[best], fractions[best]
