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


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "lens.json").write_text(json.dumps(LENS | {"fps": 25}))
    (tmp_path / "silent.json").write_text(json.dumps(LENS))
    (tmp_path / "a.txt").write_text("10 20 3\n11 21 4\n12 22 6\n")
    (tmp_path / "b.csv").write_text("frame,x,y\n5,1,2\n6,3,4\n")
    (tmp_path / "stamped.csv").write_text("frame,x,y,time_s\n5,1,2,0.5\n6,3,4,0.54\n8,5,6,0.62\n")
    (tmp_path / "times.txt").write_text("3 0.1\n4 0.14\n5 0.17\n6 0.22\n")
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
        (HEAD + A + B.replace("detections", "video"), 12, "run a detector on it first"),
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
    (folder / "times.txt").write_text("3 0.1\n4 0.14\n6 0.14\n")
    error = refused(folder, HEAD + A + 'timestamps = "times.txt"\n' + B)
    assert (error.path, error.line) == (str(folder / "times.txt"), 3)
    (folder / "times.txt").write_text("3 0.1\n4 0.14\n5 0.17\n")
    error = refused(folder, HEAD + A + 'timestamps = "times.txt"\n' + B)
    assert (error.path, error.line) == (str(folder / "a.txt"), 3)
    assert "frame 6 has no time stamp" in error.message


def test_what_is_read_cannot_be_changed(folder):
    camera = flight(folder, HEAD + A + "position_m = [1, 2, 3]\n" + B).cameras[0]
    for array in (camera.position_m, camera.detections.x, camera.detections.frame, camera.intrinsics.focal_px):
        assert isinstance(array, np.ndarray)
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
