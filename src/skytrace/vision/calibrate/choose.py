"""Which lens model, and which shape of pixels, the corners ask for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skytrace.geometry.pixel_aspect import standard_aspect
from skytrace.geometry.projection import LensModel
from skytrace.vision.calibrate.fit import Fit, fit_lens
from skytrace.vision.calibrate.problem import Corners, State
from skytrace.vision.calibrate.start import first_guess

_STANDARD_WITHIN = 0.01
# A fisheye replaces a pinhole only if it explains the corners better by this share; where both bend alike the
# pinhole with its tangential terms is the more general.
_BETTER = 0.9
_CUT = 6.0  # deviations; corners beyond, and those of views left out, count as this


def choose_lens(corners: Corners, model: LensModel | None = None) -> tuple[Fit, State, dict[LensModel, float]]:
    """The best fit, the start it grew from, and the cost of each model tried per corner; `model` decides beforehand.

    Both the residuals and the points that must be given up count. Raises ValueError where no model fits any view.
    """
    models: tuple[LensModel, ...] = ("pinhole", "fisheye") if model is None else (model,)
    fits: dict[LensModel, tuple[Fit, State]] = {}
    problem: ValueError | None = None
    for name in models:
        try:
            start = first_guess(corners, name)
            fits[name] = (fit_lens(corners, start, aspect_free=True), start)
        except ValueError as error:
            problem = error
    if not fits:
        raise problem if problem else ValueError("corners: no model fits")
    noise_px = min(float(np.median(fit.beliefs.noise_px)) for fit, _ in fits.values())
    costs: dict[LensModel, float] = {name: cost(fit, len(corners), noise_px) for name, (fit, _) in fits.items()}
    best = min(costs, key=lambda name: costs[name])
    if "pinhole" in costs and costs[best] > _BETTER * costs["pinhole"]:
        best = "pinhole"
    fit, start = fits[best]
    focal_x_px, focal_y_px = fit.state.lens.focal_px
    standard = standard_aspect(focal_y_px / focal_x_px, _STANDARD_WITHIN)
    if standard is not None:
        start = with_aspect(start, standard)
        fit = fit_lens(corners, start)
    return fit, start, costs


def cost(fit: Fit, n_corners: int, noise_px: float) -> float:
    """Mean squared residual in deviations, cut off, over all corners that were given."""
    squared = (fit.residual_px**2).sum(1) / noise_px**2
    given_up = n_corners - len(squared)
    return float((np.minimum(squared, _CUT**2).sum() + given_up * _CUT**2) / n_corners)


def with_aspect(state: State, aspect: float) -> State:
    """The state with fy / fx as given."""
    focal = state.lens.focal_px[0]
    return replace(state, lens=replace(state.lens, focal_px=np.array([focal, aspect * focal])))
