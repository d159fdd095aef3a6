"""Errors say where, what, from which counts and what may help, and carry their exit code."""

from __future__ import annotations

from pathlib import Path

import pytest

from skytrace.errors import InputError, ReconstructionError, SkytraceError


def test_input_error_names_file_and_line():
    error = InputError(Path("a") / "cam0.txt", "expected three columns", line=17)
    assert str(error) == f"{Path('a') / 'cam0.txt'}:17: expected three columns"
    assert (error.path, error.line, error.message) == (str(Path("a") / "cam0.txt"), 17, "expected three columns")
    assert str(InputError("flight.toml", "missing")) == "flight.toml: missing"
    assert InputError("flight.toml", "missing").line is None


def test_reconstruction_error_tells_the_whole_story():
    error = ReconstructionError(
        "register",
        "too few inliers",
        camera="cam3",
        counts={"inliers": 7, "correspondences": 812.0},
        threshold=12,
        hint="Check its calibration",
    )
    assert str(error) == (
        "register: too few inliers (camera cam3) [inliers 7, correspondences 812] (needed: 12). Check its calibration"
    )
    assert error.counts == {"inliers": 7, "correspondences": 812.0}
    assert (error.stage, error.camera, error.threshold) == ("register", "cam3", 12)


def test_reconstruction_error_leaves_out_what_it_was_not_told():
    error = ReconstructionError("cover", "nothing is covered")
    assert str(error) == "cover: nothing is covered"
    assert (error.counts, error.camera, error.threshold, error.hint) == ({}, None, None, "")


def test_counts_are_copied():
    counts = {"pairs": 1.0}
    error = ReconstructionError("synchronise", "no pair", counts=counts)
    counts["pairs"] = 2.0
    assert error.counts == {"pairs": 1.0}


@pytest.mark.parametrize(
    ("error", "code"), [(InputError("f", "m"), 3), (ReconstructionError("s", "r"), 4), (SkytraceError("x"), 1)]
)
def test_exit_codes(error, code):
    assert isinstance(error, SkytraceError)
    assert error.exit_code == code
