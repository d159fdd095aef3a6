"""What prior knowledge of lenses is worth: the recordings under several settings of it.

    SKYTRACE_DATA=... python -m benchmarks.lens_priors

Settings that differ from the default in what is believed of pixels' shape and of principal points. Errors are those of
every covered sample, aligned as `skytrace evaluate` does; intervals of nominally 68 and 95 % hold the share of true
positions that is given.
"""

from __future__ import annotations

import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from skytrace.datasets import Labels, write_dataset
from skytrace.estimation.adjust.settings import AdjustSettings
from skytrace.io.flight import Flight, read_flight
from skytrace.io.truth import read_true_positions, true_path
from skytrace.pipeline.config import Config
from skytrace.pipeline.judging import evaluate
from skytrace.pipeline.offline import outcome, run
from skytrace.pipeline.prepare import prepare_flight

_NONE = 1e3  # a deviation that says nothing
SETTINGS: dict[str, AdjustSettings] = {
    "as it is": AdjustSettings(),
    "calibrated pixel shape and principal point": AdjustSettings(standard_aspect_sigma=_NONE, centring_sigma=_NONE),
    "standard pixels only": AdjustSettings(centring_sigma=_NONE),
    "centred lenses only": AdjustSettings(standard_aspect_sigma=_NONE),
    "pixels twice as standard": AdjustSettings(standard_aspect_sigma=0.0005),
    "pixels half as standard": AdjustSettings(standard_aspect_sigma=0.002),
    "lenses centred to 0.5 %": AdjustSettings(centring_sigma=0.005),
    "lenses centred to 1.2 %": AdjustSettings(centring_sigma=0.012),
}
RECORDINGS: tuple[tuple[str, Labels], ...] = (
    ("dataset1", "auto"),
    ("dataset1", "manual"),
    ("dataset3", "auto"),
    ("dataset3", "manual"),
)


def measure(flight: Flight, settings: AdjustSettings) -> str:
    """Mean error and camera centres in cm of a blind reconstruction, and how many intervals hold the truth."""
    from scipy.stats import chi2

    config = replace(Config(), adjust=settings)
    reconstruction = outcome(run(prepare_flight(flight, config.clean).recordings, config)).reconstruction
    assert flight.truth is not None
    truth, rate_hz = true_path(flight.truth.trajectory, flight.truth.rate_hz)
    centres = None if flight.truth.positions is None else read_true_positions(flight.truth.positions)
    found = evaluate(reconstruction, truth=truth, rate_hz=rate_hz, known_centres=centres)
    assert found.trajectory is not None
    errors = found.trajectory.complete
    said = f"{100 * errors.statistics.mean:.2f}"
    if found.centres_aligned is not None:
        said += f" (centres {100 * found.centres_aligned.mean:.1f})"
    assert errors.sigma is not None
    squared = (errors.error / errors.sigma) ** 2
    inside = [100 * float(np.mean(squared <= chi2.ppf(share, 3) / 3)) for share in (0.6827, 0.9545)]
    return f"{said}, {inside[0]:.0f}/{inside[1]:.0f} %"


def main() -> None:
    """Reconstruct every recording under every setting and print a Markdown table."""
    if "SKYTRACE_DATA" not in os.environ:
        sys.exit("set SKYTRACE_DATA to the folder that holds drone-tracking/")
    print("| | " + " | ".join(f"{name} {labels}" for name, labels in RECORDINGS) + " |")
    print("| --- " * (len(RECORDINGS) + 1) + "|")
    with tempfile.TemporaryDirectory() as folder:
        data = Path(os.environ["SKYTRACE_DATA"])
        flights = [read_flight(write_dataset(n, k, data, Path(folder) / f"{n}_{k}")) for n, k in RECORDINGS]
        for label, settings in SETTINGS.items():
            print(f"| {label} | " + " | ".join(measure(f, settings) for f in flights) + " |", flush=True)


if __name__ == "__main__":
    main()
