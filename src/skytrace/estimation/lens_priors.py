"""Where a camera's lens may lie: a prior on the adjustment's lens parameters, which are changes of its calibration."""

from __future__ import annotations

import numpy as np

from skytrace.estimation.adjust.settings import AdjustSettings
from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.pixel_aspect import standard_aspect
from skytrace.geometry.projection import RADIAL
from skytrace.model.camera import Intrinsics

_DOUBTED = 10.0  # times the deviations of a radial distortion that a flight contradicts
_MISTAKEN = 2.0  # deviations by which a calibration may miss a standard shape of pixels


def lens_prior(lens: Intrinsics, settings: AdjustSettings) -> tuple[FloatArray, FloatArray]:
    """Means (7,) and deviations (7,) of the parameters `adjust.problem.LENS`.

    Pixels are square, or of another standard shape, unless the calibration clearly says otherwise: without that, common
    errors of all cameras' shapes would stretch the flight along the vertical, and nothing in it would tell. And lenses
    sit over the middle of their pictures, which weighs in beside where the calibration has the principal point.
    """
    mean, deviation = np.zeros(7), lens_deviations(lens, settings)
    middle_px = (np.array(lens.size_px) - 1) / 2
    centring = settings.centring_sigma * float(np.max(lens.size_px / lens.focal_px))
    weight = 1 / (1 + (centring / deviation[2:4]) ** 2)
    mean[2:4] = weight * (middle_px - lens.principal_px) / lens.focal_px
    deviation[2:4] *= np.sqrt(1 - weight)
    if lens.radial_doubted:
        deviation[4:] *= _DOUBTED
    aspect = lens.focal_px[1] / lens.focal_px[0]
    standard = standard_aspect(aspect, _MISTAKEN * deviation[1])
    if standard is not None:
        mean[1] = np.log(standard / aspect)
        deviation[1] = min(deviation[1], settings.standard_aspect_sigma)
    return mean, deviation


def lens_deviations(lens: Intrinsics, settings: AdjustSettings) -> FloatArray:
    """Deviations (7,) of the parameters `adjust.problem.LENS`.

    Where the calibration tells its own, they count, with what a lens may change by between a board at arm's length and
    a flight: focusing moves it. Calibrations are not taken to be worse than those without deviations.
    """
    radial = settings.fisheye_radial_sigma if lens.model == "fisheye" else settings.radial_sigma
    usual = np.array([settings.focal_sigma, settings.aspect_sigma, *(settings.principal_sigma,) * 2, *radial])
    if lens.deviation is None:
        return usual
    own = lens.deviation
    principal = own.principal_px / lens.focal_px
    told = np.array([own.focal, own.aspect, *principal, *own.distortion[list(RADIAL[lens.model])]])
    change = np.array([settings.focusing_sigma, 0.0, *(settings.principal_focusing_sigma,) * 2, 0.0, 0.0, 0.0])
    return np.minimum(np.hypot(told, change), usual)
