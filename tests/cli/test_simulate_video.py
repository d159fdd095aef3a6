"""`skytrace simulate --video`."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from skytrace.io.video import frame_times, open_video
from tests.cli.command import skytrace

SMALL = ("--video", "--video-size", "160x120", "--video-fps", 8, "--cameras", 2, "--duration", 6)


def test_writes_a_flight_of_videos_with_the_truth_of_every_frame(tmp_path: Path) -> None:
    folder = tmp_path / "flight"
    result = skytrace("simulate", "-o", folder, "--distractors", *SMALL)
    assert result.code == 0
    assert result.out.strip() == str(folder)
    assert "cam0" in result.err
    cameras = tomllib.loads((folder / "flight.toml").read_text())["camera"]
    assert [c["id"] for c in cameras] == ["cam0", "cam1"]
    for camera in cameras:
        assert set(camera) == {"id", "calibration", "video"}
        info = open_video(folder / camera["video"])
        assert info.size_px == (160, 120)
        assert info.nominal_rate_hz == pytest.approx(8, rel=1e-4)
        rows = np.genfromtxt(folder / "truth" / "frames" / f"{camera['id']}.csv", delimiter=",", names=True)
        np.testing.assert_allclose(rows["time_s"], frame_times(folder / camera["video"]), rtol=0, atol=1e-9)
        # Each camera films two thirds of the six seconds.
        assert rows["time_s"][-1] == pytest.approx(4, abs=0.5)
        assert rows["visible"].any()


def test_same_seed_same_videos(tmp_path: Path) -> None:
    videos = {}
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        assert skytrace("simulate", "-o", tmp_path / name, *SMALL, "--seed", seed).code == 0
        videos[name] = [p.read_bytes() for p in sorted((tmp_path / name / "video").iterdir())]
    assert videos["a"] == videos["b"] != videos["c"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--video-size", "160x120"), ("--video-size", "--video with it")),
        (("--distractors",), ("--distractors", "--video with it")),
        (("--video", "--video-size", "160"), ("--video-size", "WIDTHxHEIGHT", "'160'")),
        (("--video", "--video-size", "161x120"), ("--video-size", "even numbers")),
        (("--video", "--noise", 1), ("--noise", "detections")),
    ],
)
def test_options_that_do_not_fit(tmp_path: Path, options: tuple, words: tuple[str, ...]) -> None:
    result = skytrace("simulate", "-o", tmp_path / "flight", *options)
    assert result.code == 3
    assert all(word in result.err for word in words)
    assert not (tmp_path / "flight").exists()
