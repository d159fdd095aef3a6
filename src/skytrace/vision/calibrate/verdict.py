"""Whether a set of views determines its lens, and what is missing where it does not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.vision.calibrate.certainty import Certainty, at_rest
from skytrace.vision.calibrate.fit import Fit

FEWEST_VIEWS = 4
_LARGEST_FOCAL_DEVIATION = 0.03  # relative; the lens is refused beyond
_DOUBTFUL_FOCAL_DEVIATION = 0.015
_LEAST_REACH, _GOOD_REACH = 0.5, 0.8  # of the way from the picture's middle to its corners
_BARE = 0.2  # of the picture's width or height, from a side to the corners nearest to it
_LEAST_TILT_DEG = 20.0
_LEAST_ROLL_SPREAD_DEG = 30.0
_FEW_VIEWS = 12


@dataclass(frozen=True, slots=True)
class Verdict:
    """Reasons to refuse a lens, none if it is determined, and advice that would make it better."""

    refusals: tuple[str, ...]
    advice: tuple[str, ...]


def judge(fit: Fit, certainty: Certainty) -> Verdict:
    """What the views lack."""
    reach, missing, advice = image_reach(fit), [], []
    tilt_deg = float(np.degrees(np.quantile(fit.state.tilt_rad, 0.8)))
    # Deviations of the equations come from priors alone where the views say nothing: they are no larger than these.
    undetermined = max(certainty.focal, certainty.focal_formal) > _LARGEST_FOCAL_DEVIATION
    tilt_lacks = (
        f"tilt the board: it is seen nearly head-on throughout ({tilt_deg:.0f} degrees at most); hold it at 30 to 50 "
        "degrees to the line of sight in half of the pictures, leaning every way"
    )
    turn_lacks = (
        "turn the board by 90 degrees in half of the pictures: in all of them it stands alike, and what its tilt does "
        "cannot be told from movement while the rows are read out"
    )
    still_lacks = "hold the camera still: movement while the rows are read out cannot be told from the board's tilt"
    if undetermined:
        focal = f"the focal length is uncertain by {100 * certainty.focal:.1f} %"
        causes = []
        if tilt_deg < _LEAST_TILT_DEG:
            causes.append(tilt_lacks)
        elif at_rest(fit) < 0.5 * certainty.focal_formal:
            causes.append(turn_lacks if roll_spread_deg(fit) < _LEAST_ROLL_SPREAD_DEG else still_lacks)
        if not causes:
            causes.append("take more pictures, at other distances and tilts, of a larger or nearer board")
        missing.append(f"{focal}: " + "; ".join(causes))
    else:
        if tilt_deg < _LEAST_TILT_DEG:
            advice.append(tilt_lacks)
        if roll_spread_deg(fit) < _LEAST_ROLL_SPREAD_DEG:
            advice.append("turn the board, or the camera, by 90 degrees in half of the pictures")
        if certainty.focal > _DOUBTFUL_FOCAL_DEVIATION:
            advice.append(f"the focal length is uncertain by {100 * certainty.focal:.1f} %: take more tilted views")
        if len(fit.views) < _FEW_VIEWS:
            advice.append(f"only {len(fit.views)} views were used: take 20 to 40")
    border = f"the board comes no nearer to the picture's corners than {100 * reach:.0f} % of the way from the middle"
    if reach < _LEAST_REACH:
        missing.append(f"the lens's distortion is not determined: {border}; move it close to the border on every side")
    elif reach < _GOOD_REACH:
        advice.append(f"{border}: distortion beyond that is extrapolated")
    bare = bare_sides(fit)
    if bare and not missing:
        advice.append(f"show the board near the {' and the '.join(bare)} of the picture, too: it was never seen there")
    return Verdict(tuple(missing), tuple(advice))


def image_reach(fit: Fit) -> float:
    """How far from the picture's middle, on the way to its own corners, all but the outermost 1 % were seen."""
    half = 0.5 * np.array(fit.corners.size_px)
    radius = np.linalg.norm(fit.corners.xy_px - half, axis=1) / np.linalg.norm(half)
    return float(np.quantile(radius, 0.99))


def bare_sides(fit: Fit) -> list[str]:
    """The sides of the picture near which no corner was seen, but for the outermost 1 %."""
    xy = fit.corners.xy_px / np.array(fit.corners.size_px)
    low, high = np.quantile(xy, [0.01, 0.99], axis=0)
    gaps = {"left": low[0], "right": 1 - high[0], "top": low[1], "bottom": 1 - high[1]}
    return [side for side, gap in gaps.items() if gap > _BARE]


def roll_spread_deg(fit: Fit) -> float:
    """How far boards are turned in the picture against one another, of 45 degrees at most; squares repeat after 90.

    Boards whose longer side is known repeat after 180 degrees only, and spread up to 90.
    """
    direction = fit.state.rotation[:, :2, 0]
    angle = np.arctan2(direction[:, 1], direction[:, 0])
    turns = 2 if fit.corners.shaped.all() else 4
    return float(np.degrees(_circular_spread(turns * angle) / turns))


def _circular_spread(angle_rad: FloatArray) -> float:
    """Largest distance of angles (n,) from their mean direction, the most distant tenth left out."""
    mean = np.angle(np.exp(1j * angle_rad).mean())
    return float(np.quantile(np.abs(np.angle(np.exp(1j * (angle_rad - mean)))), 0.9))
