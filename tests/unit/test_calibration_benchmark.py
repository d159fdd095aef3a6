"""The calibration benchmark's tables, and OpenCV's plain calibration beside."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from board_scene import PINHOLE, Board, half_size, render, shots

from skytrace.benchmark import calibration_table as tables
from skytrace.benchmark.calibration import (
    SETS,
    FlightMeasurement,
    LensMeasurement,
    PlainCalibration,
    count,
    plain_calibration,
)
from skytrace.datasets import DATASETS
from skytrace.io.run_folder import json_text

PLAIN = PlainCalibration(12, 0.515, 1540.04)
ROWS = [
    LensMeasurement("phone", 1920, 28, 27, "pinhole", 0.163, 1571.66, 1583.2, 0.0017, 0.0027, PLAIN, 9.6),
    LensMeasurement("action", 1920, 36, 34, "fisheye", 0.108, 871.84, 889.7, 0.0018, None, None, 14.2),
    FlightMeasurement("published", "refined", 6.24, 4.73, 2378, 18.0),
    FlightMeasurement("own", "fixed", None, None, 0, 3.0, "grow: no camera fits"),
]


def test_the_sets_are_those_of_the_recording() -> None:
    assert tuple(SETS) == DATASETS["dataset3"].devices
    assert count() == 12


def test_text() -> None:
    text = tables.as_text(ROWS)
    lines = text.splitlines()
    phone = next(line.split() for line in lines if line.startswith("phone"))
    assert phone[1:4] == ["27", "of", "28"]
    assert phone[4:9] == ["pinhole", "0.16", "1571.7", "0.17", "0.27"]
    assert phone[9:] == ["1583.2", "12", "used,", "0.52", "px,", "1540.0", "10"]
    assert any("action" in line and "fails" in line for line in lines)
    assert any(line.split() == ["published", "refined", "6.2", "4.7", "2378", "18"] for line in lines)
    assert any(line.split() == ["own", "fixed", "fails", "3"] for line in lines)


def test_markdown_and_values() -> None:
    markdown = tables.as_markdown(ROWS)
    assert "| phone | 27 of 28 | pinhole |" in markdown
    assert markdown.count("| --- |") >= 2
    document = json.loads(json_text(tables.as_document(ROWS)))
    assert [row["device"] for row in document["lenses"]] == ["phone", "action"]
    assert document["lenses"][0]["plain"]["focal_px"] == 1540.04
    assert document["flights"][1]["failure"] == "grow: no camera fits"


def test_opencv_calibrates_boards_at_rest(tmp_path: Path) -> None:
    rng, lens, board = np.random.default_rng(2), half_size(PINHOLE), Board()
    files = []
    for k, shot in enumerate(shots(lens, 6, rng, reach=0.3)):
        files.append(tmp_path / f"{k}.png")
        cv2.imwrite(str(files[-1]), render(lens, board, shot, rng, over=2))
    plain = plain_calibration(files)
    assert plain is not None
    assert 3 <= plain.used <= 6
    assert plain.rms_px < 0.3
    assert plain.focal_px == pytest.approx(440, rel=0.05)
    assert plain_calibration(files[:2]) is None
