"""Calibrations as `calibration.read_calibration` reads them: mvus JSON, with the lens model and its deviations."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from skytrace.model.camera import Intrinsics


def calibration_text(
    lens: Intrinsics, frame_rate_hz: float | None = None, about: Mapping[str, Any] | None = None
) -> str:
    """The file's text. `about` adds keys that tell how the calibration came about; readers pass over them."""
    (fx, fy), (cx, cy) = lens.focal_px.tolist(), lens.principal_px.tolist()
    document: dict[str, Any] = {
        "K-matrix": [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]],
        "distCoeff": lens.distortion.tolist(),
        "model": lens.model,
        "resolution": list(lens.size_px),
    }
    if frame_rate_hz is not None:
        document["fps"] = frame_rate_hz
    if lens.deviation is not None:
        document["deviation"] = {
            "focal": lens.deviation.focal,
            "aspect": lens.deviation.aspect,
            "principal_px": lens.deviation.principal_px.tolist(),
            "distortion": lens.deviation.distortion.tolist(),
        }
    return json.dumps({**document, **(about or {})}, indent=1) + "\n"
