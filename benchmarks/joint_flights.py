"""Flights of the same cameras, each by itself and joined: `skytrace reconstruct` of one and of several flights.

    SKYTRACE_DATA=... python -m benchmarks.joint_flights [--recordings] [--variants] [--simulated N] [--json FILE]

`--recordings`: the public recordings with truth, each joined with dataset4 (automatic detections). `--variants`: the
same, sharing only some parameters of the devices. `--simulated N`: N pairs of short flights of three cameras whose
focal lengths are off by 3 %, and how often a zoom that was changed between them is found. CPU seconds are those of the
joining alone.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.same_cameras import filmed_by_the_same, zoomed
from benchmarks.uncertainty import normalised_errors
from skytrace.cli.evaluate import evaluate_truth
from skytrace.cli.reconstruct import Given, summary_of, write_outcome
from skytrace.datasets import write_dataset
from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import align_similarity
from skytrace.io.flight import read_flight
from skytrace.pipeline.config import Config
from skytrace.pipeline.exchange import NAMES, SHARED
from skytrace.pipeline.flight_hints import flight_hints
from skytrace.pipeline.joint import join
from skytrace.pipeline.offline import Outcome, outcome, run
from skytrace.pipeline.prepare import prepare_flight, prepare_recordings
from skytrace.simulation.simulator import SimulatedFlight

JOINED = (("dataset1", "dataset4"), ("dataset3", "dataset4"), ("dataset1", "dataset3", "dataset4"))
VARIANTS: Mapping[str, tuple[str, ...]] = {
    "focal scale": ("focal_scale",),
    "focal scale, readout": ("focal_scale", "readout_s"),
    "and aspect": ("focal_scale", "readout_s", "aspect"),
    "and principal point (default)": SHARED,
    "the same without readout": tuple(name for name in SHARED if name != "readout_s"),
    "and radial distortion": tuple(NAMES.values()),
}
ZOOMS = (1.0, 1.05, 1.08, 1.15)
CONFIG = Config()


@dataclass(frozen=True, eq=False)
class Recorded:
    """A public recording, reconstructed by itself."""

    given: Given
    outcome: Outcome


def reconstructed(name: str, data: Path, folder: Path) -> Recorded:
    flight = read_flight(write_dataset(name, "auto", data, folder / name))
    given = Given(flight, prepare_flight(flight, CONFIG.clean))
    return Recorded(given, outcome(run(given.prepared.recordings, CONFIG, hints=flight_hints(flight))))


def judged(recorded: Recorded, found: Outcome, folder: Path) -> dict[str, Any]:
    """The errors of a run as `skytrace evaluate` finds them, in cm."""
    truth = recorded.given.flight.truth
    assert truth is not None  # only recordings with truth are judged
    write_outcome(folder / "run", recorded.given, found, summary_of(recorded.given, found, {}), CONFIG)
    evaluation = evaluate_truth(folder / "run", truth)
    assert evaluation.trajectory is not None
    errors, centres = evaluation.trajectory.complete.statistics, evaluation.centres_aligned
    return {
        "N": errors.n,
        "mean cm": round(100 * errors.mean, 2),
        "median cm": round(100 * errors.median, 2),
        "RMSE cm": round(100 * errors.rmse, 2),
        "camera centres cm": "" if centres is None else round(100 * centres.mean, 1),
    }


def recordings(data: Path, variants: Mapping[str, Sequence[str]]) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        alone = {n: reconstructed(n, data, folder) for n in ("dataset1", "dataset3", "dataset4")}
        for n in ("dataset1", "dataset3"):
            rows.append({"recording": n, "joined with": "", "shared": "", **judged(alone[n], alone[n].outcome, folder)})
        for flights in JOINED:
            for variant, parameters in variants.items():
                begin = time.process_time()
                joint = join({n: alone[n].outcome for n in flights}, {}, CONFIG, parameters=parameters)
                spent = round(time.process_time() - begin, 1)
                for n in flights[:-1]:
                    others = ", ".join(f for f in flights if f != n)
                    row = {"recording": n, "joined with": others, "shared": variant}
                    row |= judged(alone[n], joint.outcomes[n], folder)
                    left_out = " ".join(r.device.name for r in joint.devices if r.left_out)
                    rows.append({**row, "rounds": joint.rounds, "not shared": left_out, "CPU s": spent})
    return rows


def simulated(pairs: int) -> list[dict[str, Any]]:
    """Errors of pairs of flights, and what was said of a zoom, by how much it was changed."""
    rows = []
    for zoom in ZOOMS:
        focal, path, claimed = ({"alone": [], "joint": []} for _ in range(3))
        said, right = 0, 0
        for seed in range(1, pairs + 1):
            flights = {f: filmed_by_the_same(seed, k) for k, f in enumerate("ab")}
            if zoom != 1:
                flights["b"] = zoomed(flights["b"], "cam1", zoom)
            prepared = {f: prepare_recordings(s.recordings, CONFIG.clean) for f, s in flights.items()}
            alone = {f: outcome(run(p.recordings, CONFIG)) for f, p in prepared.items()}
            joint = join(alone, {}, CONFIG)
            left_out = [r.device.name for r in joint.devices if r.left_out]
            said, right = said + bool(left_out), right + (left_out == ["cam1"])
            for which, found in (("alone", alone), ("joint", joint.outcomes)):
                focal[which].append(_focal_errors(flights["a"], found["a"]))
                path[which] += [_path_error_m(flights[f], found[f]) for f in "ab"]
                claimed[which] += [normalised_errors(flights[f], found[f])["trajectory"] for f in "ab"]
        rows.append(
            {
                "zoom": zoom,
                "pairs": pairs,
                "a device not shared": said,
                "the zoomed one alone": right if zoom != 1 else "",
                "focal error of the first flight %: alone": round(100 * _rms(focal["alone"]), 2),
                "joined": round(100 * _rms(focal["joint"]), 2),
                "error along the paths cm: alone": round(100 * _rms(path["alone"]), 1),
                "joined ": round(100 * _rms(path["joint"]), 1),
                "in claimed deviations: alone": round(_rms(claimed["alone"]), 2),
                "joined  ": round(_rms(claimed["joint"]), 2),
            }
        )
    return rows


def _focal_errors(simulated: SimulatedFlight, found: Outcome) -> FloatArray:
    true = [simulated.truth.cameras[c] for c in found.adjusted.camera_ids]
    scale = [np.log(c.intrinsics.focal_px[0] / c.calibrated.focal_px[0]) for c in true]
    return found.adjusted.state.lens[:, 0] - np.array(scale)


def _path_error_m(simulated: SimulatedFlight, found: Outcome) -> float:
    """Root mean square distance to the true path after a similarity."""
    reconstruction, motion = found.reconstruction, simulated.truth.motion
    time_s = reconstruction.trajectory.sample_times(10.0)
    true = simulated.truth.cameras[reconstruction.reference].clock
    own = reconstruction.cameras[reconstruction.reference].clock
    true_s = true.offset_s + true.period_s / own.period_s * (time_s - own.offset_s)
    flown = (true_s >= motion.begin_s) & (true_s <= motion.end_s)
    at, truth = reconstruction.trajectory.position(time_s[flown]), motion.position(true_s[flown])
    return _rms(np.linalg.norm(align_similarity(at, truth).apply(at) - truth, axis=1))


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(np.concatenate([np.atleast_1d(v) for v in values])))))


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    columns = list(dict.fromkeys(key for row in rows for key in row))
    lines = ["| " + " | ".join(columns) + " |", "| --- " * len(columns) + "|"]
    return "\n".join(lines + ["| " + " | ".join(str(row.get(c, "")) for c in columns) + " |" for row in rows])


def main() -> None:
    """Measure what is asked for and print Markdown tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", action="store_true")
    parser.add_argument("--variants", action="store_true")
    parser.add_argument("--simulated", type=int, default=0, metavar="N", help="pairs of flights for each zoom")
    parser.add_argument("--json", type=Path, help="also write the rows here")
    arguments = parser.parse_args()
    if not (arguments.recordings or arguments.variants or arguments.simulated):
        parser.error("expected --recordings, --variants or --simulated N")
    rows: dict[str, list[dict[str, Any]]] = {}
    if arguments.recordings or arguments.variants:
        if "SKYTRACE_DATA" not in os.environ:
            sys.exit("set SKYTRACE_DATA to the folder that holds drone-tracking/")
        variants = VARIANTS if arguments.variants else {"default": SHARED}
        rows["recordings"] = recordings(Path(os.environ["SKYTRACE_DATA"]), variants)
        print(table(rows["recordings"]), flush=True)
    if arguments.simulated:
        rows["simulated"] = simulated(arguments.simulated)
        print(table(rows["simulated"]), flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
