"""From what a flight.toml says of the clocks to hints in the cameras' own times."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from skytrace.io.flight import read_flight
from skytrace.pipeline.flight_hints import flight_hints

LENS = {"K-matrix": [[900, 0, 640], [0, 900, 360], [0, 0, 1]], "distCoeff": [0, 0, 0, 0], "resolution": [1280, 720]}


def flight(folder: Path, end: str = "", **cameras: str):
    (folder / "lens.json").write_text(json.dumps(LENS))
    text = ""
    for camera_id, lines in cameras.items():
        (folder / f"{camera_id}.csv").write_text("frame,x,y\n10,1,2\n11,3,4\n")
        text += f'[[camera]]\nid = "{camera_id}"\ncalibration = "lens.json"\ndetections = "{camera_id}.csv"\n{lines}\n'
    (folder / "flight.toml").write_text(text + end)
    return flight_hints(read_flight(folder))


def test_nothing_said_is_no_hint(tmp_path):
    assert not flight(tmp_path, a="frame_rate_hz = 25", b="frame_rate_hz = 25")


def test_offsets_with_their_deviations(tmp_path):
    hints = flight(
        tmp_path, a="frame_rate_hz = 25\noffset_s = 3\noffset_sigma_s = 0.1", b="frame_rate_hz = 25\noffset_s = -1"
    )
    assert [(h.camera_id, h.offset_s, h.sigma_s, h.source) for h in hints.offsets] == [
        ("a", 3.0, 0.1, "offset_s"),
        ("b", -1.0, 0.5, "offset_s"),
    ]


def test_frames_go_by_time_stamps_where_there_are_any(tmp_path):
    (tmp_path / "a.txt").write_text("".join(f"{100 + 0.05 * k:.3f}\n" for k in range(40)))
    hints = flight(
        tmp_path,
        "[[simultaneous]]\nframes = { a = 10, b = 30.5 }\n",
        a='timestamps = "a.txt"\nstart_time = 2024-05-03T10:00:04Z',
        b="frame_rate_hz = 50\nstart_time = 2024-05-03T10:00:00Z",
    )
    (moment,) = hints.simultaneous
    assert dict(moment.camera_time_s) == pytest.approx({"a": 100.5, "b": 0.61})
    assert moment.sigma_s == pytest.approx(0.5 * 0.05)  # half a frame of the slower camera
    # a's clock showed 100 at its first frame, 4 s after b began.
    assert {h.camera_id: h.offset_s for h in hints.offsets} == pytest.approx({"a": -96.0, "b": 0.0})
    assert {h.source for h in hints.offsets} == {"start_time"}
