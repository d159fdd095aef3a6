"""Tables of places of cameras or of the target."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.errors import InputError
from skytrace.io.places import read_places


def test_cameras_in_metres(tmp_path):
    path = tmp_path / "cameras.csv"
    path.write_text("# survey\ncamera,x,y,z\nleft,1,2,3\n7,4,5,6\n")
    found = read_places(path, "camera")
    assert found.camera_ids == ("left", "7")
    assert not found.on_earth
    np.testing.assert_array_equal(found.position, [[1, 2, 3], [4, 5, 6]])
    assert found.sigma_m is None


def test_a_log_on_the_earth_with_deviations_in_any_order(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("lon;time_s;lat;alt;accuracy\n8.5;0.0;47.1;400;2\n8.6;0.2;47.2;401;3\n")
    found = read_places(path, "time_s")
    assert found.on_earth
    np.testing.assert_allclose(
        found.position, [[np.radians(47.1), np.radians(8.5), 400], [np.radians(47.2), np.radians(8.6), 401]]
    )
    np.testing.assert_array_equal(found.time_s, [0.0, 0.2])
    np.testing.assert_array_equal(found.sigma_m, [2, 3])


@pytest.mark.parametrize(
    ("text", "key", "line", "words"),
    [
        ("1,2,3\n", "camera", 1, "expected a header camera,x,y,z"),
        ("camera,x,y\na,1,2\n", "camera", 1, "expected a header"),
        ("camera,x,y,z,lat,lon,height\na,1,2,3,4,5,6\n", "camera", 1, "expected a header"),
        ("time_s,x,y,z\n1,1,2,3\n1,1,2,3\n", "time_s", 3, "expected time_s to rise"),
        ("camera,x,y,z\na,1,2,3\na,1,2,3\n", "camera", 3, "camera 'a' appears twice"),
        ("camera,lat,lon,height\na,470,8,3\n", "camera", 2, "latitude, longitude in degrees"),
        ("camera,x,y,z,sigma_m\na,1,2,3,0\n", "camera", 2, "a positive deviation"),
        ("camera,x,y,z\na,1,2,nan\n", "camera", 2, "three numbers"),
        ("camera,x,y,z\na,1,2,three\n", "camera", 2, "expected a number for z"),
        ("camera,x,y,z\n", "camera", None, "a header and no rows"),
    ],
)
def test_mistakes_are_told_with_their_line(tmp_path, text, key, line, words):
    path = tmp_path / "places.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=r"places\.csv") as caught:
        read_places(path, key)
    assert words in str(caught.value)
    assert caught.value.line == line
