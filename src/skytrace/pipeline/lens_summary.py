"""Calibrations that do not fit: lenses against their priors, and patterns that residuals keep over the image."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from skytrace.estimation.lens_doubt import CONTRADICTED
from skytrace.estimation.residual_field import ResidualPattern, residual_pattern
from skytrace.model.reconstruction import CameraEstimate
from skytrace.pipeline.observability import PARAMETERS, Verdicts
from skytrace.pipeline.offline import Outcome

_RADIAL = ("k1", "k2", "k3")
_SURE = 4.0  # deviations, and more than any shift showed
_LARGE = 0.1  # of the residuals' robust deviation: smaller patterns do not matter


def patterns(cameras: Mapping[str, CameraEstimate]) -> dict[str, ResidualPattern | None]:
    """The part of each camera's residuals that depends on the place in the image."""
    out = {}
    for camera_id, camera in cameras.items():
        r, inlier = camera.residuals, camera.residuals.inlier
        out[camera_id] = residual_pattern(
            r.time_s[inlier], r.measured_px[inlier], r.error_px[inlier], camera.refined.size_px
        )
    return out


def has_pattern(pattern: ResidualPattern | None, sigma_px: float) -> bool:
    """Whether a pattern is there and large enough to be worth a word."""
    if pattern is None:
        return False
    sure = pattern.deviations > _SURE and pattern.chance <= 1 / (pattern.shifts + 1)
    return sure and pattern.rms_px > _LARGE * sigma_px


def pattern_section(pattern: ResidualPattern | None, sigma_px: float) -> dict[str, Any] | None:
    """`residual_pattern` of a camera in summary.json; None where the flight could not tell."""
    if pattern is None:
        return None
    return {
        "rms_px": pattern.rms_px,
        "deviations": pattern.deviations,
        "chance": pattern.chance,
        "named": has_pattern(pattern, sigma_px),
    }


def lens_warnings(outcome: Outcome, verdicts: Verdicts, found: Mapping[str, ResidualPattern | None]) -> list[str]:
    """Which calibrations do not fit, and why, in words."""
    out = []
    for camera_id in outcome.reconstruction.cameras:
        out += _pulls(camera_id, verdicts[camera_id])
        if camera_id in outcome.doubted:
            doubt = outcome.doubted[camera_id]
            what = f"its {PARAMETERS[doubt.column][1]} came out {abs(doubt.deviations):.1f} deviations from it"
            out.append(
                f"Camera {camera_id}'s calibration does not fit how it filmed: {what}. Its radial distortion was taken "
                "from the flight; calibrate the lens anew, in the mode that filmed."
            )
    return [*out, *_pattern_words(outcome.reconstruction.cameras, found)]


def _pattern_words(cameras: Mapping[str, CameraEstimate], found: Mapping[str, ResidualPattern | None]) -> list[str]:
    """One sentence on all cameras whose residuals keep a pattern."""
    sizes_px = {c: p.rms_px for c, p in found.items() if p is not None and has_pattern(p, cameras[c].sigma_px)}
    if not sizes_px:
        return []
    named = ", ".join(f"{camera_id} ({size_px:.2f} px)" for camera_id, size_px in sizes_px.items())
    return [
        f"Residuals keep a pattern over the image, which comes back wherever the target does: {named} along each axis. "
        "These lenses do not have quite the shape of their calibrations: calibrating anew in the mode that filmed, "
        "perhaps with another lens model, would help."
    ]


def _pulls(camera_id: str, rows: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Parameters other than the radial distortion that run against their priors."""
    out, names = [], dict(PARAMETERS.values())
    for name, row in rows.items():
        pull = row.get("pull_sd")
        if pull is None or abs(pull) <= CONTRADICTED or name in _RADIAL:
            continue
        if name == "focal_scale":
            out.append(
                f"Camera {camera_id}'s focal length had to change by {100 * np.expm1(row['value']):+.1f} %, "
                f"{abs(pull):.1f} deviations: its calibration does not fit how it filmed (zoom, stabilisation or "
                "another resolution?)."
            )
        else:
            out.append(
                f"Camera {camera_id}'s {names[name]} lies {abs(pull):.1f} deviations from its calibration, which does "
                "not fit how it filmed (stabilisation, or a crop of the sensor?)."
            )
    return out
