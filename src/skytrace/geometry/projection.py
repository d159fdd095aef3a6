"""Projection through a lens with radial and tangential distortion, its inverse and its derivatives.

The model is Brown's (Decentering distortion of lenses, 1966) with OpenCV's order of coefficients
(k1, k2, p1, p2, k3). `xy_norm` are coordinates on the plane z = 1, `xy_px` raw pixels; an integer pixel is a centre.
"""

from __future__ import annotations

import numpy as np

from skytrace.geometry.arrays import BoolArray, FloatArray


def distort(xy_norm: FloatArray, distortion: FloatArray) -> FloatArray:
    """Distorted coordinates (n, 2) of ideal coordinates (n, 2) on the plane z = 1."""
    x, y = xy_norm[:, 0], xy_norm[:, 1]
    k1, k2, p1, p2, k3 = distortion
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=1,
    )


def distort_jacobian(xy_norm: FloatArray, distortion: FloatArray) -> FloatArray:
    """Derivative (n, 2, 2) of `distort` with respect to the ideal coordinates."""
    x, y = xy_norm[:, 0], xy_norm[:, 1]
    k1, k2, p1, p2, k3 = distortion
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = k1 + r2 * (2 * k2 + 3 * r2 * k3)  # d radial / d r2
    J = np.empty((len(xy_norm), 2, 2))
    J[:, 0, 0] = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
    J[:, 1, 1] = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
    J[:, 0, 1] = J[:, 1, 0] = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
    return J


def one_to_one_radius(distortion: FloatArray) -> float:
    """Radius on the plane z = 1 up to which the radial part of a lens grows with the radius; inf if everywhere."""
    k1, k2, _, _, k3 = distortion
    # Zeros of d (r radial) / d r = 1 + 3 k1 r^2 + 5 k2 r^4 + 7 k3 r^6, found as 1 / r^2: weak lenses are safe.
    roots = np.roots([1.0, 3 * k1, 5 * k2, 7 * k3])
    folds = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 1e-12)]
    return float(1 / np.sqrt(folds.max())) if len(folds) else np.inf


def undistort(
    xy_distorted: FloatArray, distortion: FloatArray, iterations: int = 30, tolerance: float = 1e-12
) -> tuple[FloatArray, BoolArray]:
    """Ideal coordinates (n, 2) of distorted ones by Newton's method, and which of them converged (n,).

    Far outside the calibrated image a polynomial lens folds back on itself; such points do not converge to a place
    where the model is one-to-one and are marked False.
    """
    xy_distorted = np.asarray(xy_distorted, float)
    xy = xy_distorted.copy()
    for _ in range(iterations):
        error = distort(xy, distortion) - xy_distorted
        if np.abs(error).max(initial=0.0) < tolerance:
            break
        J = distort_jacobian(xy, distortion)
        determinant = J[:, 0, 0] * J[:, 1, 1] - J[:, 0, 1] * J[:, 1, 0]
        safe = np.where(np.abs(determinant) < 1e-9, 1.0, determinant)
        step = np.stack(
            [
                (J[:, 1, 1] * error[:, 0] - J[:, 0, 1] * error[:, 1]) / safe,
                (J[:, 0, 0] * error[:, 1] - J[:, 1, 0] * error[:, 0]) / safe,
            ],
            axis=1,
        )
        # A full step from the wrong side of a fold leaves the image; half the radius at most keeps it inside.
        limit = 0.5 * (0.1 + np.linalg.norm(xy, axis=1, keepdims=True))
        length = np.linalg.norm(step, axis=1, keepdims=True)
        xy -= step * np.minimum(1.0, limit / np.maximum(length, 1e-300))
    residual = np.abs(distort(xy, distortion) - xy_distorted).max(axis=1, initial=0.0)
    return xy, (residual < 1e-9) & (np.hypot(xy[:, 0], xy[:, 1]) < one_to_one_radius(distortion))


def to_rays(xy_norm: FloatArray) -> FloatArray:
    """Unit viewing rays (n, 3) in the camera frame of coordinates (n, 2) on the plane z = 1."""
    rays = np.column_stack([xy_norm, np.ones(len(xy_norm))])
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def project(
    point_in_camera: FloatArray, focal_px: FloatArray, principal_px: FloatArray, distortion: FloatArray
) -> FloatArray:
    """Raw pixels (n, 2) of points (n, 3) in the camera frame; points at or behind the camera give NaN."""
    z = np.where(point_in_camera[:, 2] > 0, point_in_camera[:, 2], np.nan)
    xy_norm = point_in_camera[:, :2] / z[:, None]
    return distort(xy_norm, distortion) * focal_px + principal_px
