"""A further camera: its pose from the trajectory that the others have found (P3P in RANSAC)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.estimation.correspond import ImagePath
from skytrace.estimation.scene import Scene
from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.projection import to_rays
from skytrace.geometry.rigid import Rigid, nearest_rotation


@dataclass(frozen=True, slots=True)
class RegisterSettings:
    threshold: float = 0.010  # on the plane z = 1
    max_points: int = 3000
    min_inlier_s: float = 4.0
    min_inlier_share: float = 0.4


@dataclass(frozen=True, eq=False, slots=True)
class Registration:
    """The outcome of trying to register a camera: a pose, or None with the reason; the evidence in either case."""

    camera_from_world: Rigid | None
    common_s: float
    inlier_s: float
    reason: str = ""


def register(
    scene: Scene,
    supported_time_s: FloatArray,
    path: ImagePath,
    offset_s: float,
    rate: float,
    rate_hz: float,
    settings: RegisterSettings,
    seed: int,
) -> Registration:
    """Pose of a camera with a known clock from the spline's positions at supported times (n,), sampled at `rate_hz`."""
    import poselib

    if scene.grid is None or scene.control is None:
        raise ValueError("scene: expected a fitted trajectory")
    xy = path.evaluate((supported_time_s - offset_s) / rate)
    points = scene.grid.evaluate(scene.control, supported_time_s)
    seen = np.isfinite(xy[:, 0]) & np.isfinite(points[:, 0])
    common_s = float(seen.sum() / rate_hz)
    if common_s < settings.min_inlier_s:
        return Registration(
            None, common_s, 0.0, f"it sees only {common_s:.1f} s of the trajectory the other cameras support"
        )
    xy, points = xy[seen], points[seen]
    centre = np.median(points, axis=0)
    unit = float(np.median(np.linalg.norm(points - centre, axis=1)))
    rows = np.linspace(0, len(xy) - 1, min(len(xy), settings.max_points)).round().astype(int)
    camera = {"model": "SIMPLE_PINHOLE", "width": 2, "height": 2, "params": [1.0, 0.0, 0.0]}
    options = {"max_reproj_error": settings.threshold, "max_iterations": 2000, "min_iterations": 200, "seed": seed}
    pose, info = poselib.estimate_absolute_pose(xy[rows], (points[rows] - centre) / unit, camera, options, {})
    if info["num_inliers"] < 6 or not np.isfinite(np.asarray(pose.t)).all():
        return Registration(None, common_s, 0.0, "no pose explains what it sees of the trajectory")
    rotation = nearest_rotation(np.asarray(pose.R, float))
    camera_from_world = Rigid(rotation, np.asarray(pose.t, float) * unit - rotation @ centre)
    direction = camera_from_world.apply(points)
    error = np.linalg.norm(np.cross(to_rays(xy), direction), axis=1) / np.linalg.norm(direction, axis=1)
    inlier_s = float(((error < settings.threshold) & (direction[:, 2] > 0)).sum() / rate_hz)
    if inlier_s < max(settings.min_inlier_s, settings.min_inlier_share * common_s):
        return Registration(
            None, common_s, inlier_s, f"its best pose explains only {inlier_s:.1f} of {common_s:.1f} s in common view"
        )
    return Registration(camera_from_world, common_s, inlier_s)
