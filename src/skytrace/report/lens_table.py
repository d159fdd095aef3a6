"""The lenses as calibrated and as refined by the flight, side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from skytrace.geometry.projection import COEFFICIENTS
from skytrace.model.camera import Intrinsics
from skytrace.model.reconstruction import CameraEstimate, Reconstruction
from skytrace.report.tables import cell, finite, table
from skytrace.report.words import number, with_deviation

_LENS = ("fx [px]", "fy [px]", "cx [px]", "cy [px]")
_ODD = 3.0
_DIGITS = 3


def lens_table(reconstruction: Reconstruction, summary: Mapping[str, Any]) -> str:
    """Two rows for each camera, calibrated and refined, with what the residuals say of the lens; empty without any."""
    if not reconstruction.cameras:
        return ""
    used = {c.refined.model for c in reconstruction.cameras.values()}
    names = list(dict.fromkeys(name for model in COEFFICIENTS if model in used for name in COEFFICIENTS[model]))
    rows = []
    for camera_id, camera in reconstruction.cameras.items():
        verdicts = _mapping(_mapping(summary.get("observability")).get(camera_id))
        row = _mapping(_mapping(summary.get("cameras")).get(camera_id))
        rows.append((cell(camera_id, "calibrated"), ["", *_given(camera.calibrated, names)]))
        rows.append((cell(camera_id, "refined"), [_pattern(row), *_refined(camera, names, verdicts)]))
    return table("Lenses as calibrated and as refined", ["camera", "pattern", *_LENS, *names], rows)


def _given(lens: Intrinsics, names: Sequence[str]) -> list[str]:
    coefficients = _coefficients(lens)
    pixels = [f"{v:,.1f}" for v in (*lens.focal_px, *lens.principal_px)]
    distortion = [number(coefficients[name], _DIGITS) if name in coefficients else "" for name in names]
    return [cell(text) for text in (*pixels, *distortion)]


def _coefficients(lens: Intrinsics) -> dict[str, float]:
    return dict(zip(COEFFICIENTS[lens.model], lens.distortion.tolist(), strict=True))


def _refined(camera: CameraEstimate, names: Sequence[str], verdicts: Mapping[str, Any]) -> list[str]:
    lens, coefficients = camera.refined, _coefficients(camera.refined)
    focal, aspect = (_deviation(verdicts, name) for name in ("focal_scale", "aspect"))
    out = []
    for axis, deviation in enumerate((focal, float(np.hypot(focal, aspect)))):
        parameter = ("focal_scale", "aspect")[axis]
        scale = camera.calibrated.focal_px[axis]
        out.append(_value(float(lens.focal_px[axis]), scale * deviation, 1, verdicts.get(parameter)))
    for axis, name in enumerate(("principal_x", "principal_y")):
        deviation = camera.calibrated.focal_px[axis] * _deviation(verdicts, name)
        out.append(_value(float(lens.principal_px[axis]), deviation, 1, verdicts.get(name)))
    for name in names:
        if name not in coefficients:
            out.append("")
        elif name in verdicts:
            out.append(_value(coefficients[name], _deviation(verdicts, name), 3, verdicts[name]))
        else:
            out.append(cell(number(coefficients[name], _DIGITS)))
    return out


def _value(value: float, deviation: float, decimals: int, verdict: Any) -> str:
    pull = _mapping(verdict).get("pull_sd")
    note = f"{abs(pull):.1f} deviations off" if finite(pull) and abs(pull) > _ODD else ""
    text = with_deviation(value, deviation) if np.isfinite(deviation) and deviation > 0 else f"{value:,.{decimals}f}"
    return cell(text, note)


def _deviation(verdicts: Mapping[str, Any], name: str) -> float:
    deviation = _mapping(verdicts.get(name)).get("posterior_sd")
    return float(deviation) if finite(deviation) else float("nan")


def _pattern(row: Mapping[str, Any]) -> str:
    pattern = _mapping(row.get("residual_pattern"))
    if not finite(pattern.get("rms_px")):
        return cell("not to be told")
    if not pattern.get("named"):
        return cell("none")
    return cell(f"{number(pattern['rms_px'], 2)} px", f"{number(pattern['deviations'], 2)} deviations")


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}
