"""Flights that determine nothing: a target that hovers or flies straight, seen in the image paths themselves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.estimation.correspond import ImagePath
from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.projection import to_rays

MOTION_WORDS: dict[str, tuple[str, str]] = {
    "hover": (
        "the target hardly moves in the image",
        "Fly the target through a large part of the view; a hovering target fixes neither time nor place",
    ),
    "straight": (
        "the target flew (nearly) along a straight line, which leaves the cameras' geometry undetermined",
        "Record a flight with turns and changes of height",
    ),
}


@dataclass(frozen=True, slots=True)
class MotionShape:
    """Extent of an image path on the plane z = 1, and how far it bends off a straight line relative to its length."""

    extent: float
    bend: float


def image_extent(xy: FloatArray) -> float:
    """Width of an image path (n, 2) in its wider coordinate, robust to outliers."""
    low, high = np.percentile(xy, [5, 95], axis=0)
    return float((high - low).max())


def motion_shape(path: ImagePath, rate_hz: float = 5.0) -> MotionShape:
    """The shape of a path, robust to outliers."""
    times = np.arange(path.begin_s, path.end_s, 1 / rate_hz)
    xy = path.evaluate(times)
    return sampled_shape(xy[np.isfinite(xy[:, 0])])


def sampled_shape(xy: FloatArray) -> MotionShape:
    """The shape of samples (n, 2) of a path on the plane z = 1, robust to outliers."""
    if len(xy) < 10:
        return MotionShape(0.0, 0.0)
    low, high = np.percentile(xy, [2, 98], axis=0)
    inside = xy[((xy >= low) & (xy <= high)).all(axis=1)]
    rays = to_rays(inside if len(inside) >= 10 else xy)
    # A straight flight and the camera span a plane through its centre: the rays' smallest extent vanishes.
    across = np.linalg.svd(rays, full_matrices=False)
    along = rays @ across[2][1]
    offset = rays @ across[2][2]
    return MotionShape(image_extent(xy), float(offset.std() / max(along.std(), 1e-300)))
