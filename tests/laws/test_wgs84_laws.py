"""Geodetic, earth-centred and local coordinates are one another's inverses, everywhere."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from skytrace.geometry.wgs84 import (
    SEMI_MAJOR_M,
    SEMI_MINOR_M,
    ecef_from_geodetic,
    enu_from_ecef,
    enu_from_geodetic,
    geodetic_from_ecef,
    geodetic_from_enu,
)

latitudes = st.floats(-np.pi / 2, np.pi / 2)
longitudes = st.floats(-np.pi, np.pi)
heights = st.floats(-11_000.0, 400_000.0)
places = st.tuples(latitudes, longitudes, heights).map(np.array)
offsets = st.tuples(*[st.floats(-20_000.0, 20_000.0)] * 3).map(np.array)


@given(places)
def test_geodetic_survives_the_way_to_ecef_and_back(place) -> None:
    ecef = ecef_from_geodetic(place)
    back = geodetic_from_ecef(ecef)
    assert abs(back[0] - place[0]) < 1e-12
    assert abs(back[2] - place[2]) < 1e-7
    # The longitude has no meaning at the poles; the place has.
    assert np.linalg.norm(ecef_from_geodetic(back) - ecef) < 1e-6


@given(places)
def test_up_is_the_direction_in_which_the_height_rises(place) -> None:
    up = enu_from_ecef(place).rotation[2]
    higher = ecef_from_geodetic(place + [0.0, 0.0, 10.0])
    assert np.allclose(higher - ecef_from_geodetic(place), 10.0 * up, atol=1e-7)


@given(places, offsets)
def test_enu_survives_the_way_to_geodetic_and_back(origin, enu) -> None:
    assert np.allclose(enu_from_geodetic(geodetic_from_enu(enu, origin), origin), enu, atol=1e-6)


@given(places, offsets, offsets)
def test_enu_keeps_distances(origin, a, b) -> None:
    ecef = [ecef_from_geodetic(geodetic_from_enu(p, origin)) for p in (a, b)]
    assert abs(np.linalg.norm(ecef[0] - ecef[1]) - np.linalg.norm(a - b)) < 1e-6


@given(latitudes, longitudes)
def test_height_zero_is_the_ellipsoid(latitude, longitude) -> None:
    x, y, z = ecef_from_geodetic(np.array([latitude, longitude, 0.0]))
    assert abs((x**2 + y**2) / SEMI_MAJOR_M**2 + z**2 / SEMI_MINOR_M**2 - 1) < 1e-14
