"""Geodesy against published examples and, where it is installed, PROJ."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.geometry.wgs84 import ecef_from_geodetic, enu_from_geodetic, geodetic_from_ecef


def radians(degrees: int, minutes: int, seconds: float) -> float:
    return np.radians(degrees + minutes / 60 + seconds / 3600)


# EPSG Guidance Note 7-2, examples of methods 9602 (geographic/geocentric) and 9837 (geographic/topocentric).
PLACE = np.array([radians(53, 48, 33.820), radians(2, 7, 46.380), 73.0])
ORIGIN = np.array([np.radians(55.0), np.radians(5.0), 200.0])


def test_epsg_example_of_geocentric_coordinates() -> None:
    assert np.allclose(ecef_from_geodetic(PLACE), [3771793.968, 140253.342, 5124304.349], rtol=0, atol=6e-4)
    back = geodetic_from_ecef(np.array([3771793.968, 140253.342, 5124304.349]))
    assert np.allclose(back[:2], PLACE[:2], rtol=0, atol=1e-10)
    assert abs(back[2] - 73.0) < 1e-3


def test_epsg_example_of_topocentric_coordinates() -> None:
    assert np.allclose(enu_from_geodetic(PLACE, ORIGIN), [-189013.869, -128642.040, -4220.171], rtol=0, atol=6e-4)


def test_the_poles_and_many_places_at_once() -> None:
    poles = geodetic_from_ecef(np.array([[0.0, 0.0, 6356752.314245 + 10.0], [0.0, 0.0, -6356752.314245]]))
    assert np.allclose(poles[:, 0], [np.pi / 2, -np.pi / 2], rtol=0, atol=1e-15)
    assert np.allclose(poles[:, 2], [10.0, 0.0], rtol=0, atol=1e-6)
    assert ecef_from_geodetic(np.zeros((2, 5, 3))).shape == (2, 5, 3)


def test_the_same_as_proj(rng: np.random.Generator) -> None:
    pyproj = pytest.importorskip("pyproj")
    n = 2000
    places = np.column_stack(
        [rng.uniform(-np.pi / 2, np.pi / 2, n), rng.uniform(-np.pi, np.pi, n), rng.uniform(-1e3, 5e3, n)]
    )
    transformer = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    theirs = np.column_stack(transformer.transform(np.degrees(places[:, 1]), np.degrees(places[:, 0]), places[:, 2]))
    assert np.abs(ecef_from_geodetic(places) - theirs).max() < 1e-7
    # PROJ stops after one round of Bowring's formula: heights are kept to where that is good enough.
    longitude, latitude, height = transformer.transform(*theirs.T, direction="INVERSE")
    ours = geodetic_from_ecef(theirs)
    assert np.abs(np.degrees(ours[:, :2]) - np.column_stack([latitude, longitude])).max() < 1e-10
    assert np.abs(ours[:, 2] - height).max() < 1e-6
