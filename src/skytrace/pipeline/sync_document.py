"""A synchronisation as plain values: what `skytrace sync` writes and every run keeps in its summary."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from skytrace.estimation.synchronize import Synchronisation


def as_document(found: Synchronisation, camera_ids: Sequence[str]) -> dict[str, Any]:
    """The content of the file that `skytrace sync` writes: plain numbers, strings, lists and dicts."""
    cameras: dict[str, Any] = {}
    for camera_id in camera_ids:
        group = next((k for k, g in enumerate(found.groups) if camera_id in g), None)
        if group is None:
            reason = found.untied.get(camera_id, "it has no usable detections")
            cameras[camera_id] = {"tied": False, "reason": reason}
            continue
        offset_s, rate = found.groups[group][camera_id]
        sigma_s, rate_sigma = found.deviations[camera_id]
        cameras[camera_id] = {
            "tied": group == 0,
            "group": group,
            "offset_s": offset_s,
            "rate": rate,
            "offset_sd_s": sigma_s,
            "rate_sd": rate_sigma,
            "confidence": found.confidence[camera_id],
        }
        if group:
            cameras[camera_id]["reason"] = found.untied[camera_id]
    return {
        "reference": found.reference,
        "cameras": cameras,
        "groups": [{"reference": next(iter(g)), "cameras": sorted(g)} for g in found.groups],
        "pairs": [
            {
                "camera0": p.camera0,
                "camera1": p.camera1,
                "accepted": p.accepted,
                "confidence": p.confidence,
                "confidence_without_hints": p.blind_confidence,
                "offset_s": p.offset_s,
                "rate": p.rate,
                "offset_sd_s": p.offset_sigma_s,
                "overlap_s": p.overlap_s,
                "support_s": p.support_s,
                "score": p.evidence,
                "rivals": [{"offset_s": offset_s, "score": score} for offset_s, score in p.rivals],
            }
            for p in found.evidence
        ],
        "disagreement_s": found.disagreement_s.tolist(),
        "hints": [verdict.as_dict for verdict in found.hints],
        "warnings": list(found.warnings),
    }
