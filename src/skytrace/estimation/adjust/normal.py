"""The normal equations and their solution: banded Cholesky of the spline, Schur complement on the cameras."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.estimation.adjust import banded
from skytrace.geometry.arrays import FloatArray, IntArray

# Where clocks have moved all detections off a stretch of spline, the motion prior alone leaves a parabola free. This
# much of the largest entry keeps the spline's block definite; it damps the steps and does not move the minimum.
RIDGE = 1e-12


@dataclass(frozen=True, eq=False, slots=True)
class NormalEquations:
    """H step = -gradient, with H = [[camera, C^T], [C, spline]].

    Column j of `coupling` belongs to camera parameter j, which is the unknown column[j] (see `problem.columns_of`).
    """

    camera: FloatArray  # (p, p)
    camera_gradient: FloatArray  # (p,)
    coupling: FloatArray  # (3 m, 16 c)
    column: IntArray  # (16 c,) unknown of each camera parameter, -1 where it is fixed
    band: FloatArray  # (3 m, 12) of the spline block; [i, d] couples coordinates i and i + d
    spline_gradient: FloatArray  # (3 m,)
    scale_constraint: FloatArray | None  # (p,) direction of the camera step that would change the unit of length


@dataclass(frozen=True, eq=False, slots=True)
class Factor:
    """The damped system, eliminated: with the spline block L L^T, the reduced system of the cameras."""

    band: FloatArray  # (3 m, 12) the factor, row i holding column i of L
    half_coupling: FloatArray  # (3 m, p) L^-1 C
    half_gradient: FloatArray  # (3 m,) L^-1 spline gradient
    reduced: FloatArray  # (p, p)
    reduced_gradient: FloatArray  # (p,)

    def solved_coupling(self) -> FloatArray:
        """spline^-1 C (3 m, p): minus how the trajectory follows the cameras."""
        solved = np.array(self.half_coupling, order="C")
        banded.back_solve(self.band, solved)
        return solved


def eliminate(equations: NormalEquations, damping: float) -> Factor:
    """Eliminate the spline. Raises numpy.linalg.LinAlgError where its matrix is not positive definite."""
    band = np.array(equations.band, order="C")
    band[:, 0] *= 1 + damping
    if not banded.factorise(band):
        raise np.linalg.LinAlgError("the spline's matrix is not positive definite")
    p = len(equations.camera)
    half = banded.half_solve(band, equations.coupling, equations.column, p, equations.spline_gradient)
    products = half.T @ half
    reduced = equations.camera - products[:p, :p]
    reduced[np.diag_indices(p)] += damping * np.diag(equations.camera)
    return Factor(band, half[:, :p], half[:, p], reduced, equations.camera_gradient - products[:p, p])


def step(equations: NormalEquations, factor: Factor) -> tuple[FloatArray, FloatArray]:
    """Camera step (p,) and spline step (3 m,) of the eliminated system, the unit of length held.

    Raises numpy.linalg.LinAlgError where the system has no solution in finite numbers.
    """
    camera_step = constrained_solve(factor.reduced, -factor.reduced_gradient, equations.scale_constraint)
    spline_step = -(factor.half_gradient + factor.half_coupling @ camera_step)[:, None]
    banded.back_solve(factor.band, spline_step)
    if not (np.isfinite(camera_step).all() and np.isfinite(spline_step).all()):
        raise np.linalg.LinAlgError("the step is not finite")
    return camera_step, spline_step[:, 0]


def constrained_solve(A: FloatArray, b: FloatArray, direction: FloatArray | None) -> FloatArray:
    """Solve A x = b, for b (p,) or (p, k), subject to direction . x = 0; A need only be definite on that plane.

    Raises numpy.linalg.LinAlgError where it is not, or not finite.
    """
    from scipy.linalg import cho_factor, cho_solve

    if not (np.isfinite(A).all() and np.isfinite(b).all()):
        raise np.linalg.LinAlgError("the cameras' reduced system is not finite")
    scale = 1 / np.sqrt(np.maximum(np.diag(A), 1e-300))
    B = A * scale[:, None] * scale
    rhs = (b.T * scale).T
    if direction is None:
        return (cho_solve(cho_factor(B, check_finite=False), rhs, check_finite=False).T * scale).T
    d = direction * scale
    d = d / np.linalg.norm(d)
    # Stiffening the forbidden direction leaves the constrained solution unchanged and makes the matrix definite.
    factor = cho_factor(B + np.outer(d, d), check_finite=False)
    x, toward = cho_solve(factor, rhs, check_finite=False), cho_solve(factor, d, check_finite=False)
    x = x - np.multiply.outer(toward, d @ x) / (d @ toward) if x.ndim > 1 else x - toward * (d @ x) / (d @ toward)
    return (x.T * scale).T
