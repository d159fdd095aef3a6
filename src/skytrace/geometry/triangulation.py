"""Points from rays of several cameras at common times, with outlying rays found out."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from skytrace.geometry.arrays import BoolArray, FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class Triangulated:
    """Points (n, 3) in the world, the rays that agree with them (n, cameras), and the best parallax between those."""

    point_in_world: FloatArray  # (n, 3), NaN where not `valid`
    inlier: BoolArray  # (n, cameras)
    angle_rad: FloatArray  # (n,)
    valid: BoolArray  # (n,)


def midpoint(centre: FloatArray, ray: FloatArray, weight: FloatArray) -> FloatArray:
    """Points (n, 3) nearest in the weighted least-squares sense to rays.

    Centres (c, 3), unit rays in the world (n, c, 3), weights (n, c). Undetermined points are NaN.
    """
    # sum_c w (I - d d^T) x = sum_c w (I - d d^T) centre
    clean = np.where(weight[..., None] > 0, ray, 0.0)
    A = weight.sum(1)[:, None, None] * np.eye(3) - np.einsum("nc,nci,ncj->nij", weight, clean, clean, optimize=True)
    along = np.einsum("nci,ci->nc", clean, centre)
    b = weight @ centre - np.einsum("nc,nc,nci->ni", weight, along, clean, optimize=True)
    trace = np.trace(A, axis1=1, axis2=2)
    singular = np.linalg.det(A) <= 1e-12 * np.maximum(trace, 1e-300) ** 3
    A[singular] = np.eye(3)
    x = np.linalg.solve(A, b[..., None])[..., 0]
    x[singular] = np.nan
    return x


def ray_errors(point: FloatArray, centre: FloatArray, ray: FloatArray) -> FloatArray:
    """Angles (n, c) in radians between rays and the directions to the points; pi behind a camera, NaN where no ray."""
    direction = point[:, None] - centre
    length = np.linalg.norm(direction, axis=2)
    cosine = np.einsum("nci,nci->nc", direction, ray) / np.maximum(length, 1e-300)
    sine = np.linalg.norm(np.cross(direction, ray), axis=2) / np.maximum(length, 1e-300)
    return np.arctan2(sine, cosine)


def triangulate(
    centre: FloatArray, ray: FloatArray, max_error_rad: float, min_angle_rad: float, min_fraction: float = 0.6
) -> Triangulated:
    """Robust triangulation of rays (n, c, 3) in the world (NaN where not seen) of cameras with centres (c, 3).

    Every pair of cameras proposes a point; the proposal with the most agreeing rays is refined on them. A point is
    valid when at least two rays and `min_fraction` of those present agree within `max_error_rad` with a
    parallax of `min_angle_rad`.
    """
    n, c = ray.shape[:2]
    seen = np.isfinite(ray[..., 0])
    best_point, best_cost = np.full((n, 3), np.nan), np.full(n, np.inf)
    for i, j in combinations(range(c), 2):
        rows = np.flatnonzero(seen[:, i] & seen[:, j])
        if not len(rows):
            continue
        pair = np.zeros((len(rows), c))
        pair[:, [i, j]] = 1.0
        point = midpoint(centre, ray[rows], pair)
        error = ray_errors(point, centre, ray[rows])
        cost = np.where(seen[rows], np.minimum(np.nan_to_num(error / max_error_rad, nan=1.0), 1.0) ** 2, 0.0).sum(1)
        better = np.isfinite(point[:, 0]) & (cost < best_cost[rows])
        best_point[rows[better]], best_cost[rows[better]] = point[better], cost[better]

    inlier = _agreeing(best_point, centre, ray, seen, max_error_rad)
    for _ in range(3):
        distance = np.linalg.norm(best_point[:, None] - centre, axis=2)
        # Angular errors count alike at any distance: the perpendicular offset is weighted by its inverse.
        weight = np.where(inlier, 1 / np.maximum(np.nan_to_num(distance, nan=1.0), 1e-9) ** 2, 0.0)
        enough = inlier.sum(1) >= 2
        refined = midpoint(centre, ray[enough], weight[enough])
        usable = np.isfinite(refined[:, 0])
        best_point[np.flatnonzero(enough)[usable]] = refined[usable]
        inlier = _agreeing(best_point, centre, ray, seen, max_error_rad)
    angle = parallax(ray, inlier)
    valid = (inlier.sum(1) >= np.maximum(2, min_fraction * seen.sum(1))) & (angle >= min_angle_rad)
    best_point[~valid] = np.nan
    return Triangulated(best_point, inlier & valid[:, None], angle, valid)


def parallax(ray: FloatArray, present: BoolArray) -> FloatArray:
    """Best parallax (n,) in radians, at most a quarter turn, among the rays (n, c, 3) that are present (n, c).

    Two rays fix a point as well as the sine of their angle is large: not at all where they are parallel, nor where the
    cameras face each other.
    """
    largest_sine = np.zeros(len(ray))
    for i, j in combinations(range(ray.shape[1]), 2):
        both = present[:, i] & present[:, j]
        sine = np.linalg.norm(np.cross(ray[both, i], ray[both, j]), axis=1)
        largest_sine[both] = np.maximum(largest_sine[both], sine)
    return np.arcsin(np.minimum(largest_sine, 1.0))


def _agreeing(
    point: FloatArray, centre: FloatArray, ray: FloatArray, seen: BoolArray, max_error_rad: float
) -> BoolArray:
    error = ray_errors(point, centre, ray)
    return seen & np.isfinite(error) & (error < max_error_rad)
