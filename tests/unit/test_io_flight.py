"""flight.toml: what it gives, and every mistake in it with its line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from skytrace.errors import InputError
from skytrace.io.flight import Flight, read_flight

LENS = {"K-matrix": [[900, 0, 640], [0, 900, 360], [0, 0, 1]], "distCoeff": [0, 0, 0, 0], "resolution": [1280, 720]}
HEAD = 'name = "field"\n\n'
A = """[[camera]]
id = "a"
calibration = "lens.json"
detections = "a.txt"
detections_columns = "x y frame"
"""
B = """
[[camera]]
id = "b"
calibration = "lens.json"
detections = "b.csv"
"""  # the line of b's header is 9, given HEAD and A
MOMENT = "[[simultaneous]]\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "lens.json").write_text(json.dumps(LENS | {"fps": 25}))
    (tmp_path / "silent.json").write_text(json.dumps(LENS))
    (tmp_path / "a.txt").write_text("10 20 3\n11 21 4\n12 22 6\n")
    (tmp_path / "b.csv").write_text("frame,x,y\n5,1,2\n6,3,4\n")
    (tmp_path / "stamped.csv").write_text("frame,x,y,time_s\n5,1,2,0.5\n6,3,4,0.54\n8,5,6,0.62\n")
    (tmp_path / "times.txt").write_text("3 0.1\n4 0.14\n5 0.17\n6 0.22\n")
    (tmp_path / "probe.txt").write_text("".join(f"{0.04 * k:.6f}\n" for k in range(8)))
    (tmp_path / "ms.txt").write_text("3 100\n4 140\n5 180\n6 220\n")
    (tmp_path / "ms.csv").write_text("frame,x,y,time_s\n5,1,2,500\n6,3,4,540\n8,5,6,620\n")
    (tmp_path / "rtk.txt").write_text("1 2 3\n4 5 6\n")
    (tmp_path / "pos.csv").write_text("camera,x,y,z\na,1,2,3\n")
    return tmp_path


def flight(folder: Path, text: str) -> Flight:
    (folder / "flight.toml").write_text(text)
    return read_flight(folder)


def refused(folder: Path, text: str) -> InputError:
    with pytest.raises(InputError) as caught:
        flight(folder, text)
    return caught.value


def test_a_flight(folder):
    got = flight(
        folder,
        f"{HEAD}{A}offset_s = 12\noffset_sigma_s = 0.5\nposition_m = [1, 2.5, 3]\nreadout_s = 0.02\n"
        f"{B}frame_rate_hz = 30\n[truth]\ntrajectory = 'rtk.txt'\nrate_hz = 5\npositions = 'pos.csv'\n",
    )
    assert got.name == "field"
    assert got.path == folder / "flight.toml"
    a, b = got.cameras
    assert (a.camera_id, a.frame_rate_hz, a.offset_s, a.offset_sigma_s, a.readout_s) == ("a", 25, 12, 0.5, 0.02)
    assert a.position_m is not None
    assert a.position_m.tolist() == [1, 2.5, 3]
    assert a.detections.frame.tolist() == [3, 4, 6]
    assert a.intrinsics.size_px == (1280, 720)
    assert (b.camera_id, b.frame_rate_hz, b.offset_s, b.position_m) == ("b", 30, None, None)
    assert b.detections.xy_px.tolist() == [[1, 2], [3, 4]]
    assert got.truth is not None
    assert (got.truth.trajectory, got.truth.rate_hz) == (folder / "rtk.txt", 5)
    assert (got.truth.positions, got.truth.synchronisation) == (folder / "pos.csv", None)
    assert [p.name for p in got.input_files] == ["flight.toml", "lens.json", "a.txt", "b.csv"]


def test_the_file_itself_may_be_named_and_needs_no_name_inside(folder, monkeypatch):
    (folder / "other.toml").write_text(A + B)
    assert read_flight(folder / "other.toml").name == folder.name
    monkeypatch.chdir(folder)
    assert read_flight("other.toml").name == folder.name


def test_time_stamps_are_attached_to_the_detections(folder):
    got = flight(folder, HEAD + A + 'timestamps = "times.txt"\n' + B)
    assert got.cameras[0].detections.time_s is not None
    assert got.cameras[0].detections.time_s.tolist() == [0.1, 0.14, 0.22]
    assert got.cameras[1].detections.time_s is None
    assert folder / "times.txt" in got.input_files


def test_frame_rate_from_time_stamps_where_nothing_else_tells(folder):
    text = HEAD + A + B.replace("b.csv", "stamped.csv").replace("lens", "silent")
    assert flight(folder, text).cameras[1].frame_rate_hz == pytest.approx(25)


def test_a_list_by_ffprobe_is_a_time_base(folder):
    (folder / "probe.txt").write_text("".join(f"{0.04 * k:.6f}\n" for k in range(8)))
    got = flight(folder, HEAD + A + 'timestamps = "probe.txt"\n' + B).cameras[0]
    assert got.detections.time_s is not None
    assert got.detections.time_s.tolist() == pytest.approx([0.12, 0.16, 0.24])
    assert got.camera_time_s(2.5) == pytest.approx(0.1)


def test_frames_become_times_of_the_cameras_own_clock(folder):
    text = HEAD + A + 'timestamps = "times.txt"\n' + B.replace("b.csv", "stamped.csv")
    (folder / "plain.csv").write_text("frame,x,y\n5,1,2\n6,3,4\n")
    a, b = flight(folder, text).cameras
    assert a.camera_time_s(4.5) == pytest.approx(0.155)  # between stamps
    assert a.camera_time_s(0) == pytest.approx(0.1 - 3 / 25)  # before the first
    assert a.camera_time_s(8) == pytest.approx(0.22 + 2 / 25)  # after the last
    assert b.camera_time_s(7) == pytest.approx(0.58)  # a column of the detections
    plain = flight(folder, HEAD + A + B.replace("b.csv", "plain.csv")).cameras[1]
    assert plain.camera_time_s(50) == pytest.approx(2.0)


def test_what_is_known_of_the_clocks(folder):
    text = (
        HEAD
        + A
        + "start_time = 2024-05-03T10:15:00Z\n"
        + B
        + "start_time = 2024-05-03T12:15:07.25+02:00\n"
        + "[[simultaneous]]\nframes = { a = 12, b = 30.5 }\n"
        + "[[simultaneous]]\nsigma_s = 0.01\n[simultaneous.frames]\na = 40\nb = 58\n"
    )
    got = flight(folder, text)
    a, b = (c.start_time for c in got.cameras)
    assert a is not None
    assert b is not None
    assert (b - a).total_seconds() == 7.25
    assert [(m.name, dict(m.frames), m.sigma_s) for m in got.simultaneous] == [
        ("[[simultaneous]] 1", {"a": 12, "b": 30.5}, None),
        ("[[simultaneous]] 2", {"a": 40, "b": 58}, 0.01),
    ]
    assert flight(folder, HEAD + A + B).simultaneous == ()


def test_time_stamps_that_contradict_the_frame_rate_are_believed_and_said(folder):
    """The calibration says 25, the file's frames are 50 a second."""
    (folder / "fast.csv").write_text("frame,x,y,time_s\n5,1,2,0.10\n6,3,4,0.12\n8,5,6,0.16\n")
    text = HEAD + A + B.replace("b.csv", "fast.csv")
    got = flight(folder, text)
    assert got.cameras[1].frame_rate_hz == pytest.approx(50)
    (warning,) = got.warnings
    assert "Camera b: its time stamps tell 50 frames a second, its calibration 25" in warning
    (warning,) = flight(folder, text + "frame_rate_hz = 24\n").warnings
    assert "frame_rate_hz 24" in warning
    near = flight(folder, text + "frame_rate_hz = 52\n")
    assert near.cameras[1].frame_rate_hz == 52
    assert near.warnings == ()


def test_frames_that_share_a_time_are_read(folder):
    (folder / "times.txt").write_text("3 0.1\n4 0.14\n5 0.14\n6 0.22\n")
    got = flight(folder, HEAD + A + 'timestamps = "times.txt"\n' + B)
    assert got.cameras[0].detections.time_s is not None
    (folder / "twice.csv").write_text("frame,x,y,time_s\n5,1,2,0.5\n6,3,4,0.5\n8,5,6,0.58\n")
    assert flight(folder, HEAD + A + B.replace("b.csv", "twice.csv")).cameras[1].camera_time_s(6) == 0.5


def test_calibration_chosen_from_one_file(folder):
    (folder / "rig.toml").write_text(
        "\n".join(
            f'[cam_{k}]\nname = "{name}"\nsize = [1280, 720]\nmatrix = [[{f}, 0, 640], [0, {f}, 360], [0, 0, 1]]\n'
            "distortions = [0, 0, 0, 0]"
            for k, (name, f) in enumerate([("b", 800), ("c", 700)])
        )
    )
    text = (HEAD + A + B).replace("lens.json", "rig.toml#c", 1).replace("lens.json", "rig.toml")
    got = flight(folder, text.replace("detections =", "frame_rate_hz = 30\ndetections ="))
    assert [c.intrinsics.focal_px[0] for c in got.cameras] == [700, 800]
    assert [p.name for p in got.input_files].count("rig.toml") == 1


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        (HEAD, None, "at least two [[camera]] tables, got 0"),
        (HEAD + A, 3, "at least two [[camera]] tables, got 1"),
        (HEAD + A + B.replace('"b"', '"a"'), 10, "id 'a' already belongs to camera 1"),
        (HEAD + A + B.replace('"b"', '""'), 10, "expected an id"),
        (HEAD + A + B.replace('"b"', '"b,c"'), 10, "expected an id without commas"),
        (HEAD + A + B.replace("id =", "# id ="), 9, "camera 2: the key 'id' is missing"),
        (HEAD + A + B.replace("calibration =", "# calibration ="), 9, "camera 2: the key 'calibration' is missing"),
        (HEAD + A + B.replace("detections =", "# detections ="), 9, "detections: missing"),
        (HEAD + A + B + 'video = "b.mp4"\n', 13, "either video or detections, not both"),
        (HEAD + A + B + "frame_rate = 30\n", 13, "unknown key 'frame_rate' (did you mean 'frame_rate_hz'?)"),
        ("nam = 'x'\n" + A + B, 1, "unknown key 'nam' (did you mean 'name'?)"),
        (HEAD + A + B + "[truht]\ntrajectory = 'rtk.txt'\n", 13, "unknown key 'truht' (did you mean 'truth'?)"),
        (HEAD + A + B + "[truth]\nrate_hz = 5\n", 13, "[truth]: the key 'trajectory' is missing"),
        (HEAD + A + B + "[truth]\ntrajectory = 'rtk.txt'\nrate = 5\n", 15, "[truth]: unknown key 'rate'"),
        (HEAD + A + B + "[truth]\ntrajectory = 'none.txt'\n", 14, "[truth]: trajectory: no such file"),
        (HEAD + A + B + "[truth]\ntrajectory = 'rtk.txt'\npositions = 'p.csv'\n", 15, "positions: no such file"),
        (HEAD + A + B + "[truth]\ntrajectory = 'rtk.txt'\nrate_hz = 0\n", 15, "rate_hz: expected a positive number"),
        (HEAD + A + B + "[[truth]]\ntrajectory = 'rtk.txt'\n", 13, "expected"),
        ("truth = 3\n" + A + B, 1, "[truth]"),
        (HEAD + A + B.replace('"b"', "7"), 10, "camera 2: id: expected a string, got a number"),
        (HEAD + A + B + "offset_s = '3'\n", 13, "camera 2: offset_s: expected a number, got a string"),
        (HEAD + A + B + "offset_s = true\n", 13, "offset_s: expected a number, got true or false"),
        (HEAD + A + B + "position_m = [1, 2]\n", 13, "position_m: expected `array` of length 3, got 2"),
        (HEAD + A + B + "position_m = [1, 2, 'x']\n", 13, "position_m: expected a number, got a string"),
        (HEAD + A + B + "position_m = [1, 2, nan]\n", 13, "position_m: expected finite numbers"),
        (HEAD + A + B + "position_wgs84 = [147.1, 8, 400]\n", 13, "expected latitude"),
        (HEAD + A + "position_m = [1, 2, 3]\n" + B + "position_wgs84 = [47, 8, 400]\n", 14, "every position as"),
        (HEAD + A + B + "offset_s = inf\n", 13, "expected a finite number"),
        (HEAD + A + B + "offset_sigma_s = 1\n", 13, "given without offset_s"),
        (HEAD + A + B + "offset_s = 1\noffset_sigma_s = 0\n", 14, "expected a positive number"),
        (HEAD + A + B + "frame_rate_hz = 0\n", 13, "expected a positive number"),
        (HEAD + A + B + "readout_s = -0.01\n", 13, "expected 0 or more"),
        (HEAD + A + B + "readout_s = 0.05\n", 13, "longer than a frame"),
        (HEAD + A + B + "detections_columns = 'x y'\n", 13, "no column 'frame'"),
        (HEAD + A + B.replace("lens", "silent"), 9, "no frame rate"),
        (HEAD + A + B.replace("lens.json", "none.json"), 11, "calibration: no such file"),
        (HEAD + A + B.replace("b.csv", "none.csv"), 12, "detections: no such file"),
        (HEAD + A + B.replace("b.csv", ""), 12, "expected a path, got nothing"),
        (HEAD + A + B.replace("b.csv", "."), 12, "detections: no such file"),
        (HEAD + A + B + "timestamps = 'none.txt'\n", 13, "timestamps: no such file"),
        (HEAD + A + B.replace("b.csv", "stamped.csv") + "timestamps = 'times.txt'\n", 13, "one or the other"),
        (HEAD + A + B + "start_time = 2024-05-03\n", 13, "start_time: expected a date and time such as"),
        (HEAD + A + B + "start_time = 10:15:00\n", 13, "got only a time of day"),
        (HEAD + A + B + "start_time = 'noon'\n", 13, "start_time: expected a date and time such as"),
        (HEAD + A + B + "start_time = 12\n", 13, "got a number"),
        (
            HEAD + A + "start_time = 2024-05-03T10:15:00\n" + B + "start_time = 2024-05-03T10:15:00Z\n",
            8,
            "camera 'a': start_time: give every one with its time zone",
        ),
        (HEAD + A + B + MOMENT + "frames = { a = 1, b = '2' }\n", 14, "frames: expected a number, got a string"),
        (HEAD + A + B + MOMENT + "frames = [1, 2]\n", 14, "frames: expected a table, got a list"),
        (HEAD + A + B + MOMENT + "frames = { a = 1 }\n", 14, "frames of at least two cameras, got 1"),
        (HEAD + A + B + MOMENT + "frames = { a = 1, bb = 2 }\n", 14, "unknown camera 'bb' (did you mean 'b'?)"),
        (HEAD + A + B + MOMENT + "frames = { a = 1, b = -2 }\n", 14, "b: expected a frame number from 0, got -2"),
        (HEAD + A + B + MOMENT + "frames = { a = 1, b = nan }\n", 14, "b: expected a frame number"),
        (HEAD + A + B + MOMENT + "frames = { a = 1, b = 2 }\nsigma_s = 0\n", 15, "sigma_s: expected a positive"),
        (HEAD + A + B + MOMENT + "sigma_s = 1\n", 13, "[[simultaneous]] 1: the key 'frames' is missing"),
        (HEAD + A + B + MOMENT + "frame = { a = 1, b = 2 }\n", 14, "unknown key 'frame' (did you mean 'frames'?)"),
        (HEAD + A + B + "[simultaneous]\nframes = { a = 1, b = 2 }\n", 13, "[[simultaneous]] tables (double brackets)"),
        (
            HEAD + A + "timestamps = 'probe.txt'\n" + B + MOMENT + "frames = { a = 9, b = 2 }\n",
            15,
            "beyond the last one",
        ),
        (HEAD + A + "timestamps = 'ms.txt'\n" + B, 8, "ms.txt: its time stamps tell 0.025 frames a second where 25"),
        (HEAD + A + B.replace("b.csv", "ms.csv").replace("lens", "silent"), 12, "look like milliseconds"),
        (HEAD + A.replace("[[camera]]", "[camera]"), 3, "double brackets"),
        (HEAD + A + A.replace("id =", "id"), 9, "not valid TOML"),
        (HEAD + A + 'id = "c"\n' + B, 8, "not valid TOML"),
        (HEAD + A + B + 'name = "x', 13, "not valid TOML"),
    ],
)
def test_mistakes_in_the_file(folder, text, line, words):
    error = refused(folder, text)
    assert error.path == str(folder / "flight.toml")
    assert words in error.message
    assert error.line == line


def test_no_flight_there(tmp_path):
    with pytest.raises(InputError, match="no such flight"):
        read_flight(tmp_path / "none")
    with pytest.raises(InputError, match=r"flight.toml: flight description does not exist"):
        read_flight(tmp_path)


def test_mistakes_in_other_files_name_those(folder):
    error = refused(folder, HEAD + A.replace('detections_columns = "x y frame"\n', "") + B)
    assert (error.path, error.line) == (str(folder / "a.txt"), 1)
    (folder / "times.txt").write_text("3 0.1\n4 0.14\n6 0.13\n")
    error = refused(folder, HEAD + A + 'timestamps = "times.txt"\n' + B)
    assert (error.path, error.line) == (str(folder / "times.txt"), 3)
    (folder / "times.txt").write_text("3 0.1\n4 0.14\n5 0.17\n")
    error = refused(folder, HEAD + A + 'timestamps = "times.txt"\n' + B)
    assert (error.path, error.line) == (str(folder / "a.txt"), 3)
    assert "frame 6 has no time stamp" in error.message
    (folder / "times.txt").write_text("0.00\n0.04\n0.08\n0.12\n0.16\n0.20\n")
    error = refused(folder, HEAD + A + 'timestamps = "times.txt"\n' + B)
    assert (error.path, error.line) == (str(folder / "a.txt"), 3)
    assert "frames count from 0 in the video that was listed" in error.message


def test_what_is_read_cannot_be_changed(folder):
    camera = flight(folder, HEAD + A + "position_m = [1, 2, 3]\n" + B).cameras[0]
    for array in (camera.position_m, camera.detections.x, camera.detections.frame, camera.intrinsics.focal_px):
        assert isinstance(array, np.ndarray)
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
