"""From registered cameras to the target's path: triangulation on a common time grid, then a spline through it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from skytrace.errors import ReconstructionError
from skytrace.estimation.correspond import ImagePath
from skytrace.estimation.scene import Scene
from skytrace.estimation.trajectory_fit import fit_spline, knot_grid
from skytrace.geometry import triangulation
from skytrace.geometry.arrays import BoolArray, FloatArray
from skytrace.geometry.projection import to_rays


@dataclass(frozen=True, slots=True)
class StructureSettings:
    """Angles in radians."""

    rate_hz: float = 15.0
    max_error_rad: float = 0.010
    min_angle_rad: float = 0.035
    knot_spacing_s: float = 0.2
    margin_s: float = 0.6  # of spline beyond the supported times
    bridge_s: float = 2.0  # longest silence the motion prior may bridge


@dataclass(frozen=True, eq=False, slots=True)
class Structure:
    """Triangulated points (n, 3) at supported times (n,), the cameras that agree (n, c) and their parallax (n,)."""

    time_s: FloatArray
    point_in_world: FloatArray
    inlier: BoolArray
    angle_rad: FloatArray
    sigma: FloatArray  # (n,) expected deviation of a point for a unit angular error


def triangulate_scene(scene: Scene, paths: Mapping[str, ImagePath], settings: StructureSettings) -> Structure:
    """Triangulate at multiples of 1 / rate_hz of world time wherever at least two cameras see the target."""
    ids = list(scene.cameras)
    begins = [scene.cameras[c].offset_s + scene.cameras[c].rate * paths[c].begin_s for c in ids]
    ends = [scene.cameras[c].offset_s + scene.cameras[c].rate * paths[c].end_s for c in ids]
    rate = settings.rate_hz
    time = np.arange(np.floor(min(begins) * rate), np.ceil(max(ends) * rate) + 1) / rate
    centre = np.stack([scene.cameras[c].camera_from_world.centre for c in ids])
    ray = np.stack([world_rays(scene, c, paths[c], time) for c in ids], axis=1)
    both = np.isfinite(ray[..., 0]).sum(axis=1) >= 2
    found = triangulation.triangulate(centre, ray[both], settings.max_error_rad, settings.min_angle_rad)
    valid = found.valid
    points, inlier = found.point_in_world[valid], found.inlier[valid]
    distance = np.linalg.norm(points[:, None] - centre, axis=2)
    nearest_two = np.sort(np.where(inlier, distance, np.inf), axis=1)[:, 1]
    sigma = nearest_two / np.sin(np.maximum(found.angle_rad[valid], settings.min_angle_rad))
    return Structure(time[both][valid], points, inlier, found.angle_rad[valid], sigma)


def world_rays(scene: Scene, camera_id: str, path: ImagePath, time_s: FloatArray) -> FloatArray:
    """Unit rays (n, 3) in the world of a registered camera at world times (n,); NaN where it sees no target."""
    camera = scene.cameras[camera_id]
    xy = path.evaluate((time_s - camera.offset_s) / camera.rate)
    return to_rays(xy) @ camera.camera_from_world.rotation


def fit_structure(scene: Scene, structure: Structure, settings: StructureSettings) -> Scene:
    """The scene with a least-jerk spline through the triangulated points."""
    grid = knot_grid(structure.time_s, settings.knot_spacing_s, settings.margin_s, settings.bridge_s)
    if grid is None:
        raise ReconstructionError(
            "triangulate",
            "no stretch of the flight can be triangulated",
            counts={"points": len(structure.time_s)},
            hint="The cameras' geometry contradicts itself; check calibrations and frame rates",
        )
    control = fit_spline(grid, structure.time_s, structure.point_in_world, structure.sigma)
    return scene.with_trajectory(grid, control)
