"""How much is found in videos, how truly, how exactly and at what cost? Real clips and rendered flights.

    python -m benchmarks.detection [--data DIR] [--work DIR] [--only clips|rendered|cost] [--quick] [--json FILE]

Real clips: `sky-clips` of SKYTRACE_DATA, with boxes by hand. A labelled frame is found when a track has a detection in
its box or in the next frame's, as labels can lag by one; every other detection of any track is false. `on target` is
the share found by the tracks taken as the target alone. OpenCV's MOG2 feeds the same tracker.

Rendered flights: made once and kept in --work. A frame is found when a track lies within half the target's width, or
3 px, of the truth; errors are given for widths above 6 px. A track is false when less than half of its detections are
the target's; birds and insects, which some videos have, count as false here. `longest loss` is the longest time for
which the visible target was not found after it had been found first.

Cost: CPU seconds per frame, of decoding alone and of everything, on the same file in one process, the least of several
runs taken in turns.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from skytrace.io.video import read_frames
from skytrace.pipeline.detect import DetectedVideo, detect_video
from skytrace.vision.follow import Method

CLIPS_FOLDER = "sky-clips"
PRECISE_PX = 6.0
MAX_COST_RATIO = 1.33


@dataclass(frozen=True)
class Flight:
    """A rendered flight; everything else is the preset's."""

    name: str
    preset: str
    size_px: tuple[int, int]
    rate_hz: float
    cameras: int
    duration_s: float
    seed: int
    distractors: bool = False


FLIGHTS = (
    Flight("1080p", "demo", (1920, 1080), 30.0, 4, 20.0, 101),
    Flight("1080p legs", "legs", (1920, 1080), 25.0, 3, 20.0, 102),
    Flight("1080p hover", "hover_legs", (1920, 1080), 30.0, 3, 20.0, 103),
    Flight("1080p 60 Hz", "turns", (1920, 1080), 59.94, 2, 15.0, 104),
    Flight("4K", "demo", (3840, 2160), 30.0, 2, 12.0, 105),
    Flight("4K climbs", "climbs", (3840, 2160), 25.0, 2, 12.0, 106),
    Flight("720p", "cluttered", (1280, 720), 30.0, 3, 20.0, 107),
    Flight("VGA", "phones", (640, 480), 30.0, 3, 20.0, 108),
    Flight("1080p birds", "turns", (1920, 1080), 30.0, 3, 20.0, 109, distractors=True),
)
QUICK = (FLIGHTS[0], FLIGHTS[4])
COSTLY = ("1080p", "1080p legs", "1080p 60 Hz", "4K", "4K climbs")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    data = os.environ.get("SKYTRACE_DATA")
    parser.add_argument("--data", type=Path, default=None if data is None else Path(data))
    parser.add_argument("--work", type=Path, default=Path(tempfile.gettempdir()) / "skytrace-benchmark-videos")
    parser.add_argument("--only", choices=("clips", "rendered", "cost"))
    parser.add_argument("--quick", action="store_true", help="two rendered flights, one camera each")
    parser.add_argument("--json", type=Path, help="also write all figures")
    options = parser.parse_args()
    figures: dict[str, Any] = {}
    if options.only in (None, "clips"):
        figures["clips"] = score_clips(options.data)
    flights = QUICK if options.quick else FLIGHTS
    if options.only in (None, "rendered"):
        figures["rendered"] = score_rendered(flights, options.work, first_only=options.quick)
    if options.only in (None, "cost"):
        figures["cost"] = measure_cost([f for f in flights if f.name in COSTLY], options.work)
    if options.json is not None:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        options.json.write_text(json.dumps(figures, indent=1) + "\n")


# Real clips


def score_clips(data: Path | None) -> list[dict[str, Any]]:
    """A row a clip and method; prints the table."""
    if data is None or not (data / CLIPS_FOLDER).is_dir():
        print(f"clips        no {CLIPS_FOLDER}/ found: set SKYTRACE_DATA\n")
        return []
    print(f"{'clip':<18} {'method':<9} {'recall':>7} {'on target':>10} {'false a frame':>14} {'tracks':>7}")
    rows = []
    for video in sorted((data / CLIPS_FOLDER).glob("*.mp4")):
        for method in ("tophat", "mog2"):
            row = {"clip": video.stem, "method": method, **score_clip(video, method)}
            rows.append(row)
            print(
                f"{row['clip']:<18} {method:<9} {row['recall']:>7.3f} {row['on_target']:>10.3f} "
                f"{row['false_per_frame']:>14.3f} {row['tracks']:>7}",
                flush=True,
            )
    print()
    return rows


def score_clip(video: Path, method: Method) -> dict[str, Any]:
    """Recall and false detections of one clip against its boxes."""
    table = np.loadtxt(video.with_suffix(".csv"), delimiter=",", skiprows=1, ndmin=2)
    boxes = {int(row[0]): row[1:] for row in table}
    detected = detect_video(video, method)

    def right(frame: int, x: float, y: float) -> bool:
        for box in (boxes.get(frame), boxes.get(frame + 1)):
            if box is not None and box[0] <= x <= box[0] + box[2] and box[1] <= y <= box[1] + box[3]:
                return True
        return False

    # Some labels count their frames from 1: none is asked for beyond the last frame.
    labelled = {f for f in boxes if f < detected.n_frames}
    found, on_target, n_false = _score(detected, right)
    return {
        "recall": len(found & labelled) / len(labelled),
        "on_target": len(on_target & labelled) / len(labelled),
        "false_per_frame": n_false / detected.n_frames,
        "tracks": len(detected.tracks),
        "view_moved_px": detected.view_moved_px,
    }


def _score(detected: DetectedVideo, right: Callable[[int, float, float], bool]) -> tuple[set[int], set[int], int]:
    """Frames found by any track, frames found by the target's, and how many detections are false."""
    found, on_target, n_false = set[int](), set[int](), 0
    for track in detected.tracks:
        for frame, (x, y) in zip(track.frame.tolist(), track.xy_px.tolist(), strict=True):
            if not right(frame, x, y):
                n_false += 1
                continue
            found.add(frame)
            if track.track_id in detected.target:
                on_target.add(frame)
    return found, on_target, n_false


# Rendered flights


def score_rendered(flights: Sequence[Flight], work: Path, first_only: bool) -> list[dict[str, Any]]:
    """A row a camera of every flight; prints the table."""
    print(
        f"{'flight':<12} {'camera':<7} {'width px':>9} {'recall':>7} {'on target':>10} {'error px':>9} "
        f"{'claimed':>8} {'false tracks':>13} {'longest loss s':>15}"
    )
    rows = []
    for flight in flights:
        videos = render(flight, work)
        for video in videos[:1] if first_only else videos:
            row = {"flight": flight.name, "camera": video.stem, **score_video(video)}
            rows.append(row)
            print(
                f"{flight.name:<12} {video.stem:<7} {row['width_px']:>9.1f} {row['recall']:>7.3f} "
                f"{row['on_target']:>10.3f} {row['error_px']:>9.3f} {row['claimed_px']:>8.3f} "
                f"{row['false_tracks']:>13} {row['longest_loss_s']:>15.2f}",
                flush=True,
            )
    print()
    return rows


def score_video(video: Path, method: Method = "tophat") -> dict[str, Any]:
    """Recall, error and false tracks of one rendered video against its truth."""
    truth = np.genfromtxt(video.parent.parent / "truth" / "frames" / f"{video.stem}.csv", delimiter=",", names=True)
    xy_px, width_px = np.column_stack([truth["x_px"], truth["y_px"]]), truth["size_px"]
    visible = truth["visible"] > 0
    detected = detect_video(video, method)

    def right(frame: int, x: float, y: float) -> bool:
        reach = max(3.0, 0.5 * width_px[frame])
        return bool(visible[frame] and np.hypot(x - xy_px[frame, 0], y - xy_px[frame, 1]) < reach)

    found, on_target, _ = _score(detected, right)
    errors, claims, n_false = [], [], 0
    for track in detected.tracks:
        hits = np.array([right(f, x, y) for f, (x, y) in zip(track.frame.tolist(), track.xy_px, strict=True)])
        n_false += hits.mean() < 0.5
        precise = hits & (width_px[track.frame] > PRECISE_PX)
        off = track.xy_px[precise] - xy_px[track.frame[precise]]
        errors.append(np.hypot(*off.T))
        # Of a deviation along each axis, the median distance is 1.18 times as long.
        claims.append(1.1774 * track.sigma_px[precise])
    error = np.concatenate([np.zeros(0), *errors])
    return {
        "width_px": float(np.median(width_px[visible])),
        "recall": len(found) / int(visible.sum()),
        "on_target": len(on_target) / int(visible.sum()),
        "error_px": float(np.median(error)) if len(error) else float("nan"),
        "claimed_px": float(np.median(np.concatenate(claims))) if len(error) else float("nan"),
        "false_tracks": int(n_false),
        "longest_loss_s": _longest_loss_s(visible, found, truth["time_s"]),
    }


def _longest_loss_s(visible: np.ndarray, found: set[int], time_s: np.ndarray) -> float:
    """The longest time between two found frames in which the target was visible throughout."""
    frames = sorted(found)
    gaps = [time_s[b] - time_s[a] for a, b in itertools.pairwise(frames) if b > a + 1 and visible[a:b].all()]
    return float(max(gaps, default=0.0))


def render(flight: Flight, work: Path) -> list[Path]:
    """The videos of a flight, rendered where they are not there yet."""
    from skytrace.io.video_writer import TICKS_PER_S
    from skytrace.simulation import presets, simulate, write_flight
    from skytrace.simulation.filming import as_filmed
    from skytrace.simulation.render import Film, render_videos

    folder = work / f"{flight.name.replace(' ', '_')}-{flight.seed}"
    if not folder.is_dir():
        scenario = replace(
            presets[flight.preset],
            n_cameras=max(2, flight.cameras),
            duration_s=flight.duration_s,
            watched_fraction=2 / 3,
            resolutions_px=(flight.size_px,),
            frame_rates_hz=(flight.rate_hz,),
        )
        rng = np.random.default_rng(flight.seed)
        simulated = as_filmed(simulate(scenario, rng), TICKS_PER_S)
        film = Film(distractors=flight.distractors)
        write_flight(
            simulated, folder, name=flight.name, write_videos=lambda root: render_videos(simulated, film, root, rng)
        )
    return sorted((folder / "video").glob("*.mp4"))


# Cost


def measure_cost(flights: Sequence[Flight], work: Path, repeats: int = 3) -> list[dict[str, Any]]:
    """CPU milliseconds a frame on the first camera of every flight; prints the table."""
    print(f"{'flight':<12} {'frames':>7} {'decode ms':>10} {'all ms':>8} {'ratio':>6}   (aim: {MAX_COST_RATIO})")
    rows = []
    for flight in flights:
        video = render(flight, work)[0]
        detect_video(video)  # compiles, and fills the disk's cache
        decode, everything, n = np.inf, np.inf, 0
        for _ in range(repeats):
            n = 0
            begin_s = time.process_time()
            for _frame in read_frames(video):
                n += 1
            decode = min(decode, time.process_time() - begin_s)
            begin_s = time.process_time()
            detect_video(video)
            everything = min(everything, time.process_time() - begin_s)
        row = {
            "flight": flight.name,
            "frames": n,
            "decode_ms": 1e3 * decode / n,
            "all_ms": 1e3 * everything / n,
            "ratio": everything / decode,
        }
        rows.append(row)
        print(
            f"{flight.name:<12} {n:>7} {row['decode_ms']:>10.2f} {row['all_ms']:>8.2f} {row['ratio']:>6.2f}", flush=True
        )
    print()
    return rows


if __name__ == "__main__":
    main()
