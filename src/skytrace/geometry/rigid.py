"""Rotations, rigid motions and similarities.

A transform is named `b_from_a`: it takes coordinates in frame a to coordinates in frame b.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.geometry.arrays import FloatArray, frozen_array


def hat(v: FloatArray) -> FloatArray:
    """Cross-product matrices [v]x of vectors (..., 3), shape (..., 3, 3)."""
    v = np.asarray(v, float)
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def so3_exp(omega_rad: FloatArray) -> FloatArray:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) in radians (Rodrigues' formula)."""
    omega_rad = np.asarray(omega_rad, float)
    # numpy's sinc is that of pi x.
    turns = np.linalg.norm(omega_rad, axis=-1)[..., None, None] / np.pi
    K = hat(omega_rad)
    return np.eye(3) + np.sinc(turns) * K + 0.5 * np.sinc(0.5 * turns) ** 2 * (K @ K)


def so3_log(rotation: FloatArray) -> FloatArray:
    """Rotation vector (3,) in radians, of length at most pi, of a rotation matrix (3, 3)."""
    R = np.asarray(rotation, float)
    axial = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine, cosine = float(np.linalg.norm(axial)), 0.5 * (np.trace(R) - 1)
    angle = np.arctan2(sine, cosine)
    if sine > 1e-6:
        return axial * (angle / sine)
    if cosine > 0:
        return axial
    # Near half a turn the axial part vanishes; the axis is the dominant column of R + I.
    S = 0.5 * (R + R.T) + np.eye(3)
    axis = S[:, np.argmax(np.diag(S))]
    axis = axis / np.linalg.norm(axis)
    return axis * angle * (1.0 if axis @ axial >= 0 else -1.0)


def nearest_rotation(matrix: FloatArray) -> FloatArray:
    """The rotation (3, 3) nearest to a matrix in the Frobenius norm."""
    U, _, Vt = np.linalg.svd(matrix)
    return U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt


@dataclass(frozen=True, eq=False, slots=True)
class Rigid:
    """A rigid motion x_b = rotation @ x_a + translation."""

    rotation: FloatArray  # (3, 3)
    translation: FloatArray  # (3,)

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", frozen_array(self.rotation, (3, 3), "rotation"))
        object.__setattr__(self, "translation", frozen_array(self.translation, (3,), "translation"))
        if np.abs(self.rotation @ self.rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(self.rotation) < 0:
            raise ValueError("rotation: expected an orthonormal matrix with determinant +1")

    @classmethod
    def identity(cls) -> Rigid:
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_centre(cls, rotation: FloatArray, centre: FloatArray) -> Rigid:
        """camera_from_world of a camera with this rotation (camera from world) and centre in the world (3,)."""
        return cls(rotation, -np.asarray(rotation) @ np.asarray(centre))

    @property
    def centre(self) -> FloatArray:
        """The origin of frame b in frame a, (3,): the camera's centre of a camera_from_world."""
        return -self.rotation.T @ self.translation

    def apply(self, points: FloatArray) -> FloatArray:
        """Transform points (..., 3)."""
        return np.asarray(points) @ self.rotation.T + self.translation

    def inverse(self) -> Rigid:
        return Rigid(self.rotation.T, -self.rotation.T @ self.translation)

    def __matmul__(self, a_from_z: Rigid) -> Rigid:
        """b_from_a @ a_from_z = b_from_z."""
        return Rigid(
            nearest_rotation(self.rotation @ a_from_z.rotation),
            self.rotation @ a_from_z.translation + self.translation,
        )


@dataclass(frozen=True, eq=False, slots=True)
class Similarity:
    """x_b = scale * rotation @ x_a + translation."""

    scale: float
    rotation: FloatArray  # (3, 3)
    translation: FloatArray  # (3,)

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", frozen_array(self.rotation, (3, 3), "rotation"))
        object.__setattr__(self, "translation", frozen_array(self.translation, (3,), "translation"))
        if not self.scale > 0:
            raise ValueError(f"scale: expected a positive number, got {self.scale}")

    def apply(self, points: FloatArray) -> FloatArray:
        """Transform points (..., 3)."""
        return self.scale * np.asarray(points) @ self.rotation.T + self.translation

    def apply_to_pose(self, camera_from_a: Rigid) -> Rigid:
        """The pose camera_from_b of a camera known as camera_from_a, depths scaled with the world."""
        return Rigid.from_centre(camera_from_a.rotation @ self.rotation.T, self.apply(camera_from_a.centre))

    def inverse(self) -> Similarity:
        Rt = self.rotation.T
        return Similarity(1 / self.scale, Rt, -Rt @ self.translation / self.scale)


def align_similarity(
    points_a: FloatArray, points_b: FloatArray, weights: FloatArray | None = None, with_scale: bool = True
) -> Similarity:
    """The similarity b_from_a that minimises the weighted squared distance of point sets (n, 3), (n, 3).

    Umeyama, "Least-squares estimation of transformation parameters between two point patterns", TPAMI 1991.
    Raises ValueError when fewer than three points are given or all lie in one place.
    """
    A, B = np.asarray(points_a, float), np.asarray(points_b, float)
    if A.shape != B.shape or A.ndim != 2 or A.shape[1] != 3 or len(A) < 3:
        raise ValueError(f"points: expected two arrays (n >= 3, 3), got {A.shape} and {B.shape}")
    w = np.full(len(A), 1 / len(A)) if weights is None else np.asarray(weights, float) / np.sum(weights)
    mean_a, mean_b = w @ A, w @ B
    A0, B0 = A - mean_a, B - mean_b
    variance_a = float(w @ (A0**2).sum(1))
    if variance_a <= 0:
        raise ValueError("points: all points coincide, no similarity is determined")
    U, d, Vt = np.linalg.svd(B0.T @ (w[:, None] * A0))
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    rotation = U @ np.diag(sign) @ Vt
    scale = float(d @ sign) / variance_a if with_scale else 1.0
    return Similarity(scale, rotation, mean_b - scale * rotation @ mean_a)
