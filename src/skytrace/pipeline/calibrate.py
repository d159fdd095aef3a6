"""From pictures of a board to a lens: find, choose the views, fit, judge."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from skytrace.errors import ReconstructionError
from skytrace.geometry.projection import LensModel
from skytrace.model.camera import Intrinsics, LensDeviation
from skytrace.pipeline.board_search import FoundBoards
from skytrace.vision.calibrate.certainty import Certainty, assess
from skytrace.vision.calibrate.choose import choose_lens
from skytrace.vision.calibrate.fit import Fit
from skytrace.vision.calibrate.problem import View, collect
from skytrace.vision.calibrate.spread import spread_out
from skytrace.vision.calibrate.verdict import FEWEST_VIEWS, Verdict, judge
from skytrace.vision.calibrate.views import as_views

_ASPECT_DEVIATION = 5e-4  # of pixels taken to be of a standard shape
_STAGE = "calibrate"


@dataclass(frozen=True, eq=False, slots=True)
class Calibration:
    """A lens with all that speaks for it."""

    lens: Intrinsics  # with its deviations
    frame_rate_hz: float | None
    found: FoundBoards
    size: tuple[int, int] | None  # inner corners along the longer and the shorter side of the board
    views: tuple[View, ...]  # that were given to the fit
    fit: Fit
    certainty: Certainty
    verdict: Verdict
    costs: Mapping[LensModel, float]  # mean squared residual, in deviations, of each lens model tried

    def fates(self) -> dict[str, str]:
        """What became of each picture: "used", or why not."""
        fates = {}
        for name, board in zip(self.found.names, self.found.boards, strict=True):
            fates[name] = "no board found" if board is None or not len(board) else "too little of the board in view"
        for name, _ in self.found.seen:
            fates[name] = "like other pictures" if len(self.found.seen) > len(self.views) else fates[name]
        for k, view in enumerate(self.views):
            rms = self.fit.rms_px[k]
            fates[view.name] = f"set aside: its corners are off by {rms:.2f} px" if np.isfinite(rms) else "set aside"
        for k in self.fit.views.tolist():
            fates[self.views[k].name] = "used"
        return fates

    def summary(self) -> dict[str, Any]:
        """Plain values for people and machines."""
        fates, certainty = self.fates(), self.certainty
        return {
            "pictures": len(self.found.names),
            "boards_found": len(self.found.seen),
            "used": len(self.fit.views),
            "corners_used": len(self.fit.corners),
            "board": _board_words(self),
            "rms_px": self.fit.total_rms_px,
            "model_costs": dict(self.costs),
            "focal_sd": certainty.focal,
            "focal_sd_formal": certainty.focal_formal,
            "focal_halves_rms": certainty.halves_rms,
            "focal_motion_sensitivity": certainty.motion_sensitivity,
            "turn_sd_rad": self.fit.beliefs.turn_sigma_rad,
            "advice": list(self.verdict.advice),
            "refused": list(self.verdict.refusals),
            "warnings": list(self.found.warnings),
            "not_used": {name: fate for name, fate in fates.items() if fate != "used"},
        }


def calibrate(
    found: FoundBoards, size: tuple[int, int] | None, model: LensModel | None, rng: np.random.Generator
) -> Calibration:
    """Fit a lens to the boards found. `size` are the inner corners along the longer and the shorter side, if known.

    A set that does not determine its lens still gives one, with the verdict's refusals. Raises ReconstructionError
    where there is too little to fit anything.
    """
    views, size = as_views(found.seen, size or (found.markers.size if found.markers else None))
    chosen = spread_out(views, found.size_px)
    if len(chosen) < FEWEST_VIEWS:
        counts = {"pictures": len(found.names), "that show the board": len(views)}
        hint = (
            "Photograph or film a flat chessboard that fills a good part of the picture, sharp and evenly lit, in 20 "
            "to 40 places and tilts; three by three corners or more must be in view"
        )
        raise ReconstructionError(_STAGE, "too few views of a board", counts=counts, threshold=FEWEST_VIEWS, hint=hint)
    corners = collect(chosen, found.size_px)
    try:
        fit, _, costs = choose_lens(corners, model)
    except ValueError as error:
        hint = "Are all pictures from one lens at one zoom, and of one flat board? A model can be given with --model"
        counts = {"views": len(chosen)}
        raise ReconstructionError(_STAGE, f"no lens fits: {error}", counts=counts, hint=hint) from None
    if len(fit.views) < FEWEST_VIEWS:
        counts = {"views": len(chosen), "that agree": len(fit.views)}
        hint = "Are all pictures from one lens at one zoom, and of one flat board?"
        raise ReconstructionError(_STAGE, "too few views agree on a lens", counts=counts, hint=hint)
    certainty = assess(fit, rng)
    aspect = _ASPECT_DEVIATION if certainty.aspect is None else certainty.aspect
    deviation = LensDeviation(certainty.focal, aspect, certainty.principal_px, certainty.distortion)
    lens = replace(fit.state.lens, deviation=deviation)
    verdict = judge(fit, certainty)
    return Calibration(lens, found.frame_rate_hz, found, size, tuple(chosen), fit, certainty, verdict, costs)


def refuse(calibration: Calibration) -> None:
    """Raise ReconstructionError where the views do not determine the lens."""
    if calibration.verdict.refusals:
        counts = {"pictures": len(calibration.found.names), "used": len(calibration.fit.views)}
        raise ReconstructionError(_STAGE, "; ".join(calibration.verdict.refusals), counts=counts)


def _board_words(calibration: Calibration) -> str:
    size = calibration.size
    squares = "of unknown size" if size is None else f"{size[0] + 1} x {size[1] + 1} squares"
    markers = calibration.found.markers
    return f"chessboard, {squares}" if markers is None else f"ChArUco ({markers.dictionary}), {squares}"
