"""Are whole flights synchronised, and do the deviations stated match the errors? Simulated flights of several cameras.

    python benchmarks/sync_flights.py --flights 40 --seed 1

Three to six cameras each watch two thirds or more of a flight of one to three minutes, with the errors of clocks,
lenses and detections of `sync_pairs.py`. An error is that of a camera's clock against the reference camera's in the
middle of the flight; it counts as right within a frame of 30 Hz.
"""

from __future__ import annotations

import argparse
import os
import time
from dataclasses import replace

import numpy as np

from benchmarks.sync_pairs import FRAME_RATES_HZ, FRAME_S, MOTIONS, READOUT_FRACTION, camera_time_s
from skytrace.estimation.clean import CleanSettings
from skytrace.estimation.correspond import image_path
from skytrace.estimation.synchronize import SyncSettings, weigh_offsets
from skytrace.pipeline.prepare import prepare_recordings
from skytrace.simulation import Scenario, simulate


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    begin = time.process_time()
    rows = [row for k in range(options.flights) for row in measure(np.random.default_rng([options.seed, k]))]
    cpu_s = time.process_time() - begin
    tied = [r for r in rows if r is not None]
    error_s, sigma_s = np.array(tied).T
    right = np.abs(error_s) <= FRAME_S
    z2 = (error_s / sigma_s)[right] ** 2
    print(f"{'cameras beside the references':<44}{len(rows):>10}")
    print(f"{'tied in':<44}{len(tied):>10}")
    print(f"{'tied in and right':<44}{int(right.sum()):>10}")
    print(f"{'error, median, frames':<44}{np.median(np.abs(error_s)) / FRAME_S:>10.4f}")
    print(f"{'squared error over variance, mean':<44}{z2.mean():>10.2f}")
    print(f"{'within one deviation, %':<44}{100 * (z2 <= 1).mean():>10.1f}")
    print(f"{'within two deviations, %':<44}{100 * (z2 <= 4).mean():>10.1f}")
    print(f"{'CPU s a flight, simulation included':<44}{cpu_s / options.flights:>10.2f}")


def measure(rng: np.random.Generator) -> list[tuple[float, float] | None]:
    """Error and deviation in seconds of each camera beside the reference; None where it is not tied to it."""
    n_cameras, false = int(rng.integers(3, 7)), float(rng.uniform(0, 0.2))
    scenario = Scenario(
        motion=str(rng.choice(MOTIONS)),  # type: ignore[arg-type]
        duration_s=float(rng.uniform(60, 180)),
        speed_m_s=float(rng.uniform(4, 10)),
        n_cameras=n_cameras,
        camera_distance=float(rng.uniform(0.8, 1.2)),
        frame_rates_hz=tuple(float(f) for f in rng.choice(FRAME_RATES_HZ, n_cameras)),
        offset_range_s=300.0,
        clock_drift=0.0,
        readout_spread=0.1,
        focal_error=0.007,
        watched_fraction=float(rng.uniform(0.67, 1.0)),
        dropout_fraction=float(rng.uniform(0, 0.1)),
        outlier_fraction=false / 2,
        clustered_fraction=false / 2,
    )
    flight = simulate(scenario, rng.spawn(1)[0])
    recordings = [
        replace(r, frame_rate_hz=r.frame_rate_hz * (1 + float(rng.uniform(-2e-3, 2e-3)))) for r in flight.recordings
    ]
    prepared = prepare_recordings(recordings, CleanSettings()).recordings
    paths = {r.camera_id: image_path(r, READOUT_FRACTION) for r in prepared}
    found = weigh_offsets(paths, SyncSettings(), np.random.default_rng(0))
    middle_s = 0.5 * (flight.truth.motion.begin_s + flight.truth.motion.end_s)
    true_s = {r.camera_id: camera_time_s(flight, r, middle_s) for r in recordings}
    rows: list[tuple[float, float] | None] = []
    for camera in paths:
        if camera == found.reference:
            continue
        if camera not in found.clocks:
            rows.append(None)
            continue
        offset_s, rate = found.clocks[camera]
        reference_offset_s, reference_rate = found.clocks[found.reference]
        reference_s = reference_offset_s + reference_rate * true_s[found.reference]
        rows.append((offset_s + rate * true_s[camera] - reference_s, found.deviations[camera][0]))
    return rows


if __name__ == "__main__":
    main()
