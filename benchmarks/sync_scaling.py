"""How the cost of synchronising two cameras grows with the length of their recordings.

    python benchmarks/sync_scaling.py [--minutes 7.5 15 30 60] [--rate-error 1e-3]

Each length runs in a process of its own, at 60 frames a second; printed are CPU seconds, also relative to n log n, the
peak of the process's memory, and the error of the offset found in the middle of the flight. With a rate error the
frame rate given for the second camera is wrong by that factor: 1e-3 is 30 for 29.97.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import resource
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np

from skytrace.estimation.clean import CleanSettings
from skytrace.estimation.correspond import image_path
from skytrace.estimation.synchronize import SyncSettings, weigh_offsets
from skytrace.pipeline.prepare import prepare_recordings
from skytrace.simulation import Scenario, simulate


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, nargs="+", default=[7.5, 15.0, 30.0, 60.0])
    parser.add_argument("--rate-error", type=float, default=0.0)
    options = parser.parse_args()
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    print(f"{'minutes':>8}{'CPU s':>8}{'us / (n ln n)':>15}{'MiB':>7}{'MiB before':>12}{'error, frames':>15}")
    for minutes in options.minutes:
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
            cpu_s, before, peak, error_s = pool.submit(measure, minutes, options.rate_error).result()
        n = minutes * 3600
        relative = 1e6 * cpu_s / (n * np.log(n))
        print(f"{minutes:>8.1f}{cpu_s:>8.2f}{relative:>15.2f}{peak:>7.0f}{before:>12.0f}{30 * error_s:>15.3f}")


def measure(minutes: float, rate_error: float) -> tuple[float, float, float, float]:
    """CPU seconds of the synchronisation, peak MiB of the process before and after it, error in seconds."""
    scenario = Scenario(
        n_cameras=2,
        duration_s=60 * minutes,
        frame_rates_hz=(60.0,),
        clock_drift=2e-5,
        outlier_fraction=0.03,
        clustered_fraction=0.03,
    )
    flight = simulate(scenario, np.random.default_rng(1))
    first, second = flight.recordings
    second = replace(second, frame_rate_hz=second.frame_rate_hz * (1 + rate_error))
    prepared = prepare_recordings((first, second), CleanSettings()).recordings
    paths = {r.camera_id: image_path(r, scenario.readout_fraction) for r in prepared}
    clocks = [c.clock for c in flight.truth.cameras.values()]
    middle_s = 0.5 * (flight.truth.motion.begin_s + flight.truth.motion.end_s)
    frames = [(middle_s - c.offset_s - 0.5 * c.readout_s) / c.period_s for c in clocks]
    true_s = [
        (f + 0.5 * scenario.readout_fraction) / r.frame_rate_hz for f, r in zip(frames, (first, second), strict=True)
    ]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    begin = time.process_time()
    found = weigh_offsets(paths, SyncSettings(), np.random.default_rng(0))
    cpu_s = time.process_time() - begin
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    error_s = np.inf
    if found.evidence:
        (best,) = found.evidence
        error_s = best.offset_s + best.rate * true_s[0] - true_s[1]
    return cpu_s, before, peak, float(error_s)


if __name__ == "__main__":
    main()
