"""What the data determine: for each camera's parameters the posterior against the prior, in numbers and in words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from skytrace.estimation.adjust.problem import ASPECT, FOCAL, LENS, OFFSET, PRINCIPAL, RADIAL, RATE, READOUT
from skytrace.estimation.lens_doubt import lens_pulls
from skytrace.model.reconstruction import Residuals
from skytrace.pipeline.offline import Outcome

FIXED, DETERMINED, PARTLY, BY_PRIOR, NOT_AT_ALL = (
    "fixed",
    "determined by the data",
    "partly by the data",
    "by its prior",
    "not at all",
)
_FROM_WELL_TO_BADLY = (FIXED, DETERMINED, PARTLY, BY_PRIOR, NOT_AT_ALL)
_DETERMINED, _PARTLY = 0.3, 0.8  # posterior deviation over prior deviation
_NO_BETTER = 1.02  # beyond rounding
# Deviations, in frames, below which an offset without a prior is determined, and above which it is useless.
_FRAME, _MANY_FRAMES = 1.0, 10.0
_NARROW = 0.5  # of the image height
_LAG_S = 0.5  # over which the target's speed in the image is measured, so that whole pixels do not matter

# By column of the adjustment (adjust.problem): the key in summary.json and what it is called.
PARAMETERS: Mapping[int, tuple[str, str]] = MappingProxyType(
    {
        OFFSET: ("offset_s", "clock offset"),
        RATE: ("rate", "clock rate"),
        READOUT: ("readout_s", "readout time"),
        FOCAL: ("focal_scale", "focal length"),
        ASPECT: ("aspect", "pixel aspect"),
        PRINCIPAL.start: ("principal_x", "principal point's x"),
        PRINCIPAL.start + 1: ("principal_y", "principal point's y"),
        RADIAL.start: ("k1", "radial distortion k1"),
        RADIAL.start + 1: ("k2", "radial distortion k2"),
        RADIAL.start + 2: ("k3", "radial distortion k3"),
    }
)
_KINDS: Mapping[str, Sequence[str]] = MappingProxyType(
    {
        "Clock offsets": ("offset_s",),
        "Clock rates": ("rate",),
        "Readout times": ("readout_s",),
        "Focal lengths": ("focal_scale",),
        "Pixel aspects": ("aspect",),
        "Principal points": ("principal_x", "principal_y"),
        "Radial distortions": ("k1", "k2", "k3"),
    }
)
_OF_THE_CLOCK = ("offset_s", "rate")

Verdicts = Mapping[str, Mapping[str, Mapping[str, Any]]]


def observability(outcome: Outcome) -> dict[str, dict[str, dict[str, Any]]]:
    """For each camera and parameter: value, prior and posterior deviation, and what determined it.

    Without a prior its deviation is None. Offsets are those of cameras.json, their deviations those in the middle of
    the camera's detections. Lens parameters come with how many deviations they lie from their prior, None where the
    data tell too little (`estimation.lens_doubt`).
    """
    adjusted, posterior = outcome.adjusted, outcome.posterior
    prior = adjusted.priors.deviation * np.sqrt(adjusted.inflation)
    pulls = lens_pulls(adjusted, posterior.lens)
    out: dict[str, dict[str, dict[str, Any]]] = {}
    for camera_id, camera in outcome.reconstruction.cameras.items():
        i = adjusted.camera_ids.index(camera_id)
        frame_s = 1 / outcome.recordings[camera_id].frame_rate_hz
        value = np.r_[adjusted.state.clock[i], adjusted.state.lens[i]]
        value[:2] = camera.clock.offset_s, value[1] - 1
        deviation = np.r_[posterior.clock[i], posterior.lens[i]]
        out[camera_id] = {}
        for column, (name, _) in PARAMETERS.items():
            k = column - OFFSET
            row = verdict(float(value[k]), float(prior[i, column]), float(deviation[k]), frame_s)
            if column >= FOCAL:
                pull = float(pulls[i, column - LENS.start])
                row["pull_sd"] = pull if math.isfinite(pull) else None
            out[camera_id][name] = row
    return out


def verdict(value: float, prior: float, posterior: float, useful: float) -> dict[str, Any]:
    """What determined a parameter; deviations without a prior are compared with what is a `useful` one."""
    if prior == 0:
        said = FIXED
    elif math.isinf(prior):
        said = _first((_FRAME * useful, DETERMINED), (_MANY_FRAMES * useful, PARTLY), at=posterior)
    else:
        said = _first((_DETERMINED, DETERMINED), (_PARTLY, PARTLY), (_NO_BETTER, BY_PRIOR), at=posterior / prior)
    return {
        "value": value,
        "prior_sd": None if math.isinf(prior) else prior,
        "posterior_sd": posterior,
        "determined": said,
    }


def _first(*limits: tuple[float, str], at: float) -> str:
    return next((said for limit, said in limits if at <= limit), NOT_AT_ALL)


def observability_words(outcome: Outcome, verdicts: Verdicts) -> list[str]:
    """One sentence for each kind of parameter: which cameras' are determined by what."""
    out = []
    for kind, names in _KINDS.items():
        said: dict[str, list[str]] = {}
        for camera_id, rows in verdicts.items():
            if names[0] in _OF_THE_CLOCK and camera_id == outcome.reconstruction.reference:
                continue  # its clock is the world's
            worst = max((rows[name]["determined"] for name in names), key=_FROM_WELL_TO_BADLY.index)
            said.setdefault(worst, []).append(camera_id)
        parts = [_part(outcome, verdicts, names[0], word, said[word]) for word in _FROM_WELL_TO_BADLY if word in said]
        if parts:
            out.append(f"{kind}: {'; '.join(parts)}.")
    return out


def _part(outcome: Outcome, verdicts: Verdicts, name: str, said: str, camera_ids: Sequence[str]) -> str:
    cameras = []
    for camera_id in camera_ids:
        why = ""
        if name == "readout_s" and said in (BY_PRIOR, NOT_AT_ALL):
            row, residuals = verdicts[camera_id][name], outcome.reconstruction.cameras[camera_id].residuals
            height_px = outcome.reconstruction.cameras[camera_id].refined.height_px
            why = f" ({_assumed_readout(row, residuals, height_px)})"
        cameras.append(camera_id + why)
    return f"{said} for {', '.join(cameras)}"


def _assumed_readout(row: Mapping[str, Any], residuals: Residuals, height_px: int) -> str:
    share, speed_px_s = rows_crossed(residuals, height_px), image_speed_px_s(residuals)
    only = "only " if share < _NARROW else ""
    return (
        f"{1e3 * row['value']:.1f} ms is about what was assumed: the target crossed {only}{100 * share:.0f} % of the "
        f"image height, at {speed_px_s:.0f} px/s"
    )


def rows_crossed(residuals: Residuals, height_px: int) -> float:
    """Share of the image height in which 96 % of the agreeing detections lie."""
    rows = residuals.measured_px[residuals.inlier, 1]
    return float(np.subtract(*np.percentile(rows, [98, 2])) / height_px) if len(rows) else 0.0


def image_speed_px_s(residuals: Residuals) -> float:
    """Median speed of the agreeing detections in the image."""
    order = np.argsort(residuals.time_s[residuals.inlier], kind="stable")
    time_s, xy = (values[residuals.inlier][order] for values in (residuals.time_s, residuals.measured_px))
    later = np.searchsorted(time_s, time_s + _LAG_S)
    later = np.minimum(later, len(time_s) - 1)
    took_s = time_s[later] - time_s
    usable = (took_s > 0.5 * _LAG_S) & (took_s < 2 * _LAG_S)
    if not usable.any():
        return 0.0
    way_px = np.linalg.norm(xy[later] - xy, axis=1)
    return float(np.median(way_px[usable] / took_s[usable]))
