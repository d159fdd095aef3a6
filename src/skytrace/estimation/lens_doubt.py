"""Calibrations that a flight contradicts: lens parameters further from them than calibrations are usually wrong."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from skytrace.estimation.adjust.driver import Adjusted
from skytrace.estimation.adjust.problem import FOCAL, LENS, RADIAL
from skytrace.geometry.arrays import FloatArray
from skytrace.model.track import Recording

CONTRADICTED = 3.0  # deviations
_TOLD = 0.9  # posterior over prior deviation above which the flight says too little to contradict anything
_OF_LENS = slice(RADIAL.start - LENS.start, RADIAL.stop - LENS.start)


@dataclass(frozen=True, slots=True)
class LensDoubt:
    """What a calibration was found to be wrong in before its radial distortion was taken from the flight."""

    column: int  # of the worst parameter, as in adjust.problem
    change: float  # of that parameter
    deviations: float


def lens_pulls(adjusted: Adjusted, lens_sigma: FloatArray) -> FloatArray:
    """How many deviations (c, 7) the lens parameters lie from their priors, NaN where the flight tells too little.

    A prior drags the estimate towards itself: where the calibration errs as the prior says and the data are honest, the
    estimate's distance from the prior's mean has the variance that the data took away, prior minus posterior.
    `lens_sigma` (c, 7) are posterior deviations.
    """
    prior = adjusted.priors.deviation[:, LENS] * np.sqrt(adjusted.inflation)
    told = (prior > 0) & (lens_sigma < _TOLD * prior)
    moved = adjusted.state.lens - adjusted.priors.mean[:, LENS]
    spread = np.sqrt(np.where(told, prior**2 - lens_sigma**2, 1.0))
    return np.where(told, moved / spread, np.nan)


def doubted_lenses(adjusted: Adjusted, lens_sigma: FloatArray) -> dict[str, LensDoubt]:
    """Cameras whose radial distortion contradicts the calibration, and by how much."""
    out = {}
    for i, (camera_id, pulls) in enumerate(zip(adjusted.camera_ids, lens_pulls(adjusted, lens_sigma), strict=True)):
        radial = np.nan_to_num(pulls[_OF_LENS])
        worst = int(np.argmax(np.abs(radial)))
        if abs(radial[worst]) > CONTRADICTED:
            column = RADIAL.start + worst
            out[camera_id] = LensDoubt(column, float(adjusted.state.lens[i, column - FOCAL]), float(radial[worst]))
    return out


def doubting(recordings: Mapping[str, Recording], doubted: Mapping[str, LensDoubt]) -> dict[str, Recording]:
    """Recordings whose doubted calibrations say little of the radial distortion."""
    return {
        c: replace(r, intrinsics=replace(r.intrinsics, radial_doubted=True)) if c in doubted else r
        for c, r in recordings.items()
    }
