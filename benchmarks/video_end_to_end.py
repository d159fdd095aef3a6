"""From rendered videos to a trajectory: four cameras of different lenses and rates, unsynchronised by tens of seconds.

    python -m benchmarks.video_end_to_end [--size WxH] [--film-s 60] [--seeds 1 2] [--work DIR] [--json FILE]

Every camera films two thirds of a flight that it does not wholly see, with rolling shutter and a clock and calibration
that are a little wrong; `skytrace reconstruct` gets the videos and calibrations alone. The error is the mean distance
to the truth after the best similarity, over all covered samples, also as a share of the scene's size: the diagonal of
the box around the flight. Flights are rendered once and kept in --work; detection is done anew.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from skytrace.cli.evaluate import evaluate_truth
from skytrace.cli.reconstruct import reconstruct_flight
from skytrace.io.flight import read_flight
from skytrace.pipeline.config import Config
from skytrace.pipeline.videos import FLIGHT_TRACKS

MAX_SHARE = 0.002
RATES_HZ = (29.97, 25.0, 30.0, 50.0)
WATCHED = 2 / 3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", default="1920x1080", metavar="WxH")
    parser.add_argument("--film-s", type=float, default=60.0, help="length of every video")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--work", type=Path, default=Path(tempfile.gettempdir()) / "skytrace-benchmark-videos")
    parser.add_argument("--json", type=Path, help="also write all figures")
    options = parser.parse_args()
    width, height = map(int, options.size.split("x"))
    rows = []
    for seed in options.seeds:
        flight = render((width, height), options.film_s, seed, options.work)
        rows.append({"seed": seed, "size": options.size, "film_s": options.film_s, **measure(flight)})
    print(
        f"\n{'seed':>4} {'scene m':>8} {'starts s':>9} {'mean cm':>8} {'max cm':>7} {'share %':>8} {'N':>5} "
        f"{'sync ms':>8} {'cameras':>8} {'wall s':>7}   (aim: {100 * MAX_SHARE:.1f} %)"
    )
    for row in rows:
        print(
            f"{row['seed']:>4} {row['scene_m']:>8.1f} {row['starts_spread_s']:>9.1f} {row['mean_cm']:>8.2f} "
            f"{row['max_cm']:>7.2f} {row['share_percent']:>8.4f} {row['n_samples']:>5} {row['sync_ms']:>8.2f} "
            f"{row['registered']:>6}/4 {row['wall_s']:>7.0f}"
        )
    if options.json is not None:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        options.json.write_text(json.dumps(rows, indent=1) + "\n")


def measure(flight: Path) -> dict[str, Any]:
    """Reconstruct a flight of videos and judge it by its truth."""
    shutil.rmtree(flight / FLIGHT_TRACKS, ignore_errors=True)
    truth = read_flight(flight).truth
    assert truth is not None
    place_m = np.loadtxt(truth.trajectory)
    scene_m = float(np.linalg.norm(np.ptp(place_m, axis=0)))
    begin_s = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        summary = reconstruct_flight(flight, run, Config())
        wall_s = time.monotonic() - begin_s
        figures = evaluate_truth(run, truth).as_dict()
    errors = figures["trajectory"]["all"]
    clocks = json.loads((flight / "truth" / "cameras.json").read_text())["cameras"]
    starts_s = [camera["clock"]["offset_s"] for camera in clocks.values()]
    return {
        "scene_m": scene_m,
        "starts_spread_s": float(np.ptp(starts_s)),
        "mean_cm": 100 * errors["mean"],
        "max_cm": 100 * errors["max"],
        "share_percent": 100 * errors["mean"] / scene_m,
        "n_samples": errors["n"],
        "sync_ms": 1e3 * figures["synchronisation"]["mean_s"],
        "registered": sum(camera["registered"] for camera in summary["cameras"].values()),
        "wall_s": wall_s,
    }


def render(size_px: tuple[int, int], film_s: float, seed: int, work: Path) -> Path:
    """The flight's folder, rendered where it is not there yet."""
    from skytrace.io.video_writer import TICKS_PER_S
    from skytrace.simulation import presets, simulate, write_flight
    from skytrace.simulation.filming import as_filmed
    from skytrace.simulation.render import Film, render_videos

    folder = work / f"end_to_end-{size_px[0]}x{size_px[1]}-{film_s:g}s-{seed}"
    if not folder.is_dir():
        scenario = replace(
            presets["demo"],
            n_cameras=4,
            duration_s=film_s / WATCHED,
            watched_fraction=WATCHED,
            resolutions_px=(size_px,),
            frame_rates_hz=RATES_HZ,
        )
        rng = np.random.default_rng(seed)
        simulated = as_filmed(simulate(scenario, rng), TICKS_PER_S)
        write_flight(simulated, folder, write_videos=lambda root: render_videos(simulated, Film(), root, rng))
    return folder


if __name__ == "__main__":
    main()
