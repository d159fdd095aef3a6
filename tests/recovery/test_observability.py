"""What the data determine depends on the flight: a target that stays in a strip of rows says nothing of the readout."""

from __future__ import annotations

from dataclasses import replace

import pytest

from skytrace.pipeline.observability import BY_PRIOR, DETERMINED
from skytrace.pipeline.summary import summarise
from skytrace.simulation import presets

from .scenes import recover


@pytest.fixture(scope="module", params=[3.0, 25.0], ids=["narrow strip", "whole image"])
def summary(request):
    found = recover(replace(presets["demo"], altitude_m=request.param, duration_s=60.0), 1)
    return request.param < 10, summarise(found.outcome, found.prepared, {})


def test_the_readout_is_assumed_in_a_narrow_strip(summary) -> None:
    narrow, told = summary
    readouts = {c: rows["readout_s"]["determined"] for c, rows in told["observability"].items()}
    assert (set(readouts.values()) == {BY_PRIOR}) == narrow
    (sentence,) = [text for text in told["observability_words"] if text.startswith("Readout times")]
    assert (sentence.count("the target crossed only") == len(readouts)) == narrow


def test_what_has_no_prior_is_determined_by_the_data(summary) -> None:
    _, told = summary
    for camera_id, rows in told["observability"].items():
        offset = rows["offset_s"]
        if camera_id == told["reference"]:
            assert offset["determined"] == "fixed"
        else:
            assert (offset["determined"], offset["prior_sd"]) == (DETERMINED, None)
            assert 0 < offset["posterior_sd"] < 0.02
        assert rows["focal_scale"]["determined"] in (DETERMINED, "partly by the data")
    assert not any("clock offset is not determined" in text for text in told["warnings"])
