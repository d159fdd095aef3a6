"""Fixtures shared by all tests."""

from __future__ import annotations

import os
from pathlib import Path

import hypothesis
import numpy as np
import pytest

# How long an example takes says more about the machine than about the code.
hypothesis.settings.register_profile("skytrace", deadline=None)
hypothesis.settings.load_profile("skytrace")


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real recordings named by SKYTRACE_DATA; its tests are skipped where it is not set."""
    folder = os.environ.get("SKYTRACE_DATA")
    if folder is None or not (Path(folder) / "drone-tracking").is_dir():
        message = f"SKYTRACE_DATA does not name the folder of real recordings (got {folder!r})"
        if os.environ.get("SKYTRACE_REQUIRE_REAL"):
            pytest.fail(message)
        pytest.skip(message)
    return Path(folder)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20)
