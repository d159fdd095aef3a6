"""How often, how surely and how fast are two cameras synchronised? Simulated pairs with known clocks.

    python benchmarks/sync_pairs.py --pairs 1000 --seed 1 [--workers 2] [--shortest 30] [--json FILE] [--rows]

Two cameras film one flight for 30 to 120 s of common view (or from `--shortest` on), with frame rates from 24 to 240,
clocks that differ by up to 0.2 % in rate and by minutes in offset, focal lengths wrong by 0.7 % and readouts by a tenth
of a frame, and up to 20 % false detections, half of them clustered. Every fifth pair has no common view: half of those
saw different parts of one flight, half different flights.

A pair is right when the offset found is within one frame of 30 Hz of the truth at the middle of the common view, and
confident when its confidence reaches `CONFIDENT`; the best guess counts, sure or not. The printed table and the JSON
hold the same figures.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from skytrace.estimation.clean import CleanSettings
from skytrace.estimation.correspond import image_path
from skytrace.estimation.synchronize import SyncSettings, weigh_offsets
from skytrace.model.track import Recording
from skytrace.pipeline.prepare import prepare_recordings
from skytrace.simulation import Scenario, SimulatedFlight, simulate

_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
CONFIDENT = 0.99
FRAME_S = 1 / 30
NO_OVERLAP_EVERY = 5
SHORTEST_S, LONGEST_S = 30.0, 120.0
MOTIONS = ("smooth", "legs", "turns", "climbs", "hover_legs")
FRAME_RATES_HZ = (24.0, 25.0, 29.97, 30.0, 50.0, 59.94, 100.0, 120.0, 240.0)
READOUT_FRACTION = 0.6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--shortest", type=float, default=SHORTEST_S, help="common view in seconds")
    parser.add_argument("--json", type=Path, default=Path(__file__).parent / "baseline" / "sync_pairs.json")
    parser.add_argument("--rows", action="store_true", help="print every pair that is not right")
    options = parser.parse_args()
    for name in _THREADS:  # read by the workers when they import numpy
        os.environ.setdefault(name, "1")
    rows = run_pairs(options.pairs, options.seed, options.workers, options.shortest)
    figures = summarise(rows)
    for name, value in figures.items():
        print(f"{name:<44}{value:>10.4g}" if isinstance(value, float) else f"{name:<44}{value:>10}")
    if options.rows:
        for row in rows:
            if row["right"] != row["has_overlap"] or row["accepted"] != row["has_overlap"]:
                print(json.dumps(row))
    options.json.parent.mkdir(parents=True, exist_ok=True)
    document = {
        "pairs": options.pairs,
        "seed": options.seed,
        "shortest_s": options.shortest,
        "figures": figures,
        "rows": rows,
    }
    options.json.write_text(json.dumps(document, indent=1) + "\n")


def run_pairs(count: int, seed: int, workers: int, shortest_s: float = SHORTEST_S) -> list[dict[str, Any]]:
    """One row a pair, in order."""
    job = partial(measure_pair, seed, shortest_s)
    if workers <= 1:
        return [job(k) for k in range(count)]
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        return list(pool.map(job, range(count), chunksize=4))


def summarise(rows: Sequence[Mapping[str, Any]]) -> dict[str, float | int]:
    """The figures of the table."""
    true = [r for r in rows if r["has_overlap"]]
    false = [r for r in rows if not r["has_overlap"]]
    confident = [r for r in true if r["confident"]]
    errors = np.array([abs(r["error_frames"]) for r in true if r["right"]] or [np.nan])
    cpu = np.array([r["cpu_s"] for r in rows])
    squared = np.array(
        [r["error_sd"] ** 2 for r in true if r["confident"] and r["right"] and r["error_sd"] is not None]
    )
    return {
        "pairs with a common view": len(true),
        "right, %": 100 * sum(r["right"] for r in true) / max(len(true), 1),
        "confident, %": 100 * len(confident) / max(len(true), 1),
        "confident and wrong": sum(not r["right"] for r in confident),
        "accepted": sum(r["accepted"] for r in true),
        "accepted and wrong": sum(r["accepted"] and not r["right"] for r in true),
        "pairs without a common view": len(false),
        "accepted without a common view": sum(r["accepted"] for r in false),
        "error of the right ones, median, frames": float(np.median(errors)),
        "error of the right ones, 95 %, frames": float(np.percentile(errors, 95)),
        "squared error over variance, mean": float(squared.mean()) if len(squared) else float("nan"),
        "squared error over variance, median": float(np.median(squared)) if len(squared) else float("nan"),
        "CPU s a pair, mean": float(cpu.mean()),
        "CPU s a pair, worst": float(cpu.max()),
        "CPU s of image paths a pair, mean": float(np.mean([r["paths_cpu_s"] for r in rows])),
    }


def measure_pair(seed: int, shortest_s: float, index: int) -> dict[str, Any]:
    """Simulate pair `index` and synchronise it."""
    pair = draw_pair(
        np.random.default_rng([seed, index]), has_overlap=index % NO_OVERLAP_EVERY != 4, shortest_s=shortest_s
    )
    prepared = prepare_recordings(pair.recordings, CleanSettings()).recordings
    begin = time.process_time()
    paths = {r.camera_id: image_path(r, READOUT_FRACTION) for r in prepared}
    paths_cpu_s = time.process_time() - begin
    begin = time.process_time()
    found = weigh_offsets(paths, SyncSettings(), np.random.default_rng(0))
    cpu_s = time.process_time() - begin
    row = {"index": index, **pair.words, "cpu_s": cpu_s, "paths_cpu_s": paths_cpu_s}
    row |= {"has_overlap": pair.truth is not None, "accepted": False, "confident": False, "right": False}
    row |= {"error_frames": None, "error_sd": None, "confidence": 0.0}
    if found.evidence:
        (best,) = found.evidence
        row |= {
            "accepted": best.accepted,
            "confidence": best.confidence,
            "evidence": best.evidence,
            "rival_evidence": best.rival_evidence,
            "support": best.support_s / max(best.overlap_s, 1e-9),
            "overlap_s": best.overlap_s,
            "confident": bool(best.confidence >= CONFIDENT),
        }
        if pair.truth is not None:
            time0_s, time1_s = pair.truth
            error_s = best.offset_s + best.rate * time0_s - time1_s
            row |= {"error_frames": error_s / FRAME_S, "right": bool(abs(error_s) <= FRAME_S)}
            row["error_sd"] = error_s / best.offset_sigma_s
    return row


class Pair:
    """Recordings of two cameras, and camera times (cam0, cam1) of one instant in the middle of their common view."""

    def __init__(
        self, recordings: Sequence[Recording], truth: tuple[float, float] | None, words: dict[str, Any]
    ) -> None:
        self.recordings, self.truth, self.words = recordings, truth, words


def draw_pair(rng: np.random.Generator, *, has_overlap: bool, shortest_s: float = SHORTEST_S) -> Pair:
    """A random pair; one with a common view is drawn anew until that lasts `shortest_s` to 120 s."""
    while True:
        scenario, rate_error = _draw_scenario(rng, has_overlap, shortest_s)
        flight = simulate(scenario, rng.spawn(1)[0])
        recordings = list(flight.recordings)
        if not has_overlap and rng.uniform() < 0.5:  # another flight altogether
            recordings[1] = simulate(scenario, rng.spawn(1)[0]).recordings[1]
        second = recordings[1]
        recordings[1] = replace(second, frame_rate_hz=second.frame_rate_hz * (1 + rate_error))
        words = {
            "motion": scenario.motion,
            "fps": [round(r.frame_rate_hz, 2) for r in recordings],
            "false_detections": round(scenario.outlier_fraction + scenario.clustered_fraction, 3),
            "rate_error": round(rate_error, 5),
        }
        if not has_overlap:
            return Pair(recordings, None, words)
        common_s, middle_s = common_view(flight)
        if shortest_s <= common_s <= LONGEST_S:
            times = [camera_time_s(flight, r, middle_s) for r in recordings]
            return Pair(recordings, (times[0], times[1]), {**words, "common_s": round(common_s, 1)})


def _draw_scenario(rng: np.random.Generator, has_overlap: bool, shortest_s: float) -> tuple[Scenario, float]:
    watched = rng.uniform(0.6, 1.0) if has_overlap else rng.uniform(0.3, 0.48)
    seen_s = rng.uniform(shortest_s + 2, LONGEST_S + 10)
    false = rng.uniform(0, 0.2)
    scenario = Scenario(
        motion=str(rng.choice(MOTIONS)),  # type: ignore[arg-type]
        duration_s=seen_s / (2 * watched - 1) if has_overlap else seen_s / watched,
        speed_m_s=rng.uniform(4, 10),
        n_cameras=2,
        camera_distance=rng.uniform(0.8, 1.2),
        frame_rates_hz=tuple(float(f) for f in rng.choice(FRAME_RATES_HZ, 2)),
        offset_range_s=300.0,
        clock_drift=0.0,
        readout_spread=0.1,
        focal_error=0.007,
        watched_fraction=watched,
        dropout_fraction=rng.uniform(0, 0.1),
        outlier_fraction=false / 2,
        clustered_fraction=false / 2,
    )
    return scenario, float(rng.uniform(-2e-3, 2e-3))


def common_view(flight: SimulatedFlight, bin_s: float = 0.1) -> tuple[float, float]:
    """Seconds in which both cameras detected the target, and the middle of them in world time."""
    seen = [np.unique((d.time_s[~d.is_outlier] // bin_s).astype(int)) for d in flight.truth.detections.values()]
    both = np.intersect1d(*seen)
    return len(both) * bin_s, float(np.median(both)) * bin_s if len(both) else 0.0


def camera_time_s(flight: SimulatedFlight, recording: Recording, world_s: float) -> float:
    """A camera's nominal time at a world time, as the middle row has it: with the readout that image paths assume."""
    clock = flight.truth.cameras[recording.camera_id].clock
    frame = (world_s - clock.offset_s - 0.5 * clock.readout_s) / clock.period_s
    return (frame + 0.5 * READOUT_FRACTION) / recording.frame_rate_hz


if __name__ == "__main__":
    main()
