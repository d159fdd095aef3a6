"""Where the target is in every frame of a film, and how it looks there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from skytrace.geometry.arrays import BoolArray, FloatArray
from skytrace.model.camera import Intrinsics
from skytrace.simulation.cameras import TrueCamera
from skytrace.simulation.flight import Motion
from skytrace.simulation.observe import observe
from skytrace.simulation.render_bodies import attitude, multirotor
from skytrace.simulation.render_object import Ellipses
from skytrace.simulation.simulator import TrueExposures

_STEP_S = 0.05  # over which the acceleration is taken
_YAW_RAD_S = 0.15


@dataclass(frozen=True, eq=False, slots=True)
class TargetInFilm:
    """The target in each of a camera's n frames. NaN where it is not to be seen."""

    time_s: FloatArray  # (n,) world time at which its row was exposed, middle of the exposure
    xy_px: FloatArray  # (n, 2) where its centre is at that time; may lie a little outside the picture
    size_px: FloatArray  # (n,) its width from rotor tip to rotor tip, seen from straight above
    inside: BoolArray  # (n,) its centre is in the picture
    px_from_m: FloatArray  # (n, 2, 3) how a step in the world moves it in the image


def place_target(camera: TrueCamera, exposures: TrueExposures, motion: Motion, width_m: float) -> TargetInFilm:
    """Follow the target through a film."""
    lens, pose, clock = camera.intrinsics, camera.camera_from_world, camera.clock
    width, height = lens.size_px
    # A target whose centre has left the picture may still reach into it: the picture gets a border while it is placed.
    border = max(8, round(0.05 * max(lens.size_px)))
    wide = replace(lens, principal_px=lens.principal_px + border, size_px=(width + 2 * border, height + 2 * border))
    wide_clock = replace(clock, offset_s=clock.offset_s - clock.readout_s * border / height)
    xy_px, time_s = observe(motion, pose, wide_clock, wide, exposures.beat)
    xy_px -= border
    xy_px[(time_s < motion.begin_s) | (time_s > motion.end_s)] = np.nan
    inside = np.all((xy_px >= 0) & (xy_px <= np.array(lens.size_px) - 1), axis=1)
    px_from_m = _image_steps(lens, pose.apply(motion.position(time_s)), pose.rotation)
    # The geometric mean of its widths across and along the image.
    size_px = width_m * np.linalg.det(px_from_m @ px_from_m.transpose(0, 2, 1)) ** 0.25
    size_px[~np.isfinite(xy_px[:, 0])] = np.nan
    return TargetInFilm(time_s, xy_px, size_px, inside, px_from_m)


def target_looks(target: TargetInFilm, motion: Motion, width_m: float, tone: float) -> list[Ellipses | None]:
    """The target as seen in each frame, tilted as its acceleration demands."""
    acceleration = (motion.velocity(target.time_s + _STEP_S) - motion.velocity(target.time_s - _STEP_S)) / (2 * _STEP_S)
    solid = multirotor(tone)
    return [
        solid.seen(width_m * target.px_from_m[k] @ attitude(acceleration[k], _YAW_RAD_S * float(target.time_s[k])))
        if np.isfinite(target.xy_px[k, 0])
        else None
        for k in range(len(target.time_s))
    ]


def _image_steps(lens: Intrinsics, point_in_camera: FloatArray, camera_from_world: FloatArray) -> FloatArray:
    """Derivative (n, 2, 3) of the image position by the position in the world, of whatever model the lens has."""
    step_m = 1e-5 * np.linalg.norm(point_in_camera, axis=1)[:, None]
    columns = [
        (lens.project(point_in_camera + step_m * axis) - lens.project(point_in_camera - step_m * axis)) / (2 * step_m)
        for axis in np.eye(3)
    ]
    return np.stack(columns, axis=2) @ camera_from_world
