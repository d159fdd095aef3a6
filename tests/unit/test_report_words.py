"""Numbers read well, and the summary says what the reconstruction holds."""

from __future__ import annotations

import math

import pytest
from report_scene import make_reconstruction

from skytrace.model.reconstruction import Reconstruction
from skytrace.model.trajectory import Trajectory
from skytrace.report import words


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.57812, 2, "0.58"),
        (-12.3456, 4, "−12.35"),
        (1234567.0, 3, "1,234,567"),
        (0.00012345, 2, "0.00012"),
        (3.2e-9, 2, "3.2e−09"),
        (0.0, 3, "0"),
        (math.nan, 3, "unknown"),
        (math.inf, 3, "unknown"),
    ],
)
def test_number(value, digits, text):
    assert words.number(value, digits) == text


@pytest.mark.parametrize(
    ("value", "deviation", "text"),
    [
        (-15.134012, 0.00213, "−15.1340 ± 0.0021"),
        (33.36671, 0.0000254, "33.366710 ± 0.000025"),
        (1234.5, 87.2, "1,234 ± 87"),
        (-0.001, 0.15, "0.00 ± 0.15"),
        (2.0, 0.0, "2.000000 (fixed)"),
        (2.0, math.nan, "2.00000"),
    ],
)
def test_deviation_decides_the_digits_shown(value, deviation, text):
    assert words.with_deviation(value, deviation) == text


@pytest.mark.parametrize(("value", "text"), [(8.34, "8.3 s"), (59.99, "60.0 s"), (125.4, "2 min 5 s"), (600, "10 min")])
def test_seconds(value, text):
    assert words.seconds(value).replace(words.NO_BREAK, " ") == text


def test_listing():
    assert [words.listing(list("abc"[:n])) for n in range(4)] == ["", "a", "a and b", "a, b and c"]


def test_summary_names_the_cameras_left_out_and_counts_the_segments():
    reconstruction = make_reconstruction(n_segments=3, unregistered={"cam7": "no overlap", "cam8": "too short"})
    text = " ".join(words.summary_sentences(reconstruction, 6)).replace(words.NO_BREAK, " ")
    assert "4 of 6 cameras" in text
    assert "without cam7 and cam8" in text
    assert "27.0 s in 3 segments spread over 29.0 s" in text
    assert f"within {words.number(words.pooled_median_px(reconstruction), 2)} px" in text


def test_summary_of_a_complete_gapless_flight():
    text = " ".join(words.summary_sentences(make_reconstruction(n_segments=1), 4)).replace(words.NO_BREAK, " ")
    assert "All 4 cameras" in text
    assert "29.0 s without a gap" in text


def test_summary_of_nothing_covered():
    whole = make_reconstruction()
    nothing = Reconstruction("cam0", whole.cameras, Trajectory(()))
    assert "No stretch of the flight is covered." in words.summary_sentences(nothing, 4)


def test_unit_and_frame_follow_the_gauge():
    arbitrary, metric = make_reconstruction(), make_reconstruction(gauge="metric")
    assert (words.unit_of(arbitrary), words.unit_of(metric)) == ("units", "m")
    assert "arbitrary unit" in words.frame_sentences(arbitrary)[0]
    assert "x to its right, y down and z forward" in words.frame_sentences(arbitrary)[0]
    assert "in metres" in words.frame_sentences(metric)[0]
