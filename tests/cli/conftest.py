"""One short simulated flight and one run of it, shared by all tests of the command line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from .command import Result, python, skytrace


@dataclass(frozen=True)
class Finished:
    """A flight and its RUN, written by a process of their own."""

    flight: Path
    run: Path
    result: Result


@pytest.fixture(scope="session")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A FLIGHT of three cameras and 40 s that nobody may change."""
    folder = tmp_path_factory.mktemp("cli") / "flight"
    result = skytrace("simulate", "-o", folder, "--cameras", 3, "--duration", 40)
    assert result == Result(0, f"{folder}\n", "")
    return folder


@pytest.fixture(scope="session")
def finished(flight: Path) -> Finished:
    run = flight.parent / "run"
    result = python("-m", "skytrace", "reconstruct", flight, "-o", run, environment={"PYTHONHASHSEED": "1"})
    assert result.code == 0, result.err
    return Finished(flight, run, result)
