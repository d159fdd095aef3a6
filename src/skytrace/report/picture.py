"""The frame of the 3D picture: the world turned so that up is up."""

from __future__ import annotations

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import Rigid
from skytrace.model.camera import Intrinsics
from skytrace.model.reconstruction import Reconstruction


def picture_from_world(reconstruction: Reconstruction) -> Rigid:
    """A rotation about the world's origin: z up, y along the horizontal view of the reference camera, x to its right.

    The picture is turned, not only looked at from a tilted eye, because plotly's turntable keeps z vertical.
    """
    up = up_in_world(reconstruction)
    reference = reconstruction.cameras[reconstruction.reference].camera_from_world.rotation
    # A camera that looks straight up has no horizontal view; its image's upper edge serves then.
    forward = max((reference[2], -reference[1]), key=lambda axis: float(np.linalg.norm(np.cross(axis, up))))
    right = np.cross(forward, up)
    right = right / np.linalg.norm(right)
    return Rigid(np.array([right, np.cross(up, right), up]), np.zeros(3))


def up_in_world(reconstruction: Reconstruction, iterations: int = 10) -> FloatArray:
    """A unit vector (3,) that should point away from the ground.

    Cameras are tilted upwards but seldom rolled: their x axes are horizontal, while their -y axes only scatter about
    the vertical. So it is the direction most nearly normal to all x axes, in a sum of absolute values since some
    phones stand on edge; the mean -y axis chooses the sign and decides where the x axes are parallel. Where the
    vertical is known it is the world's z.
    """
    if reconstruction.frame in ("level", "enu"):
        return np.array([0.0, 0.0, 1.0])
    rotations = np.array([c.camera_from_world.rotation for c in reconstruction.cameras.values()])
    x_axes, mean = rotations[:, 0], -rotations[:, 1].mean(axis=0)
    if np.linalg.norm(mean) < 0.1:
        mean = -reconstruction.cameras[reconstruction.reference].camera_from_world.rotation[1]
    mean = mean / np.linalg.norm(mean)
    up = mean
    for _ in range(iterations):
        weight = 1 / (np.abs(x_axes @ up) + 0.05)
        spread = (x_axes.T * weight) @ x_axes / weight.sum() - 0.01 * np.outer(mean, mean)
        up = np.linalg.eigh(spread)[1][:, 0]
        up = up if up @ mean >= 0 else -up
    return up


def frustum_lines(camera_from_world: Rigid, intrinsics: Intrinsics, depth: float) -> FloatArray:
    """Points (n, 3) in the world of the lines that draw a camera's pyramid, NaN between strokes.

    A tick on the upper edge of the image tells which way up the camera is.
    """
    width, height = intrinsics.size_px
    edge = (
        np.array([[0, 0], [width, 0], [width, height], [0, height]]) - intrinsics.principal_px
    ) / intrinsics.focal_px
    corners = depth * np.column_stack([edge, np.ones(4)])
    apex, gap = np.zeros(3), np.full(3, np.nan)
    tick = 0.5 * (corners[0] + corners[1]) + 0.35 * (corners[0] - corners[3])
    strokes = [corners[0], corners[1], corners[2], corners[3], corners[0], apex, corners[1], gap]
    strokes += [corners[2], apex, corners[3], gap, corners[0], tick, corners[1]]
    return camera_from_world.inverse().apply(np.array(strokes))
