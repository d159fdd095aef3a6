"""What a flight.toml says of places, distances, verticals and readouts: read, checked, and given deviations."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from skytrace.errors import InputError
from skytrace.geometry.wgs84 import geodetic_from_enu
from skytrace.io.flight import read_flight
from skytrace.pipeline.flight_known import flight_known

LENS = {"K-matrix": [[900, 0, 640], [0, 900, 360], [0, 0, 1]], "distCoeff": [0, 0, 0, 0], "resolution": [1280, 720]}


def write(folder: Path, end: str = "", begin: str = "", **cameras: str) -> Path:
    (folder / "lens.json").write_text(json.dumps(LENS | {"fps": 25}))
    text = begin
    for camera_id, lines in cameras.items():
        (folder / f"{camera_id}.csv").write_text("frame,x,y\n10,1,2\n11,3,4\n")
        text += f'[[camera]]\nid = "{camera_id}"\ncalibration = "lens.json"\ndetections = "{camera_id}.csv"\n{lines}\n'
    (folder / "flight.toml").write_text(text + end)
    return folder


def known(folder: Path, end: str = "", begin: str = "", **cameras: str):
    return flight_known(read_flight(write(folder, end, begin, **cameras)))


def test_nothing_said_is_nothing_known(tmp_path):
    assert known(tmp_path, a="", b="") is None


def test_positions_in_metres_with_one_deviation_or_three(tmp_path):
    found = known(
        tmp_path,
        a="position_m = [1, 2, 3]\nposition_sigma_m = 0.05",
        b="position_m = [4, 5, 6]\nposition_sigma_m = [1, 2, 3]",
        c="position_m = [7, 8, 9]",
    )
    assert found is not None
    assert [p.camera_id for p in found.positions] == ["a", "b", "c"]
    np.testing.assert_array_equal([p.position_m for p in found.positions], [[1, 2, 3], [4, 5, 6], [7, 8, 9]])
    np.testing.assert_array_equal([p.sigma_m for p in found.positions], [[0.05] * 3, [1, 2, 3], [0.1] * 3])
    assert found.earth is None
    assert not found.placed


def test_places_on_the_earth_become_metres_about_their_middle(tmp_path):
    """One that is far off does not carry the middle away."""
    places = "[47.0, 8.0, 400]", "[47.001, 8.0, 410]", "[47.0, 8.001, 420]", "[10.0, 100.0, 0]"
    lines = {f"c{k}": f"position_wgs84 = {place}" for k, place in enumerate(places)}
    found = known(tmp_path, begin='vertical_datum = "EGM96"\n', **lines)
    assert found is not None
    assert found.earth is not None
    assert found.earth.vertical_datum == "EGM96"
    origin = found.earth.origin
    assert np.abs(np.degrees(origin[:2]) - [47.0, 8.0]).max() < 0.002
    for position, place in zip(found.positions, places, strict=True):
        latitude, longitude, height_m = geodetic_from_enu(position.position_m, origin)
        np.testing.assert_allclose(
            [np.degrees(latitude), np.degrees(longitude), height_m], json.loads(place), atol=1e-6
        )
        np.testing.assert_array_equal(position.sigma_m, [5, 5, 10])


def test_distances_verticals_and_readouts(tmp_path):
    end = '[[known_distance]]\ncameras = ["b", "a"]\nmetres = 50\n\n[[known_distance]]\ncameras = ["a", "c"]\n'
    found = known(
        tmp_path,
        end + "metres = 1\nsigma_m = 0.5\n",
        a="up_in_camera = [0, -9.81, 0]\nreadout_s = 0.02\nreadout_sigma_s = 0.001",
        b="up_in_camera = [0, -1, 1]\nup_sigma_deg = 0.5",
        c="readout_s = 0.03",
    )
    assert found is not None
    assert [(d.camera_ids, d.metres, d.sigma_m) for d in found.distances] == [
        (("b", "a"), 50, 0.5),
        (("a", "c"), 1, 0.5),
    ]
    np.testing.assert_allclose([u.up_in_camera for u in found.ups], [[0, -1, 0], [0, -(0.5**0.5), 0.5**0.5]])
    np.testing.assert_allclose([u.sigma_rad for u in found.ups], np.radians([2.0, 0.5]))
    assert [(r.camera_id, r.readout_s, r.sigma_s) for r in found.readouts] == [("a", 0.02, 0.001), ("c", 0.03, 5e-4)]


DISTANCE = '[[known_distance]]\ncameras = ["a", "b"]\nmetres = 5\n'


@pytest.mark.parametrize(
    ("a", "end", "line", "words"),
    [
        ("position_sigma_m = 1", "", 5, "given without position_m or position_wgs84"),
        ("position_m = [1, 2, 3]\nposition_sigma_m = 0", "", 6, "expected a positive number, got 0"),
        ("position_m = [1, 2, 3]\nposition_sigma_m = [1, -1, 1]", "", 6, "expected positive numbers, got [1"),
        ('position_m = [1, 2, 3]\nposition_sigma_m = "5 m"', "", 6, "position_sigma_m: expected"),
        ("position_m = [1, 2, 3]\nposition_wgs84 = [47, 8, 400]", "", 6, "every position as position_m, or every"),
        ("position_wgs84 = [8.5, 470, 400]", "", 5, "expected latitude (-90 to 90)"),
        ("readout_sigma_s = 0.001", "", 5, "given without readout_s"),
        ("readout_s = 0.01\nreadout_sigma_s = inf", "", 6, "expected a positive number, got inf"),
        ("up_sigma_deg = 2", "", 5, "given without up_in_camera"),
        ("up_in_camera = [0, 0, 0]", "", 5, "expected a direction"),
        ("up_in_camera = [0, nan, 0]", "", 5, "expected finite numbers"),
        ("up_in_camera = [0, 1]", "", 5, "up_in_camera"),
        ("", DISTANCE.replace('"b"', '"bb"'), 11, "unknown camera 'bb'"),
        ("", DISTANCE.replace('"b"', '"a"'), 11, "expected the ids of two cameras"),
        ("", DISTANCE.replace(', "b"', ""), 11, "expected the ids of two cameras"),
        ("", DISTANCE.replace("5", "-5"), 12, "metres: expected a positive number, got -5"),
        ("", DISTANCE + "sigma_m = 0\n", 13, "sigma_m: expected a positive number, got 0"),
        ("", DISTANCE + DISTANCE.replace('"a", "b"', '"b", "a"'), 14, "is given twice"),
        ("", DISTANCE.replace("metres", "meters"), 12, "unknown key 'meters' (did you mean 'metres'?)"),
        ("", DISTANCE.replace("metres = 5\n", ""), 10, "the key 'metres' is missing"),
        ("", DISTANCE.replace("[[", "[").replace("]]", "]"), 10, "expected [[known_distance]] tables (double"),
    ],
)
def test_mistakes_are_told_with_their_line(tmp_path, a, end, line, words):
    with pytest.raises(InputError, match=r"flight\.toml") as caught:
        read_flight(write(tmp_path, end, a=a, b=""))
    assert words in str(caught.value)
    shift = 1 if end else 0
    assert caught.value.line == line + shift


def test_a_vertical_datum_needs_heights(tmp_path):
    with pytest.raises(InputError, match="without any position_wgs84"):
        known(tmp_path, begin='vertical_datum = "EGM96"\n', a="position_m = [1, 2, 3]", b="")
