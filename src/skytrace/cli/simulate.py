"""`skytrace simulate`: a FLIGHT with known truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from skytrace.errors import InputError
from skytrace.simulation import presets, simulate, write_flight


def simulate_command(
    output: Path, preset: str, cameras: int | None, duration_s: float | None, noise_px: float | None, seed: int
) -> None:
    """Simulate, write, print where."""
    if preset not in presets:
        raise InputError("--preset", f"unknown preset {preset!r}: expected one of {', '.join(presets)}")
    changes = {"n_cameras": cameras, "duration_s": duration_s, "noise_px": noise_px}
    try:
        scenario = replace(presets[preset], **{k: v for k, v in changes.items() if v is not None})
    except ValueError as error:
        raise InputError("simulate", str(error)) from error
    print(write_flight(simulate(scenario, np.random.default_rng(seed)), output, name=preset))
