"""The benchmark of the recordings, on a flight that is at hand everywhere."""

from __future__ import annotations

import shutil
from pathlib import Path

from skytrace.benchmark.recordings import measure


def test_a_flight_is_reconstructed_and_judged_in_a_process_of_its_own(flight: Path, tmp_path: Path) -> None:
    path = tmp_path / "flight"
    shutil.copytree(flight, path)
    row = measure("simulated", "auto", path)
    assert row.failure == ""
    assert (row.name, row.n_registered, row.n_cameras) == ("simulated auto", 3, 3)
    assert row.errors is not None
    assert 0 < row.errors.median_cm <= row.errors.mean_cm <= row.errors.rmse_cm < 10
    assert 150 < row.errors.n <= row.errors.n_covered
    assert row.covered_s is not None
    assert 30 < row.covered_s < 42
    assert row.centres_cm is not None
    assert row.synchronisation_ms is not None
    assert row.synchronisation_ms < 5
    assert 0.5 < row.cpu_s < 60
    assert 100 < row.peak_mib < 1000
    assert row.paper is None


def test_a_flight_that_cannot_be_reconstructed_fails_with_its_message(flight: Path, tmp_path: Path) -> None:
    path = tmp_path / "flight"
    shutil.copytree(flight, path)
    for file in (path / "detections").glob("*.txt"):
        if not file.stem.endswith("timestamps"):
            lines = file.read_text().splitlines()
            file.write_text("\n".join(lines[:20]) + "\n")
    row = measure("simulated", "auto", path)
    assert row.failure.startswith("skytrace: ")
    assert row.errors is None
    assert row.cpu_s > 0
