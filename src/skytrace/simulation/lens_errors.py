"""What a calibration file gets wrong about its lens."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.projection import RADIAL
from skytrace.model.camera import Intrinsics
from skytrace.simulation.scenario import Scenario

# How far k1, k2, k3 stray from one calibration of a lens to the next, and the radii, in shares of the image's corner,
# at which its photographs pin the radial displacement down.
_RADIAL_SPREAD = {"pinhole": np.array([0.07, 0.2, 0.2]), "fisheye": np.array([0.02, 0.04, 0.04])}
_PINNED = np.array([0.5, 0.75, 1.0])
_FOLD_MARGIN = 1.15


def miscalibrated(lens: Intrinsics, scenario: Scenario, rng: np.random.Generator) -> Intrinsics:
    """The calibration of a lens with the scenario's errors, none beyond three deviations."""
    focal, aspect, x, y = np.clip(rng.normal(size=4), -3, 3)
    scale = 1 + scenario.focal_error * focal
    focal_px = lens.focal_px * [scale, scale * (1 + scenario.aspect_error * aspect)]
    shift_px = scenario.principal_error * lens.focal_px * [x, y]
    calibrated = replace(lens, focal_px=focal_px, principal_px=lens.principal_px + shift_px)
    if scenario.radial_error == 0:
        return calibrated
    corner = float(np.hypot(*(0.5 * np.array(lens.size_px) / lens.focal_px)))  # a fisheye's in its angle
    change = radial_change(corner, scenario.radial_error, rng, _RADIAL_SPREAD[lens.model])
    while True:
        distortion = np.array(lens.distortion)
        distortion[list(RADIAL[lens.model])] += change
        wrong = replace(calibrated, distortion=distortion)
        fold = wrong.one_to_one_radius
        if (fold if lens.model == "pinhole" else np.arctan(fold)) >= _FOLD_MARGIN * corner:
            return wrong
        change = 0.7 * change


def radial_change(
    corner: float, displacement: float, rng: np.random.Generator, spread: FloatArray = _RADIAL_SPREAD["pinhole"]
) -> FloatArray:
    """Errors (3,) of k1, k2 and k3 that go together as those of a calibration do.

    Each coefficient alone is poorly known, their sum r^3 (k1 + k2 r^2 + k3 r^4) is not: it strays by `displacement`
    focal lengths at most at some radii up to that of the image's corner (on the lens's plane). A draw from the Gaussian
    with these two kinds of information.
    """
    radius = corner * _PINNED
    response = radius[:, None] ** [3, 5, 7]
    precision = np.diag(1 / spread**2) + response.T @ response / displacement**2
    # L L^T = precision: L^-T turns unit noise into noise of the inverse covariance.
    change = np.linalg.solve(np.linalg.cholesky(precision).T, np.clip(rng.normal(size=3), -3, 3))
    return np.asarray(change, np.float64)
