"""A choice of views that differ: those of a video are many and mostly alike."""

from __future__ import annotations

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.vision.calibrate.problem import View
from skytrace.vision.calibrate.start import homography

MOST_VIEWS = 60


def spread_out(views: list[View], size_px: tuple[int, int], most: int = MOST_VIEWS) -> list[View]:
    """At most so many views, in their order, each as unlike the others as can be.

    Views are compared by where they put the same patch of board: place, size, turn and tilt are all in that. The next
    one taken is always that whose nearest among the taken is farthest, the first that which shows most corners.
    """
    if len(views) <= most:
        return views
    places = np.stack([_patch(view) for view in views]) / max(size_px)
    taken = [int(np.argmax([len(view) for view in views]))]
    distance = np.linalg.norm(places - places[taken[0]], axis=1)
    while len(taken) < most:
        taken.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(places - places[taken[-1]], axis=1))
    return [views[k] for k in sorted(taken)]


def _patch(view: View) -> FloatArray:
    """Where (8,) the corners of a patch about the view's middle are seen, from the leftmost on."""
    lattice = view.lattice - view.lattice.mean(axis=0)
    half = 0.5 * np.ptp(lattice, axis=0).max()
    H = homography(lattice, view.xy_px)
    square = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)
    seen = np.column_stack([square, np.ones(4)]) @ H.T
    seen = seen[:, :2] / seen[:, 2:]
    leftmost = int(np.argmin(seen[:, 0] + 1e-3 * seen[:, 1]))
    return np.roll(seen, -leftmost, axis=0).ravel()
