"""Cameras of a FLIGHT that name videos."""

from __future__ import annotations

import json
from datetime import UTC, datetime

import numpy as np
import pytest
from tests.unit.video_files import ramp, write_video

from skytrace.errors import InputError
from skytrace.io.flight import read_flight, read_videos
from skytrace.io.tracks import TrackRows, tracks_text

HEAD = '[[camera]]\nid = "a"\ncalibration = "a.json"\nvideo = "a.mp4"\n'
OTHER = '[[camera]]\nid = "b"\ncalibration = "a.json"\ndetections = "b.txt"\n'


def lens(size_px=(64, 48), fps=25.0):
    matrix = [[60.0, 0, 32], [0, 60, 24], [0, 0, 1]]
    return json.dumps({"K-matrix": matrix, "distCoeff": [0.0] * 5, "fps": fps, "resolution": size_px})


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "a.json").write_text(lens())
    metadata = {"creation_time": "2024-05-03T10:15:00Z"}
    write_video(tmp_path / "a.mp4", ramp(6), metadata=metadata)
    (tmp_path / "b.txt").write_text("frame x y\n" + "".join(f"{k} {k}.5 7\n" for k in range(20)))
    (tmp_path / "flight.toml").write_text(HEAD + OTHER)
    return tmp_path


def tracks(folder, n=5, **about):
    """TRACKS of the video: one track taken as the target, another not."""
    frame = np.repeat(np.arange(n), 2)
    is_target = np.tile([1, 0], n)
    rows = TrackRows(
        frame, 10 + 0.04 * frame, np.tile([5.0, 6.0], (2 * n, 1)), np.full(2 * n, 0.2), is_target, is_target
    )
    about = {"video": "a.mp4", "warnings": [], "tracks": [{}] * (n > 0), **about}
    path = folder / "tracks.csv"
    path.write_text(tracks_text(rows, about))
    return {"a": path}


def test_videos_are_told(folder):
    assert read_videos(folder) == {"a": folder / "a.mp4"}
    assert read_videos(folder / "flight.toml") == {"a": folder / "a.mp4"}


def test_target_of_the_tracks(folder):
    given = tracks(folder)
    flight = read_flight(folder, given)
    a, b = flight.cameras
    assert a.video == folder / "a.mp4"
    assert b.video is None
    assert a.detections.frame.tolist() == [0, 1, 2, 3, 4]
    assert a.detections.sigma_px.tolist() == [0.2] * 5
    np.testing.assert_allclose(a.detections.time_s, 10 + 0.04 * np.arange(5))
    assert a.timestamps is not None
    assert set(flight.input_files) >= {folder / "a.mp4", given["a"]}
    assert flight.warnings == ()


def test_warnings_of_the_video_are_the_flights(folder):
    (warning,) = read_flight(folder, tracks(folder, warnings=["cut off after 3.2 s"])).warnings
    assert warning == "Camera a: a.mp4: cut off after 3.2 s"


def test_without_tracks_a_camera_saw_nothing(folder):
    for given in (None, tracks(folder, n=0)):
        a = read_flight(folder, given).cameras[0]
        assert len(a.detections) == 0
        assert a.frame_rate_hz == 25.0


def test_a_file_of_time_stamps_overrules_the_container(folder):
    (folder / "times.txt").write_text("frame time_s\n" + "".join(f"{k} {k / 20}\n" for k in range(6)))
    (folder / "flight.toml").write_text(HEAD + 'timestamps = "times.txt"\n' + OTHER)
    a = read_flight(folder, tracks(folder)).cameras[0]
    np.testing.assert_allclose(a.detections.time_s, np.arange(5) / 20)


class TestStartTime:
    def test_of_the_container(self, folder):
        a, b = read_flight(folder, tracks(folder)).cameras
        assert a.start_time == datetime(2024, 5, 3, 10, 15, tzinfo=UTC)
        assert b.start_time is None

    def test_given_ones_count(self, folder):
        (folder / "flight.toml").write_text(HEAD + "start_time = 2024-05-03T10:16:00Z\n" + OTHER)
        assert read_flight(folder, tracks(folder)).cameras[0].start_time == datetime(2024, 5, 3, 10, 16, tzinfo=UTC)

    def test_cannot_be_compared_with_times_without_zone(self, folder):
        (folder / "flight.toml").write_text(HEAD + OTHER + "start_time = 2024-05-03T10:16:00\n")
        a, b = read_flight(folder, tracks(folder)).cameras
        assert a.start_time is None
        assert b.start_time == datetime(2024, 5, 3, 10, 16)


@pytest.mark.parametrize("read", [read_videos, read_flight])
class TestRefused:
    def fails(self, read, folder, words, line):
        with pytest.raises(InputError, match=words) as raised:
            read(folder)
        assert raised.value.line == line

    def test_size_of_another_lens(self, folder, read):
        (folder / "a.json").write_text(lens((48, 64)))
        words = r"camera 'a': calibration: is for pictures of 48 x 64 px, the video's are 64 x 48"
        self.fails(read, folder, words, 3)

    def test_no_such_video(self, folder, read):
        (folder / "a.mp4").unlink()
        self.fails(read, folder, "camera 'a': video: no such file", 4)

    def test_no_video(self, folder, read):
        (folder / "a.mp4").write_text("text")
        self.fails(read, folder, "is not a video", None)

    def test_both(self, folder, read):
        (folder / "flight.toml").write_text(HEAD + 'detections = "b.txt"\n' + OTHER)
        self.fails(read, folder, "either video or detections, not both", 4)

    def test_columns_of_no_file(self, folder, read):
        (folder / "flight.toml").write_text(HEAD + 'detections_columns = "x y frame"\n' + OTHER)
        self.fails(read, folder, "detections_columns: is for detections in a file", 5)
