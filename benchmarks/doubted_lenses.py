"""Calibrations that do not fit, on simulated flights: right ones doubted, wrong ones found, and what doubt is worth.

    python -m benchmarks.doubted_lenses [--seeds N] [--first-seed N] [--duration S] [--cameras N] [--kind KIND]...

Flights are those of the preset "realistic": every calibration is as wrong as calibrations are, and detections drift.
One camera's is then made wrong by more: in its first radial coefficient, in its decentring, or its detections are
displaced by a wavy pattern that no coefficient describes. For each kind: in how many flights that camera, and how many
of the other cameras, had their radial distortion taken from the flight; how many were found to keep a pattern over the
image; and the mean error of the trajectory with the doubt and without it (radial priors as usual), in cm.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from skytrace.geometry.rigid import align_similarity
from skytrace.model.track import Recording
from skytrace.pipeline.config import Config
from skytrace.pipeline.lens_summary import has_pattern, patterns
from skytrace.pipeline.offline import Outcome, outcome, run
from skytrace.pipeline.prepare import prepare_recordings
from skytrace.simulation import presets, simulate
from skytrace.simulation.simulator import SimulatedFlight

WRONG = "cam1"
RADIAL: Mapping[str, tuple[float, ...]] = MappingProxyType(
    {
        "usual": (0, 0, 0, 0, 0),
        "k1 off by 0.15": (0.15, 0, 0, 0, 0),
        "k1 off by 0.35": (0.35, 0, 0, 0, 0),
        "k1 off by 0.6": (0.6, 0, 0, 0, 0),
        "p1 and p2 off by 0.004, 0.003": (0, 0, 0.004, -0.003, 0),
    }
)
WAVY_PX: Mapping[str, float] = MappingProxyType({"wavy, 0.6 px": 0.6, "wavy, 1.2 px": 1.2})
KINDS = (*RADIAL, *WAVY_PX)
HEADER = (
    "calibration of one camera",
    "flights",
    "doubted",
    "others doubted",
    "pattern",
    "patterns of others",
    "mean cm",
    "mean cm without doubt",
)


def spoilt(recording: Recording, kind: str) -> Recording:
    """The recording with its calibration, or its detections, wrong."""
    if kind in RADIAL:
        lens = recording.intrinsics
        return replace(recording, intrinsics=replace(lens, distortion=lens.distortion + np.array(RADIAL[kind])))
    width = recording.intrinsics.size_px[0]
    tracks = []
    for track in recording.tracks:
        x, y = 2 * np.pi * 3 * track.xy_px.T / width
        wave = np.column_stack([np.sin(x) * np.cos(y), np.cos(x) * np.sin(y)])
        tracks.append(replace(track, xy_px=track.xy_px + np.sqrt(2) * WAVY_PX[kind] * wave))
    return replace(recording, tracks=tuple(tracks))


def error_cm(simulated: SimulatedFlight, found: Outcome) -> float:
    """Mean distance from the true path after a similarity."""
    reconstruction, truth = found.reconstruction, simulated.truth
    true0 = truth.cameras[reconstruction.reference].clock
    found0 = reconstruction.cameras[reconstruction.reference].clock
    time_s = reconstruction.trajectory.sample_times(5.0)
    true_time_s = true0.offset_s + true0.period_s / found0.period_s * (time_s - found0.offset_s)
    flown = (true_time_s >= truth.motion.begin_s) & (true_time_s <= truth.motion.end_s)
    position, true = reconstruction.trajectory.position(time_s[flown]), truth.motion.position(true_time_s[flown])
    moved = align_similarity(position, true).apply(position)
    return 100 * float(np.linalg.norm(moved - true, axis=1).mean())


def measure(simulated: SimulatedFlight, kind: str) -> dict[str, Any]:
    """One flight with one camera spoilt."""
    recordings = [spoilt(r, kind) if r.camera_id == WRONG else r for r in simulated.recordings]
    config = Config()
    cleaned = prepare_recordings(recordings, config.clean).recordings
    found = outcome(run(cleaned, config))
    plain = outcome(run(cleaned, replace(config, doubt_lenses=False))) if found.doubted else found
    seen = patterns(found.reconstruction.cameras)
    kept = [c for c, e in found.reconstruction.cameras.items() if has_pattern(seen[c], e.sigma_px)]
    return {
        "kind": kind,
        "cameras": len(found.reconstruction.cameras),
        "doubted": list(found.doubted),
        "patterns": kept,
        "deviations": {c: None if p is None else p.deviations for c, p in seen.items()},
        "cm": error_cm(simulated, found),
        "cm without doubt": error_cm(simulated, plain),
    }


def row(kind: str, rows: list[dict[str, Any]]) -> tuple[str, ...]:
    """The figures of one kind."""
    others = sum(r["cameras"] - 1 for r in rows)

    def share(key: str) -> tuple[str, str]:
        wrong = sum(WRONG in r[key] for r in rows)
        return f"{wrong} of {len(rows)}", f"{sum(len(r[key]) for r in rows) - wrong} of {others}"

    doubted, patterned = share("doubted"), share("patterns")
    means = (np.mean([r[key] for r in rows]) for key in ("cm", "cm without doubt"))
    return (kind, f"{len(rows)}", *doubted, *patterned, *(f"{mean:.2f}" for mean in means))


def main() -> None:
    """Measure and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--duration", type=float, default=150.0)
    parser.add_argument("--cameras", type=int, default=4)
    parser.add_argument("--kind", action="append", choices=KINDS, help="may be repeated; default: all")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    scenario = replace(presets["realistic"], duration_s=arguments.duration, n_cameras=arguments.cameras)
    everything = []
    print("| " + " | ".join(HEADER) + " |\n" + "| --- " * len(HEADER) + "|")
    for kind in arguments.kind or KINDS:
        rows = []
        for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
            rows.append({"seed": seed, **measure(simulate(scenario, np.random.default_rng([17, seed])), kind)})
        everything += rows
        print("| " + " | ".join(row(kind, rows)) + " |", flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps(everything, indent=1) + "\n")


if __name__ == "__main__":
    main()
