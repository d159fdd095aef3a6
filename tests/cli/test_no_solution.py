"""Flights that determine nothing: exit code 4, the stage, the counts and a hint; no folder."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from .command import skytrace


@pytest.mark.parametrize(
    ("preset", "words", "hint"),
    [
        ("hover", "hardly moves", "Fly the target"),
        ("straight", "straight line", "Record a flight with turns"),
        ("coincident", "same direction", "Move the cameras apart"),
        ("short_overlap", "no two cameras can be tied together", "common view"),
    ],
)
def test_a_degenerate_flight_is_named(preset: str, words: str, hint: str, tmp_path: Path) -> None:
    assert skytrace("simulate", "-o", tmp_path / "flight", "--preset", preset).code == 0
    result = skytrace("reconstruct", tmp_path / "flight", "-o", tmp_path / "run", "--json")
    assert (result.code, result.out) == (4, "")
    stage = result.message.split(": ")[1]
    assert stage in ("synchronise", "initialise")
    assert words in result.message
    assert hint in result.message
    assert re.search(r"\[\w.* \d[^]]*\]", result.message)
    # Where it ended stands above the message.
    assert result.err.splitlines()[-2].split()[0] == stage
    assert [path.name for path in tmp_path.iterdir()] == ["flight"]
