"""The synchronisation benchmark: rough offsets from known frames, errors of clocks, and failures that show."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from skytrace.benchmark import synchronisation_table as table
from skytrace.benchmark.known_offsets import KnownOffsets, OffsetErrors, camera_clock
from skytrace.benchmark.synchronisation import PIPELINES, SHIFTS, Measurement, TrajectoryError, count
from skytrace.io.run_folder import json_text
from skytrace.model.camera import Clock, Intrinsics
from skytrace.model.track import Recording, Track

RATES_HZ = {"a": 25.0, "b": 50.0, "c": 30.0, "d": 60.0}
# Frame of the camera = slope * frame of b + intercept.
KNOWN = {"b": (1.0, 0.0), "a": (0.5, 40.0), "c": (0.6, -100.0), "d": (1.2, 7.0)}
READOUT = 0.6


def recording(camera_id: str, rate_hz: float) -> Recording:
    lens = Intrinsics(np.array([1000.0, 1000.0]), np.array([500.0, 300.0]), np.zeros(5), (1000, 600))
    frame = np.arange(100, 2000)
    return Recording(camera_id, lens, rate_hz, (Track(frame, np.full((len(frame), 2), 300.0)),))


RECORDINGS = [recording(c, hz) for c, hz in RATES_HZ.items()]


@pytest.fixture
def known() -> KnownOffsets:
    return KnownOffsets.of(RECORDINGS, KNOWN, READOUT)


def clocks(offsets_s: dict[str, float]) -> dict[str, Clock]:
    return {r.camera_id: camera_clock(r, offsets_s[r.camera_id], 1.0, READOUT) for r in RECORDINGS}


def test_the_reference_is_the_camera_whose_frames_the_others_are_given_in(known: KnownOffsets) -> None:
    assert known.reference == "b"
    assert known.rate_hz == pytest.approx(50.0)
    assert known.seen["a"] == pytest.approx((120.0, 3918.0))


def test_without_a_shift_rough_offsets_are_right(known: KnownOffsets) -> None:
    errors = known.errors(clocks(known.rough_offsets_s(0.0)))
    assert errors.base == errors.reference == "b"
    assert errors.missing == ()
    assert list(errors.frames) == ["a", "c", "d"]
    assert max(errors.frames.values()) < 1e-9


def test_known_frames_are_exposed_together_by_right_offsets(known: KnownOffsets) -> None:
    found = clocks(known.rough_offsets_s(0.0))
    middle = 0.5 * (max(known.seen["a"][0], 100) + min(known.seen["a"][1], 1999))
    at = {c: found[c].world_time(np.array(KNOWN[c][0] * middle + KNOWN[c][1]), np.array(300.0)) for c in "ab"}
    assert at["a"] == pytest.approx(at["b"], abs=1e-12)


@pytest.mark.parametrize("shift", [5.0, 3000.0])
def test_a_shift_is_the_mean_error_and_no_two_cameras_share_it(known: KnownOffsets, shift: float) -> None:
    right_s, rough_s = known.rough_offsets_s(0.0), known.rough_offsets_s(shift)
    errors = known.errors(clocks(rough_s))
    assert errors.mean_frames == pytest.approx(shift, rel=1e-9)
    off = np.array([(rough_s[c] - right_s[c]) * known.rate_hz for c in "abcd"])
    apart = np.abs(off[:, None] - off)[np.triu_indices(4, 1)]
    assert apart.min() >= 0.5 * shift - 1e-9
    assert known.rough_offsets_s(shift) == rough_s


def test_a_wrong_rate_does_not_count_in_the_middle(known: KnownOffsets) -> None:
    found = clocks(known.rough_offsets_s(0.0))
    begin, end = max(known.seen["c"][0], 100), min(known.seen["c"][1], 1999)
    for at, error_frames in ((0.5 * (begin + end), 0.0), (begin, 1e-3 * 0.5 * (end - begin))):
        fixed_s = float(found["b"].world_time(np.array(at), np.array(300.0)))
        turned = camera_clock(RECORDINGS[2], fixed_s + 1.001 * (found["c"].offset_s - fixed_s), 1.001, READOUT)
        assert known.errors({**found, "c": turned}).frames["c"] == pytest.approx(error_frames, abs=1e-6)


def test_cameras_without_a_clock_are_missing(known: KnownOffsets) -> None:
    found = clocks(known.rough_offsets_s(0.0))
    del found["c"]
    assert known.errors(found).missing == ("c",)
    del found["b"]
    offset_s = found["d"].offset_s + 0.1
    errors = known.errors({**found, "d": replace(found["d"], offset_s=offset_s)})
    assert (errors.base, errors.missing) == ("a", ("b", "c"))
    assert errors.frames == {"d": pytest.approx(0.1 * 50.0)}  # in frames of the reference all the same


ERRORS = OffsetErrors("b", "b", {"a": 0.25, "c": 0.75, "d": 0.5}, ())
GOOD = Measurement("full", 5.0, ERRORS, ERRORS, TrajectoryError(6.04, 2359, 5, 3305), "", 12.9)


def test_a_measurement_in_words() -> None:
    assert table.cells(GOOD) == (PIPELINES["full"], "5", "0.50", "0.50", "6.0", "2359 of 3305", "5", "13")
    blind = replace(GOOD, pipeline="blind", shift_frames=None)
    assert table.cells(blind)[1] == "any"


def test_every_failure_shows() -> None:
    no_pair = Measurement("full", 500.0, None, None, None, "synchronise: nothing fits", 1.0)
    assert table.cells(no_pair)[2:5] == ("fails", "fails", "fails")
    no_start = replace(no_pair, before=ERRORS, failure="initialise: nothing to start from")
    assert table.cells(no_start)[2:5] == ("0.50", "fails", "fails")
    no_path = replace(no_start, after=ERRORS, failure="evaluate: by chance")
    assert table.cells(no_path)[3:5] == ("0.50", "fails")
    some = replace(GOOD, after=OffsetErrors("b", "a", {"d": 0.5}, ("b", "c")))
    assert table.cells(some)[3:5] == ("0.50 (2 fail)", "6.0 (2 cameras)")
    words = (
        "fails: synchronise: nothing fits",
        "fails: initialise: nothing to start from",
        "fails: evaluate: by chance",
    )
    expected = (*words, "after fails for b, c, the error is relative to a")
    for row, why in zip((no_pair, no_start, no_path, some), expected, strict=True):
        assert table.failures(row) == why
        assert why in table.as_text([row])
        assert why in table.as_markdown([row])
    assert table.failures(GOOD) == ""


def test_the_table_says_where_truth_enters() -> None:
    for text in (table.as_text([GOOD]), table.as_markdown([GOOD])):
        assert "truth enter" in text
        assert PIPELINES["full"] in text
    rows = [line for line in table.as_markdown([GOOD, GOOD]).splitlines() if line.startswith("|")]
    assert {line.count("|") for line in rows} == {len(table.HEADER) + 2}


def test_values_for_json_hold_every_figure() -> None:
    document = json.loads(json_text(table.as_document([GOOD])))
    (row,) = document["rows"]
    assert row["before"]["frames"] == {"a": 0.25, "c": 0.75, "d": 0.5}
    assert row["trajectory"]["n_covered"] == 2359
    assert row["failure"] == ""


def test_the_blind_pipeline_is_measured_once() -> None:
    assert count(SHIFTS) == 3 * len(SHIFTS) + 1
