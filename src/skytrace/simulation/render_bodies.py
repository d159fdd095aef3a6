"""What flies through the simulated sky: the target, and things that are not the target."""

from __future__ import annotations

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import so3_exp
from skytrace.simulation.render_object import Solid

_GRAVITY_M_S2 = 9.81


def multirotor(tone: float) -> Solid:
    """A quadcopter as wide as 1 from rotor tip to rotor tip, symmetric about its centre; z upwards.

    The symmetry makes the centroid of what is drawn the projection of the centre from every side.
    """
    corner = np.radians(45.0 + 90.0 * np.arange(4))
    motors = 0.36 * np.column_stack([np.cos(corner), np.sin(corner), np.zeros(4)])
    offset, axes, opacity, tones = [], [], [], []
    for motor in motors:
        offset.append(motor)
        axes.append(np.diag([0.14, 0.14, 0.012]))
        opacity.append(0.3)  # the blades are faster than the exposure
        tones.append(tone + 15)
    for angle in corner[:2]:
        offset.append(np.zeros(3))
        axes.append(so3_exp(np.array([0.0, 0.0, angle])) @ np.diag([0.36, 0.02, 0.022]))
        opacity.append(1.0)
        tones.append(tone)
    for motor in motors:
        offset.append(motor)
        axes.append(np.diag([0.035, 0.035, 0.09]))
        opacity.append(1.0)
        tones.append(tone - 10)
    for body in ([0.07, 0.09, 0.19], [0.17, 0.1, 0.075]):  # what stands above and hangs below; the shell
        offset.append(np.zeros(3))
        axes.append(np.diag(body))
        opacity.append(1.0)
        tones.append(tone + 10)
    return Solid(np.array(offset), np.array(axes), np.array(opacity), np.array(tones))


def attitude(acceleration_m_s2: FloatArray, yaw_rad: float) -> FloatArray:
    """Rotation (3, 3) world_from_body of a multirotor: its thrust carries its weight and accelerates it."""
    up = acceleration_m_s2 + np.array([0.0, 0.0, _GRAVITY_M_S2])
    up = up / np.linalg.norm(up)
    ahead = np.array([np.cos(yaw_rad), np.sin(yaw_rad), 0.0])
    side = np.cross(up, ahead)
    side /= np.linalg.norm(side)
    return np.column_stack([np.cross(side, up), side, up])


def bird(flap_rad: float, tone: float) -> Solid:
    """A bird as wide as 1 with its wings spread, seen from behind: x along the wings, y down; flap is their angle."""
    offset, axes = [np.zeros(3)], [np.diag([0.13, 0.07, 0.1])]
    for side in (-1.0, 1.0):
        along = np.array([side * np.cos(flap_rad), -np.sin(flap_rad), 0.0])
        across = np.array([along[1], -along[0], 0.0])
        offset.append(0.26 * along)
        axes.append(np.column_stack([0.26 * along, 0.035 * across, [0.0, 0.0, 0.1]]))
    return Solid(np.array(offset), np.array(axes), np.ones(3), np.full(3, tone))


def disc(opacity: float, tone: float) -> Solid:
    """A ball of diameter 1: an insect out of focus, a lamp far away."""
    return Solid(np.zeros((1, 3)), 0.5 * np.eye(3)[None], np.array([opacity]), np.array([tone]))
