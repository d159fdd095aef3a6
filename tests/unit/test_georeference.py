"""Where on the earth a run lies: the type, and its file in the RUN folder."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from export_scene import make_georeference

from skytrace.errors import InputError
from skytrace.geometry.rigid import Similarity
from skytrace.geometry.wgs84 import enu_from_geodetic
from skytrace.io.georeference import GEOREFERENCE, read_georeference, write_georeference
from skytrace.model.georeference import Georeference

UNCHANGED = Similarity(1.0, np.eye(3), np.zeros(3))


def test_world_to_enu_to_the_earth(rng: np.random.Generator) -> None:
    georeference, points = make_georeference(), rng.normal(size=(7, 3))
    enu = georeference.enu_from_world.apply(points)
    assert np.array_equal(georeference.enu(points), enu)
    assert np.allclose(enu_from_geodetic(georeference.geodetic(points), georeference.origin), enu, atol=1e-6)


def test_the_file_tells_the_same(tmp_path: Path) -> None:
    given = make_georeference("EGM96 geoid")
    path = write_georeference(tmp_path, given, {"residual_m": np.float64(0.25), "missing": np.nan})
    assert path == tmp_path / GEOREFERENCE
    assert [p.name for p in tmp_path.iterdir()] == [GEOREFERENCE]
    back = read_georeference(tmp_path)
    assert back is not None
    assert np.allclose(back.origin, given.origin, rtol=0, atol=1e-15)
    assert back.height_m == given.height_m
    assert back.vertical_datum == "EGM96 geoid"
    assert np.array_equal(back.enu_from_world.rotation, given.enu_from_world.rotation)
    assert np.array_equal(back.enu_from_world.translation, given.enu_from_world.translation)
    assert back.enu_from_world.scale == 20.0
    document = json.loads(path.read_text())
    assert document["details"] == {"residual_m": 0.25, "missing": None}
    assert document["origin"]["latitude_deg"] == pytest.approx(47.4)


def test_a_run_may_have_none(tmp_path: Path) -> None:
    assert read_georeference(tmp_path) is None


@pytest.mark.parametrize(
    ("section", "key", "value", "words"),
    [
        (None, "format", "other", "skytrace georeference 1"),
        (None, "origin", [1], "origin: expected an object"),
        ("origin", "latitude_deg", "47", "origin.latitude_deg: expected a number, got '47'"),
        ("origin", "latitude_deg", 91.0, "latitude_rad"),
        ("origin", "vertical_datum", "", "vertical_datum"),
        ("origin", "height_m", True, "origin.height_m: expected a number"),
        ("enu_from_world", "rotation", [[1, 0], [0, 1]], "enu_from_world.rotation: expected numbers of shape (3, 3)"),
        ("enu_from_world", "rotation", [[1, 0, 0], [0, 1, 0], [0, "x", 1]], "enu_from_world.rotation"),
        ("enu_from_world", "scale", -1.0, "scale: expected a positive number"),
    ],
)
def test_a_malformed_file_is_refused(tmp_path: Path, section: str | None, key: str, value, words: str) -> None:
    path = write_georeference(tmp_path, make_georeference())
    document = json.loads(path.read_text())
    (document if section is None else document[section])[key] = value
    path.write_text(json.dumps(document))
    with pytest.raises(InputError) as caught:
        read_georeference(tmp_path)
    assert caught.value.path == str(path)
    assert words in caught.value.message


def test_broken_json_is_refused_with_its_line(tmp_path: Path) -> None:
    (tmp_path / GEOREFERENCE).write_text('{\n"format": \n}')
    with pytest.raises(InputError, match=r":3: not valid JSON"):
        read_georeference(tmp_path)


@pytest.mark.parametrize(("latitude", "longitude", "height"), [(1.6, 0, 0), (0, 7.0, 0), (0, 0, np.nan)])
def test_an_origin_must_be_on_the_earth(latitude: float, longitude: float, height: float) -> None:
    with pytest.raises(ValueError, match=r"origin|latitude_rad|longitude_rad"):
        Georeference(latitude, longitude, height, UNCHANGED)
