"""What do hints do to the synchronisation of two cameras? Simulated pairs, blind, rightly and wrongly hinted.

    python -m benchmarks.sync_hints [--pairs 60] [--seed 1] [--workers 2] [--json FILE]

Three kinds of pairs, each camera watching for a minute: with 8 to 20 s in common, with 30 to 50 s in common, and
without any (half of them saw other parts of one flight, half other flights). Each is synchronised without hints, with
`offset_s` true but for a normal error of the deviation stated (0.5 s), with one that is wrong by 5 to 40 s but stated
as well known, and with a common moment read to half a frame in either camera. For pairs without a common view all hints
are wrong: they have both cameras film the same minute.

"tied": accepted; "right": within one frame of 30 Hz, or three of the deviations claimed, of the truth in the middle of
the common view. "said": there is a warning about the hint, or about what rests on it.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from skytrace.estimation.clean import CleanSettings
from skytrace.estimation.correspond import image_path
from skytrace.estimation.hints import Hints, OffsetHint, SimultaneousHint
from skytrace.estimation.synchronize import Synchronisation, SyncSettings, weigh_offsets
from skytrace.model.track import Recording
from skytrace.pipeline.prepare import prepare_recordings
from skytrace.simulation import Scenario, SimulatedFlight, simulate

FRAME_S = 1 / 30
READOUT_FRACTION = 0.6
SIGMA_S = 0.5
MOTIONS = ("smooth", "legs", "turns", "climbs", "hover_legs")
KINDS = ("short", "long", "none")
HINTED = ("blind", "right", "wrong", "moment")


@dataclass(frozen=True, eq=False)
class Pair:
    """Recordings of two cameras, their camera times at one common moment, and offset hints right and wrong."""

    recordings: Sequence[Recording]
    time_s: tuple[float, float] | None
    hints: dict[str, Hints]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=60, help="of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    rows = run_pairs(options.pairs, options.seed, options.workers)
    print(f"{'common view':<12}{'hint':<8}{'pairs':>7}{'tied %':>8}{'tied wrong':>12}{'right %':>9}{'said':>6}")
    for kind in KINDS:
        for hinted in HINTED:
            own = [r for r in rows if r["kind"] == kind and r["hinted"] == hinted]
            tied = [r for r in own if r["tied"]]
            share = 100 / max(len(own), 1)
            print(
                f"{kind:<12}{hinted:<8}{len(own):>7}{share * len(tied):>8.1f}{sum(not r['right'] for r in tied):>12}"
                f"{share * sum(r['right'] for r in own):>9.1f}{sum(r['reported'] for r in own):>6}"
            )
    if options.json:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        document = {"pairs": options.pairs, "seed": options.seed, "rows": rows}
        options.json.write_text(json.dumps(document, indent=1) + "\n")


def run_pairs(count: int, seed: int, workers: int) -> list[dict[str, Any]]:
    """One row a pair and kind of hint, in order."""
    jobs = [(kind, k) for kind in KINDS for k in range(count)]
    job = partial(measure_pair, seed)
    if workers <= 1:
        found = [job(j) for j in jobs]
    else:
        with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
            found = list(pool.map(job, jobs, chunksize=4))
    return [row for rows in found for row in rows]


def measure_pair(seed: int, job: tuple[str, int]) -> list[dict[str, Any]]:
    """Simulate a pair and synchronise it with each kind of hint."""
    kind, index = job
    pair = draw_pair(np.random.default_rng([seed, KINDS.index(kind), index]), kind)
    prepared = prepare_recordings(pair.recordings, CleanSettings()).recordings
    paths = {r.camera_id: image_path(r, READOUT_FRACTION) for r in prepared}
    rows = []
    for hinted in HINTED:
        found = weigh_offsets(paths, SyncSettings(), np.random.default_rng(0), pair.hints[hinted])
        row = {"kind": kind, "index": index, "hinted": hinted, "tied": bool(found.clocks), "right": False}
        row |= {"error_s": None, "reported": bool(found.warnings), "confidence": 0.0}
        if found.evidence:
            row["confidence"] = found.evidence[0].confidence
        if pair.time_s is not None and (known := _error_s(found, pair.time_s)) is not None:
            row |= {"error_s": known[0], "right": bool(abs(known[0]) <= max(FRAME_S, 3 * known[1]))}
        rows.append(row)
    return rows


def _error_s(found: Synchronisation, time_s: tuple[float, float]) -> tuple[float, float] | None:
    """Error of the clocks at a common moment and its deviation; of the best guess where nothing is tied."""
    if found.clocks:
        (zero_s, rate), (sigma_s, _) = found.clocks["cam1"], found.deviations["cam1"]
        return float(zero_s + rate * time_s[1] - time_s[0]), sigma_s
    if not found.evidence:
        return None
    best = found.evidence[0]
    return float(time_s[1] - best.offset_s - best.rate * time_s[0]), best.offset_sigma_s


def draw_pair(rng: np.random.Generator, kind: str) -> Pair:
    """A random pair of a kind; one with a common view is drawn anew until that is long enough."""
    while True:
        common_s = {"short": rng.uniform(8, 20), "long": rng.uniform(30, 50), "none": -rng.uniform(5, 20)}[kind]
        duration_s = 120.0 - common_s
        scenario = _scenario(rng, duration_s, watched=60.0 / duration_s)
        flight = simulate(scenario, rng.spawn(1)[0])
        recordings = list(flight.recordings)
        if kind == "none" and rng.uniform() < 0.5:
            recordings[1] = simulate(scenario, rng.spawn(1)[0]).recordings[1]
        offsets_s = [flight.truth.cameras[r.camera_id].clock.offset_s for r in recordings]
        if kind == "none":
            # As if both had filmed the same minute.
            offsets_s = [-float(np.mean(r.tracks[0].frame)) / r.frame_rate_hz for r in recordings]
        error_s, wrong_s = rng.normal(0, SIGMA_S), rng.uniform(5, 40) * rng.choice([-1, 1])
        hints = {
            "blind": Hints(),
            "right": _hints(recordings, [offsets_s[0], offsets_s[1] + error_s]),
            "wrong": _hints(recordings, [offsets_s[0], offsets_s[1] + wrong_s]),
        }
        if kind == "none":
            return Pair(recordings, None, {**hints, "moment": _moment(recordings, [-o for o in offsets_s], rng)})
        seen_s, middle_s = _common_view(flight)
        if seen_s >= (8.0 if kind == "short" else 25.0):
            times = [_camera_time_s(flight, r, middle_s) for r in recordings]
            return Pair(recordings, (times[0], times[1]), {**hints, "moment": _moment(recordings, times, rng)})


def _hints(recordings: Sequence[Recording], offsets_s: Sequence[float]) -> Hints:
    sigma_s = SIGMA_S / np.sqrt(2)
    return Hints(tuple(OffsetHint(r.camera_id, o, sigma_s) for r, o in zip(recordings, offsets_s, strict=True)))


def _moment(recordings: Sequence[Recording], times_s: Sequence[float], rng: np.random.Generator) -> Hints:
    read_s = {r.camera_id: t + rng.normal(0, FRAME_S / 2) for r, t in zip(recordings, times_s, strict=True)}
    return Hints((), (SimultaneousHint("moment", read_s, FRAME_S / 2),))


def _scenario(rng: np.random.Generator, duration_s: float, watched: float) -> Scenario:
    false = rng.uniform(0, 0.1)
    return replace(
        Scenario(
            motion=str(rng.choice(MOTIONS)),  # type: ignore[arg-type]
            duration_s=duration_s,
            speed_m_s=rng.uniform(4, 10),
            n_cameras=2,
            camera_distance=rng.uniform(0.8, 1.2),
            frame_rates_hz=tuple(float(f) for f in rng.choice((24.0, 25.0, 29.97, 30.0, 50.0, 59.94), 2)),
        ),
        offset_range_s=300.0,
        readout_spread=0.05,
        watched_fraction=watched,
        outlier_fraction=false / 2,
        clustered_fraction=false / 2,
    )


def _common_view(flight: SimulatedFlight, bin_s: float = 0.1) -> tuple[float, float]:
    """Seconds in which both cameras detected the target, and the middle of them in world time."""
    first, second = flight.truth.detections.values()
    moments = [np.unique((d.time_s[~d.is_outlier] // bin_s).astype(int)) for d in (first, second)]
    both = np.intersect1d(moments[0], moments[1])
    return len(both) * bin_s, float(np.median(both)) * bin_s if len(both) else 0.0


def _camera_time_s(flight: SimulatedFlight, recording: Recording, world_s: float) -> float:
    clock = flight.truth.cameras[recording.camera_id].clock
    frame = (world_s - clock.offset_s - 0.5 * clock.readout_s) / clock.period_s
    return (frame + 0.5 * READOUT_FRACTION) / recording.frame_rate_hz


if __name__ == "__main__":
    main()
