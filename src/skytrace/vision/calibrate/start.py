"""A first guess of lens and poses, for either lens model, from a scan over focal lengths.

For each of them every board's pose follows from its homography to the picture, taken through the lens (Zhang, A
flexible new technique for camera calibration, TPAMI 2000); a few steps of the adjustment tell which focal length was
nearest.
"""

from __future__ import annotations

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.projection import COEFFICIENTS, LensModel
from skytrace.geometry.rigid import nearest_rotation
from skytrace.model.camera import Intrinsics
from skytrace.vision.calibrate.problem import Beliefs, Corners, State
from skytrace.vision.calibrate.solve import minimise

# Focal lengths tried, in image widths: from 20 to 150 degrees wide.
_SCAN = (0.25, 0.36, 0.5, 0.7, 0.95, 1.3, 2.0, 3.2)
_SCAN_NOISE = 1e-3  # of the image's width: the first guess is as rough as that
_SCAN_STEPS = 8


def first_guess(corners: Corners, model: LensModel) -> State:
    """The best start. Raises ValueError where no focal length puts all boards in front of the camera."""
    noise_px = np.full(corners.n_views, _SCAN_NOISE * corners.size_px[0])
    beliefs = Beliefs(noise_px, aspect_free=True, coefficients_free=2)
    best, least = None, np.inf
    for widths in _SCAN:
        state = posed(corners, plain_lens(corners.size_px, widths, model))
        if state is None:
            continue
        solution = minimise(corners, state, beliefs, max_iterations=_SCAN_STEPS)
        if solution.cost < least:
            best, least = solution.state, solution.cost
    if best is None:
        raise ValueError("corners: no focal length puts all boards in front of the camera")
    return best


def plain_lens(size_px: tuple[int, int], focal_widths: float, model: LensModel) -> Intrinsics:
    """A lens with square pixels and without distortion that looks through the image's middle."""
    focal = focal_widths * size_px[0]
    return Intrinsics(
        np.array([focal, focal]),
        0.5 * (np.array(size_px) - 1.0),
        np.zeros(len(COEFFICIENTS[model])),
        size_px,
        model,
    )


def posed(corners: Corners, lens: Intrinsics) -> State | None:
    """All boards at rest where their homographies put them; None where one does not lie in front of the camera."""
    rays, valid = lens.undistort(corners.xy_px)
    if not valid.all():
        return None
    rotations, translations = [], []
    ends = np.append(corners.start[1:], len(corners))
    for begin, end in zip(corners.start, ends, strict=True):
        H = homography(corners.board[begin:end], rays[begin:end])
        H = H / np.sqrt(np.linalg.norm(H[:, 0]) * np.linalg.norm(H[:, 1]))
        H = H * np.sign(H[2, 2])
        rotations.append(nearest_rotation(np.column_stack([H[:, 0], H[:, 1], np.cross(H[:, 0], H[:, 1])])))
        translations.append(H[:, 2])
    n = corners.n_views
    state = State(lens, np.zeros(4), np.stack(rotations), np.stack(translations), np.zeros((n, 3)), np.zeros((n, 2)))
    across = (state.rotation[corners.view, 2, :2] * corners.board).sum(1)
    depth = across + state.translation[corners.view, 2]
    return state if (depth > 0).all() else None


def homography(plane: FloatArray, image: FloatArray) -> FloatArray:
    """The homography (3, 3) of unit norm from points (n, 2) to points (n, 2), n >= 4, by least squares.

    Both are normalised first (Hartley, In defense of the eight-point algorithm, TPAMI 1997).
    """
    a, b = _normaliser(plane), _normaliser(image)
    x = np.column_stack([plane, np.ones(len(plane))]) @ a.T
    u = np.column_stack([image, np.ones(len(image))]) @ b.T
    zero = np.zeros_like(x)
    rows = np.concatenate(
        [np.hstack([x, zero, -u[:, :1] * x]), np.hstack([zero, x, -u[:, 1:2] * x])],
    )
    H = np.linalg.inv(b) @ np.linalg.eigh(rows.T @ rows)[1][:, 0].reshape(3, 3) @ a
    return H / np.linalg.norm(H)


def _normaliser(points: FloatArray) -> FloatArray:
    centre = points.mean(axis=0)
    scale = np.sqrt(2) / max(float(np.linalg.norm(points - centre, axis=1).mean()), 1e-12)
    return np.array([[scale, 0, -scale * centre[0]], [0, scale, -scale * centre[1]], [0, 0, 1]])
