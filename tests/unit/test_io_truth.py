"""Time stamps and the files evaluation judges by."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.errors import InputError
from skytrace.io.timestamps import read_timestamps
from skytrace.io.truth import (
    read_true_orientations,
    read_true_positions,
    read_true_synchronisation,
    read_truth_trajectory,
)


def write(folder, text):
    path = folder / "file.txt"
    path.write_text(text)
    return path


@pytest.mark.parametrize("text", ["5 0.2\n7 0.3\n", "# f t\n5,0.2\n7,0.3\n", "pts,time_s,frame\n1,0.2,5\n2,0.3,7\n"])
def test_time_stamps(tmp_path, text):
    stamps = read_timestamps(write(tmp_path, text))
    assert stamps.frame.tolist() == [5, 7]
    time_s, known = stamps.at(np.array([7, 6, 5, 9, 7]))
    assert known.tolist() == [True, False, True, False, True]
    assert time_s[known].tolist() == [0.3, 0.2, 0.3]
    assert np.isnan(time_s[~known]).all()


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("", None, "empty"),
        ("frame time_s\n", None, "no rows"),
        ("frame t\n1 2\n", 1, "columns named frame and time_s"),
        ("1 2 3\n", 1, "two columns"),
        ("1 0.1\n2\n", 2, "at least 2 columns"),
        ("1 0.1\n2 x\n", 2, "number for time_s"),
        ("1 0.1\n2.5 0.2\n", 2, "whole frame"),
        ("1 0.1\n2 nan\n", 2, "finite time_s"),
        ("1 0.1\n2 0.2\n2 0.3\n", 3, "frame to rise"),
        ("1 0.1\n2 0.2\n# c\n3 0.19\n", 4, "time_s not to fall from row to row, got 0.19 after 0.2"),
    ],
)
def test_bad_time_stamps(tmp_path, text, line, words):
    with pytest.raises(InputError) as caught:
        read_timestamps(write(tmp_path, text))
    assert words in caught.value.message
    assert caught.value.line == line


def test_true_trajectory(tmp_path):
    plain = read_truth_trajectory(write(tmp_path, "# GT\n 1 2 3\n4e0 5 6\n"))
    assert plain.position_m.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert plain.time_s is None
    stamped = read_truth_trajectory(write(tmp_path, "time_s,q,x_m,y_m,z_m\n0.5,1,1,2,3\n0.7,1,4,5,6\n"))
    assert stamped.position_m.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert stamped.time_s is not None
    assert stamped.time_s.tolist() == [0.5, 0.7]


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("1 2 3 4\n", 1, "three columns"),
        ("x y\n1 2\n", 1, "columns x, y, z"),
        ("x y z\n", None, "no rows"),
        ("1 2 3\n1 2 z\n", 2, "number for z"),
        ("time_s x y z\n1 2 3 4\n1 2 3 4\n", 3, "rise"),
        ("time_s x y z\n1 2 3 4\nnan 2 3 4\n", 3, "rise"),
    ],
)
def test_bad_true_trajectories(tmp_path, text, line, words):
    with pytest.raises(InputError) as caught:
        read_truth_trajectory(write(tmp_path, text))
    assert words in caught.value.message
    assert caught.value.line == line


def test_true_positions_and_synchronisation(tmp_path):
    positions = read_true_positions(write(tmp_path, "# surveyed\ncamera,x,y,z\na, 1, 2, 3\n\nb b,4,5,6.5\n"))
    assert {camera: xyz.tolist() for camera, xyz in positions.items()} == {"a": [1, 2, 3], "b b": [4, 5, 6.5]}
    clocks = read_true_synchronisation(write(tmp_path, "camera,slope,intercept\na,1,0\nb,2.0163,-1102.9\n"))
    assert clocks == {"a": (1, 0), "b": (2.0163, -1102.9)}


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("", None, "no rows"),
        ("camera,slope,intercept\n", None, "no rows"),
        ("cam,slope,intercept\na,1,0\n", 1, "expected the header camera,slope,intercept"),
        ("camera,slope,intercept\na,1,0\nb,2\n", 3, "expected camera,slope,intercept"),
        ("camera,slope,intercept\na,1,0\nb,2,x\n", 3, "expected camera,slope,intercept"),
        ("camera,slope,intercept\na,1,0\nb,2,nan\n", 3, "expected camera,slope,intercept"),
        ("camera,slope,intercept\na,1,0\na,2,1\n", 3, "appears twice"),
        ("camera,slope,intercept\na,1.1,0\nb,2,1\n", None, "no reference camera"),
    ],
)
def test_bad_synchronisation(tmp_path, text, line, words):
    with pytest.raises(InputError) as caught:
        read_true_synchronisation(write(tmp_path, text))
    assert words in caught.value.message
    assert caught.value.line == line


def test_true_orientations(tmp_path):
    text = '{"reference": "a", "cameras": {"a": {"rotation_camera_from_world": [[0,1,0],[-1,0,0],[0,0,1]], "x": 1}}}'
    known = read_true_orientations(write(tmp_path, text))
    assert {camera: rotation.tolist() for camera, rotation in known.items()} == {
        "a": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
    }


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("", 1, "not valid JSON"),
        ("[]", None, "expected an object cameras"),
        ('{"cameras": {"a": {}}}', None, "rotation_camera_from_world"),
        ('{"cameras": {"a": {"rotation_camera_from_world": [[1, 0], ["x", 1]]}}}', None, "3 by 3 numbers"),
        ('{"cameras": {"a": {"rotation_camera_from_world": [1, 0, 0]}}}', None, "camera 'a'"),
        ('{"cameras": {"a": {"rotation_camera_from_world": [[1,0,0],[0,1,0],[0,0,-1]]}}}', None, "not a rotation"),
    ],
)
def test_bad_orientations(tmp_path, text, line, words):
    with pytest.raises(InputError) as caught:
        read_true_orientations(write(tmp_path, text))
    assert words in caught.value.message
    assert caught.value.line == line
