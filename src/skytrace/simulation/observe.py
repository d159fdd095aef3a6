"""What a rolling-shutter camera sees of a motion, solved exactly."""

from __future__ import annotations

import numpy as np

from skytrace.geometry.arrays import BoolArray, FloatArray
from skytrace.geometry.rigid import Rigid
from skytrace.model.camera import Clock, Intrinsics
from skytrace.simulation.flight import Motion

# The radius at which a lens folds is known for its radial part; the tangential part moves it a little.
_FOLD_MARGIN = 0.97


def in_view(point_in_camera: FloatArray, xy_px: FloatArray, intrinsics: Intrinsics) -> BoolArray:
    """Which points (n, 3), projected at pixels (n, 2), lie before the camera, in its image and in its lens's reach."""
    width, height = intrinsics.size_px
    with np.errstate(invalid="ignore"):
        inside = (xy_px >= 0).all(1) & (xy_px[:, 0] <= width - 1) & (xy_px[:, 1] <= height - 1)
    z = np.where(inside, point_in_camera[:, 2], 1.0)
    xy_norm = point_in_camera[:, :2] / z[:, None]
    radius = np.hypot(xy_norm[:, 0], xy_norm[:, 1])
    return inside & (radius < _FOLD_MARGIN * intrinsics.one_to_one_radius)


def observe(
    motion: Motion,
    camera_from_world: Rigid,
    clock: Clock,
    intrinsics: Intrinsics,
    frame: FloatArray,
    *,
    tolerance_px: float = 1e-11,
    max_iterations: int = 100,
) -> tuple[FloatArray, FloatArray]:
    """Raw pixels (n, 2) of the target in frames (n,), NaN where it is not seen, and the times (n,) of its rows.

    A row is exposed at clock.world_time(frame, row), and at that time the target must project to that very row. The
    fixed point is reached by iteration: in one readout the target crosses far less than the image, so each step
    shrinks the error some hundredfold. A frame whose iteration does not settle shows no sharp target: not seen.
    `frame` may be fractional, where exposures deviate from the regular beat. Times of unseen frames are those of the
    middle row.
    """
    frame = np.asarray(frame, float)
    n, height = len(frame), intrinsics.height_px
    middle_row = np.full(n, 0.5 * height)
    row = middle_row.copy()
    time_s = clock.world_time(frame, row)
    xy_px = np.full((n, 2), np.nan)
    seen = np.zeros(n, bool)
    active = np.arange(n)
    for _ in range(max_iterations):
        time_s[active] = clock.world_time(frame[active], row[active])
        point = camera_from_world.apply(motion.position(time_s[active]))
        xy = intrinsics.project(point)
        # Rows beyond the image keep to its border, where the target never settles into view.
        new_row = np.clip(xy[:, 1], 0.0, float(height))
        settled = np.abs(new_row - row[active]) <= tolerance_px
        xy_px[active] = xy
        seen[active[settled]] = in_view(point[settled], xy[settled], intrinsics)
        row[active] = new_row
        active = active[~settled & np.isfinite(new_row)]
        if len(active) == 0:
            break
    xy_px[~seen] = np.nan
    time_s[~seen] = clock.world_time(frame[~seen], middle_row[~seen])
    return xy_px, time_s
