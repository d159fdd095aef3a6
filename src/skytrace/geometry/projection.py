"""Projection through a lens, its inverse and its derivatives.

A lens first maps the plane z = 1 to a plane whose radius is tan(angle) ("pinhole") or the angle itself ("fisheye"),
and there moves points by a polynomial. For a pinhole this is Brown's model (Decentering distortion of lenses, 1966)
with OpenCV's order of coefficients (k1, k2, p1, p2, k3); for a fisheye Kannala and Brandt's (A generic camera model and
calibration method, TPAMI 2006) as in OpenCV: angle (1 + k1 angle^2 + k2 angle^4 + k3 angle^6 + k4 angle^8).
`xy_norm` are coordinates on the plane z = 1, `xy_px` raw pixels; an integer pixel is a centre.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal

import numpy as np

from skytrace.geometry.arrays import BoolArray, FloatArray

LensModel = Literal["pinhole", "fisheye"]
COEFFICIENTS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"pinhole": ("k1", "k2", "p1", "p2", "k3"), "fisheye": ("k1", "k2", "k3", "k4")}
)
# Where k1, k2 and k3 stand among the coefficients.
RADIAL: Mapping[str, tuple[int, int, int]] = MappingProxyType({"pinhole": (0, 1, 4), "fisheye": (0, 1, 2)})
# The plane z = 1 has no place for rays at a right angle to the axis, and coordinates near them mean nothing.
WIDEST_RAD = np.radians(88.0)


def six_coefficients(distortion: FloatArray, model: LensModel) -> FloatArray:
    """k1 k2 p1 p2 k3 k4 (6,) of the polynomial both models share."""
    if model == "pinhole":
        return np.append(distortion, 0.0)
    k1, k2, k3, k4 = distortion
    return np.array([k1, k2, 0.0, 0.0, k3, k4])


def distort(xy_norm: FloatArray, distortion: FloatArray, model: LensModel = "pinhole") -> FloatArray:
    """Distorted coordinates (n, 2) of ideal coordinates (n, 2) on the plane z = 1."""
    return _move(_to_lens_plane(xy_norm, model), six_coefficients(distortion, model))


def distort_jacobian(xy_norm: FloatArray, distortion: FloatArray, model: LensModel = "pinhole") -> FloatArray:
    """Derivative (n, 2, 2) of `distort` with respect to the ideal coordinates."""
    J = _move_jacobian(_to_lens_plane(xy_norm, model), six_coefficients(distortion, model))
    return J if model == "pinhole" else J @ _to_angle_jacobian(xy_norm)


def distort_by_coefficients(xy_norm: FloatArray, model: LensModel = "pinhole") -> FloatArray:
    """Derivative (n, 2, 5 or 4) of `distort` with respect to the coefficients, in which it is linear."""
    m = _to_lens_plane(xy_norm, model)
    x, y = m[:, 0], m[:, 1]
    r2 = (m * m).sum(1)
    radial = [m * (r2**power)[:, None] for power in (1, 2, 3, 4)]
    if model == "fisheye":
        return np.stack(radial, axis=2)
    p1 = np.stack([2 * x * y, r2 + 2 * y * y], axis=1)
    p2 = np.stack([r2 + 2 * x * x, 2 * x * y], axis=1)
    return np.stack([radial[0], radial[1], p1, p2, radial[2]], axis=2)


def one_to_one_radius(distortion: FloatArray, model: LensModel = "pinhole") -> float:
    """Radius on the plane z = 1 up to which the radial part of a lens grows with the radius; inf if everywhere."""
    fold = _fold_radius(six_coefficients(distortion, model))
    return fold if model == "pinhole" else float(np.tan(min(fold, WIDEST_RAD)))


def undistort(
    xy_distorted: FloatArray,
    distortion: FloatArray,
    model: LensModel = "pinhole",
    *,
    iterations: int = 30,
    tolerance: float = 1e-12,
) -> tuple[FloatArray, BoolArray]:
    """Ideal coordinates (n, 2) of distorted ones by Newton's method, and which of them converged (n,).

    Far outside the calibrated image a polynomial lens folds back on itself; such points do not converge to a place
    where the model is one-to-one and are marked False, as are rays of a fisheye at nearly a right angle to its axis.
    """
    coefficients = six_coefficients(distortion, model)
    xy_distorted = np.asarray(xy_distorted, float)
    m = xy_distorted.copy()
    for _ in range(iterations):
        error = _move(m, coefficients) - xy_distorted
        if np.abs(error).max(initial=0.0) < tolerance:
            break
        J = _move_jacobian(m, coefficients)
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
        limit = 0.5 * (0.1 + np.linalg.norm(m, axis=1, keepdims=True))
        length = np.linalg.norm(step, axis=1, keepdims=True)
        m -= step * np.minimum(1.0, limit / np.maximum(length, 1e-300))
    residual = np.abs(_move(m, coefficients) - xy_distorted).max(axis=1, initial=0.0)
    radius = np.hypot(m[:, 0], m[:, 1])
    valid = (residual < 1e-9) & (radius < _fold_radius(coefficients))
    if model == "pinhole":
        return m, valid
    angle = np.minimum(radius, WIDEST_RAD)
    return m * (np.tan(angle) / np.maximum(angle, 1e-300))[:, None], valid & (radius < WIDEST_RAD)


def _move(m: FloatArray, coefficients: FloatArray) -> FloatArray:
    x, y = m[:, 0], m[:, 1]
    k1, k2, p1, p2, k3, k4 = coefficients
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
    return np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=1,
    )


def _move_jacobian(m: FloatArray, coefficients: FloatArray) -> FloatArray:
    x, y = m[:, 0], m[:, 1]
    k1, k2, p1, p2, k3, k4 = coefficients
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
    slope = k1 + r2 * (2 * k2 + r2 * (3 * k3 + r2 * 4 * k4))  # d radial / d r2
    J = np.empty((len(m), 2, 2))
    J[:, 0, 0] = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
    J[:, 1, 1] = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
    J[:, 0, 1] = J[:, 1, 0] = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
    return J


def _to_lens_plane(xy_norm: FloatArray, model: LensModel) -> FloatArray:
    """The point (n, 2) whose radius is the angle to the axis (fisheye), or the coordinates as they are (pinhole)."""
    if model == "pinhole":
        return xy_norm
    r = np.hypot(xy_norm[:, 0], xy_norm[:, 1])
    return xy_norm * (np.arctan(r) / np.maximum(r, 1e-300) + (r == 0))[:, None]


def _to_angle_jacobian(xy_norm: FloatArray) -> FloatArray:
    """Derivative (n, 2, 2) of `_to_lens_plane` of a fisheye."""
    r2 = (xy_norm**2).sum(1)
    r = np.sqrt(r2)
    near = r < 1e-3
    safe = np.where(near, 1.0, r)
    scale = np.where(near, 1 - r2 / 3, np.arctan(safe) / safe)
    slope = np.where(near, -1 / 3 + 2 * r2 / 5, (1 / (1 + safe**2) - np.arctan(safe) / safe) / (2 * safe**2))
    outer = xy_norm[:, :, None] * xy_norm[:, None, :]
    return scale[:, None, None] * np.eye(2) + 2 * slope[:, None, None] * outer


def _fold_radius(coefficients: FloatArray) -> float:
    """Where the radial polynomial stops growing with the radius; inf if nowhere."""
    k1, k2, _, _, k3, k4 = coefficients
    # Zeros of d (r radial) / d r = 1 + 3 k1 r^2 + 5 k2 r^4 + ..., found as 1 / r^2: weak lenses are safe.
    roots = np.roots([1.0, 3 * k1, 5 * k2, 7 * k3, 9 * k4])
    folds = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 1e-12)]
    return float(1 / np.sqrt(folds.max())) if len(folds) else np.inf


def to_rays(xy_norm: FloatArray) -> FloatArray:
    """Unit viewing rays (n, 3) in the camera frame of coordinates (n, 2) on the plane z = 1."""
    rays = np.column_stack([xy_norm, np.ones(len(xy_norm))])
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def project(
    point_in_camera: FloatArray,
    focal_px: FloatArray,
    principal_px: FloatArray,
    distortion: FloatArray,
    model: LensModel = "pinhole",
) -> FloatArray:
    """Raw pixels (n, 2) of points (n, 3) in the camera frame; points at or behind the camera give NaN."""
    z = np.where(point_in_camera[:, 2] > 0, point_in_camera[:, 2], np.nan)
    xy_norm = point_in_camera[:, :2] / z[:, None]
    return distort(xy_norm, distortion, model) * focal_px + principal_px
