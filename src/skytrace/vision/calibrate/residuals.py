"""Where the corners of moving, slightly bent boards are seen, and the derivatives of that by every unknown."""

from __future__ import annotations

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.projection import distort, distort_by_coefficients, distort_jacobian
from skytrace.geometry.rigid import hat, so3_exp
from skytrace.vision.calibrate.problem import (
    ASPECT,
    BENDING,
    DECENTRING,
    FOCAL,
    N_VIEW,
    PRINCIPAL,
    ROTATION,
    SHAPE,
    TRANSLATION,
    TURN,
    Corners,
    State,
    n_shared,
)


def predict(corners: Corners, state: State) -> FloatArray:
    """Pixels (n, 2) of all corners; NaN where one lies behind the camera."""
    point = _in_camera(corners, state)[0]
    return state.lens.project(point) + _decentred(corners, state, point[:, :2] / point[:, 2:]) * state.lens.focal_px


def linearise(corners: Corners, state: State) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pixels (n, 2) and their derivatives by the own view's block (n, 2, 11) and by the shared one (n, 2, s)."""
    point, twist, rotated = _in_camera(corners, state)
    lens, v = state.lens, corners.view
    z = np.where(point[:, 2] > 0, point[:, 2], np.nan)
    xy_norm = point[:, :2] / z[:, None]
    bent_px = (distort(xy_norm, lens.distortion, lens.model) + _decentred(corners, state, xy_norm)) * lens.focal_px
    by_norm = distort_jacobian(xy_norm, lens.distortion, lens.model) + _decentred_jacobian(corners, state, xy_norm)
    by_norm *= lens.focal_px[None, :, None]
    by_point = np.concatenate([by_norm, -(by_norm @ xy_norm[:, :, None])], axis=2) / z[:, None, None]
    # Rotations and translations of the board turn with it: d (E x) = E dx and E [x]x = [E x]x E.
    by_still = by_point @ twist

    by_view = np.empty((len(corners), 2, N_VIEW))
    by_view[:, :, ROTATION] = -by_still @ hat(rotated)
    by_view[:, :, TRANSLATION] = by_still
    by_angle = -(by_point @ hat(point) @ _left_jacobian(_angle_rad(corners, state)))
    by_view[:, :, TURN] = by_angle * corners.row[:, None, None]
    by_view[:, :, DECENTRING] = distort_by_coefficients(xy_norm, "pinhole")[:, :, 2:4] * lens.focal_px[None, :, None]

    by_shared = np.zeros((len(corners), 2, n_shared(lens.model)))
    by_shared[:, :, FOCAL] = bent_px
    by_shared[:, 1, ASPECT] = bent_px[:, 1]
    by_shared[:, [0, 1], [PRINCIPAL.start, PRINCIPAL.start + 1]] = lens.size_px[0]
    x, y = corners.board.T
    by_board = by_still @ state.rotation[v] * corners.shaped[v, None, None]
    by_shared[:, :, SHAPE] = np.stack(
        [*(by_board[:, :, 2] * term[:, None] for term in (x * x, x * y, y * y)), by_board[:, :, 0] * x[:, None]], axis=2
    )
    by_shared[:, :, BENDING] = distort_by_coefficients(xy_norm, lens.model) * lens.focal_px[None, :, None]
    return bent_px + lens.principal_px, by_view, by_shared


def _decentred(corners: Corners, state: State, xy_norm: FloatArray) -> FloatArray:
    """What the views' own tangential distortion adds (n, 2) on the plane z = 1."""
    own = state.decentring[corners.view]
    return (distort_by_coefficients(xy_norm, "pinhole")[:, :, 2:4] @ own[:, :, None])[:, :, 0]


def _decentred_jacobian(corners: Corners, state: State, xy_norm: FloatArray) -> FloatArray:
    """Derivative (n, 2, 2) of `_decentred` by the coordinates."""
    (x, y), (p1, p2) = xy_norm.T, state.decentring[corners.view].T
    mixed = 2 * (p1 * x + p2 * y)
    rows = [np.stack([2 * p1 * y + 6 * p2 * x, mixed], axis=1), np.stack([mixed, 6 * p1 * y + 2 * p2 * x], axis=1)]
    return np.stack(rows, axis=1)


def _in_camera(corners: Corners, state: State) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points (n, 3) in the camera frame, the turns (n, 3, 3) since the middle row, and R b alone."""
    v = corners.view
    rotated = (state.rotation[v] @ _bent(corners, state)[:, :, None])[:, :, 0]
    twist = so3_exp(_angle_rad(corners, state))
    return (twist @ (rotated + state.translation[v])[:, :, None])[:, :, 0], twist, rotated


def _bent(corners: Corners, state: State) -> FloatArray:
    """Corners (n, 3) on their bent boards."""
    x, y = corners.board.T
    xx, xy, yy, stretch = state.shape
    shaped = corners.shaped[corners.view]
    return np.column_stack([x * (1 + stretch * shaped), y, (xx * x * x + xy * x * y + yy * y * y) * shaped])


def _angle_rad(corners: Corners, state: State) -> FloatArray:
    return state.turn_rad[corners.view] * corners.row[:, None]


def _left_jacobian(angle_rad: FloatArray) -> FloatArray:
    """Derivative (n, 3, 3) of the rotation vector's exponential; a board turns far too little for the fourth order."""
    K = hat(angle_rad)
    K2 = K @ K
    return np.eye(3) + K / 2 + K2 / 6 + K2 @ K / 24
