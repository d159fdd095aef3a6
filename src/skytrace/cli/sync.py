"""`skytrace sync`: when each camera of a FLIGHT filmed, as a JSON file, without any reconstruction."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from skytrace.errors import InputError, ReconstructionError
from skytrace.estimation.correspond import image_path
from skytrace.estimation.synchronize import Synchronisation, synchronize
from skytrace.io.flight import read_flight
from skytrace.pipeline.config import Config
from skytrace.pipeline.prepare import prepare_flight


def sync_command(flight: Path, output: Path, seed: int, as_json: bool) -> None:
    """Read, synchronise, write, print."""
    import numpy as np

    if output.is_dir():
        raise InputError(output, "expected a file to write, got a folder")
    config = Config(seed=seed)
    given = read_flight(flight)
    recordings = {r.camera_id: r for r in prepare_flight(given, config.clean).recordings}
    paths = {c: image_path(r, config.adjust.readout_fraction) for c, r in recordings.items() if r.n_detections}
    if len(paths) < 2:
        counts = {"cameras given": len(recordings), "with detections": len(paths)}
        raise ReconstructionError("synchronise", "fewer than two cameras have usable detections", counts=counts)
    hints_s = {c.camera_id: c.offset_s for c in given.cameras if c.offset_s is not None}
    found = synchronize(paths, config.synchronise, np.random.default_rng(seed), hints_s)
    document = as_document(found, [c.camera_id for c in given.cameras])
    _write(output, json.dumps(document, indent=1) + "\n")
    print(json.dumps(document) if as_json else describe(document, output))


def _write(path: Path, text: str) -> None:
    """Write a file in one step, so that an interruption leaves none or the old one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial")
    partial.write_text(text, encoding="utf-8")
    partial.replace(path)


def as_document(found: Synchronisation, camera_ids: list[str]) -> dict[str, Any]:
    """The content of the file: plain numbers, strings, lists and dicts."""
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
        "warnings": list(found.warnings),
    }


def describe(document: dict[str, Any], output: Path) -> str:
    """The document in a few lines for people."""
    lines = [f"{'camera':<12} {'offset s':>12} {'sd s':>8} {'rate':>11} {'confidence':>11}"]
    for camera_id, c in document["cameras"].items():
        if "offset_s" in c:
            group = f"  group {c['group'] + 1}" if c["group"] else ""
            lines.append(
                f"{camera_id:<12} {c['offset_s']:>12.4f} {c['offset_sd_s']:>8.4f} {c['rate']:>11.6f} "
                f"{c['confidence']:>11.4f}{group}"
            )
        else:
            lines.append(f"{camera_id:<12} not tied in: {c['reason']}")
    for p in document["pairs"]:
        if p["accepted"] and p["rivals"]:
            rivals = ", ".join(f"{r['offset_s']:.2f}" for r in p["rivals"])
            lines.append(f"ambiguous    {p['camera0']}-{p['camera1']}: also plausible at offsets of {rivals} s")
    lines += [f"warning      {text}" for text in document["warnings"]]
    lines.append(f"written to   {output}")
    return "\n".join(lines)
