"""The paper's experiment on dataset3: what pairwise synchronisation is worth."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from skytrace.cli import run

pytestmark = [pytest.mark.real, pytest.mark.slow]


@pytest.fixture(scope="module")
def rows(data_dir: Path, tmp_path_factory: pytest.TempPathFactory):
    output = tmp_path_factory.mktemp("benchmark") / "sync.json"
    assert run(["benchmark", "sync", "--data", str(data_dir), "--shifts", "20", "--json", str(output)]) == 0
    return {row["pipeline"]: row for row in json.loads(output.read_text())["rows"]}


@pytest.mark.parametrize("pipeline", ["full", "blind"])
def test_pairwise_synchronisation_takes_the_shift_away(rows, pipeline: str) -> None:
    row = rows[pipeline]
    assert row["failure"] == ""
    for stage in ("before", "after"):
        assert row[stage]["missing"] == []
        frames = row[stage]["frames"].values()
        assert sum(frames) / len(frames) <= 0.6
    assert row["trajectory"]["mean_cm"] <= 8.0
    assert row["trajectory"]["n_covered"] >= 2285


@pytest.mark.parametrize("pipeline", ["without_pairwise", "with_neither"])
def test_without_it_the_reconstruction_fails(rows, pipeline: str) -> None:
    row = rows[pipeline]
    frames = row["before"]["frames"].values()
    assert sum(frames) / len(frames) == pytest.approx(20)
    assert row["failure"] or row["after"]["missing"]
