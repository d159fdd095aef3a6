"""`skytrace simulate`: a FLIGHT with known truth."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from skytrace.errors import InputError
from skytrace.io.atomic import check_replaceable
from skytrace.simulation import Scenario, presets, simulate, write_flight

# With videos, every camera films two thirds of the flight at most: the first its beginning, the last its end.
_FILMED = 2 / 3
_LARGEST_PX = 8192


@dataclass(frozen=True, slots=True)
class VideoOptions:
    """What only videos have."""

    size: str | None = None
    frame_rate_hz: float | None = None
    distractors: bool = False

    def given(self) -> str | None:
        """The first option that was used."""
        used = {"--video-size": self.size, "--video-fps": self.frame_rate_hz, "--distractors": self.distractors}
        return next((name for name, value in used.items() if value), None)


def simulate_command(
    output: Path,
    preset: str,
    cameras: int | None,
    duration_s: float | None,
    noise_px: float | None,
    seed: int,
    video: bool,
    options: VideoOptions,
) -> None:
    """Simulate, write, print where."""
    if preset not in presets:
        raise InputError("--preset", f"unknown preset {preset!r}: expected one of {', '.join(presets)}")
    if not video and (name := options.given()):
        raise InputError(name, "says how videos are made: expected --video with it")
    if video and noise_px is not None:
        raise InputError("--noise", "is the noise of detections, which --video leaves to the detector")
    changes: dict[str, object] = {"n_cameras": cameras, "duration_s": duration_s, "noise_px": noise_px}
    if video:
        changes["watched_fraction"] = min(presets[preset].watched_fraction, _FILMED)
        changes["resolutions_px"] = None if options.size is None else (_size_px(options.size),)
        changes["frame_rates_hz"] = None if options.frame_rate_hz is None else (options.frame_rate_hz,)
    try:
        scenario = replace(presets[preset], **{k: v for k, v in changes.items() if v is not None})
    except ValueError as error:
        raise InputError("simulate", str(error)) from error
    rng = np.random.default_rng(seed)
    if video:
        print(_film(scenario, output, preset, options.distractors, rng))
    else:
        print(write_flight(simulate(scenario, rng), output, name=preset))


def _film(scenario: Scenario, output: Path, name: str, distractors: bool, rng: np.random.Generator) -> Path:
    from skytrace.cli.progress import shown
    from skytrace.io.video_writer import TICKS_PER_S
    from skytrace.simulation.filming import as_filmed
    from skytrace.simulation.render import Film, render_videos

    check_replaceable(output, replace_run=False)
    simulated = as_filmed(simulate(scenario, rng), TICKS_PER_S)
    with shown() as display:

        def on_frame(camera_id: str, done: int, total: int) -> None:
            if done == 1:
                display.open(camera_id, time.monotonic())
            display.count(done, total)
            if done == total:
                display.close()

        def write_videos(folder: Path) -> None:
            render_videos(simulated, Film(distractors=distractors), folder, rng, on_frame)

        return write_flight(simulated, output, name=name, write_videos=write_videos)


def _size_px(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    size_px = (int(match[1]), int(match[2])) if match else (0, 0)
    if not all(16 <= side <= _LARGEST_PX and side % 2 == 0 for side in size_px):
        expected = f"expected WIDTHxHEIGHT, even numbers from 16 to {_LARGEST_PX}, such as 1920x1080"
        raise InputError("--video-size", f"{expected}; got {text!r}")
    return size_px
