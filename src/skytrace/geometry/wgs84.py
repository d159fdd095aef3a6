"""Places on the earth: geodetic coordinates, earth-centred ones, and east, north, up of an origin.

Geodetic coordinates are rows (latitude_rad, longitude_rad, height_m) above the WGS84 ellipsoid; earth-centred,
earth-fixed (ECEF) ones are metres, x towards latitude and longitude 0, z towards the north pole.
"""

from __future__ import annotations

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import Rigid

SEMI_MAJOR_M = 6378137.0
FLATTENING = 1 / 298.257223563
SEMI_MINOR_M = SEMI_MAJOR_M * (1 - FLATTENING)
_E2 = FLATTENING * (2 - FLATTENING)  # first eccentricity squared
_EP2 = _E2 / (1 - _E2)  # second eccentricity squared
# Each round of Bowring's formula gains over five digits within thousands of kilometres of the surface.
_ROUNDS = 3


def ecef_from_geodetic(geodetic: FloatArray) -> FloatArray:
    """ECEF coordinates (..., 3) in metres of geodetic ones (..., 3).

    EPSG Guidance Note 7-2, method 9602.
    """
    latitude, longitude, height = np.moveaxis(np.asarray(geodetic, float), -1, 0)
    normal_m = SEMI_MAJOR_M / np.sqrt(1 - _E2 * np.sin(latitude) ** 2)
    across_m = (normal_m + height) * np.cos(latitude)
    return np.stack(
        [
            across_m * np.cos(longitude),
            across_m * np.sin(longitude),
            ((1 - _E2) * normal_m + height) * np.sin(latitude),
        ],
        axis=-1,
    )


def geodetic_from_ecef(ecef_m: FloatArray) -> FloatArray:
    """Geodetic coordinates (..., 3) of ECEF ones (..., 3), longitude in (-pi, pi].

    Bowring, "Transformation from spatial to geographical coordinates", Survey Review 1976, iterated; good to a
    micrometre from 100 km below the ellipsoid to beyond the satellites.
    """
    x, y, z = np.moveaxis(np.asarray(ecef_m, float), -1, 0)
    across_m = np.hypot(x, y)
    reduced = np.arctan2(z, (1 - FLATTENING) * across_m)
    latitude = reduced
    for _ in range(_ROUNDS):
        latitude = np.arctan2(
            z + _EP2 * SEMI_MINOR_M * np.sin(reduced) ** 3, across_m - _E2 * SEMI_MAJOR_M * np.cos(reduced) ** 3
        )
        reduced = np.arctan2((1 - FLATTENING) * np.sin(latitude), np.cos(latitude))
    sine = np.sin(latitude)
    # This form of the height loses nothing at the poles, where the usual one divides by the cosine of the latitude.
    height_m = across_m * np.cos(latitude) + z * sine - SEMI_MAJOR_M * np.sqrt(1 - _E2 * sine**2)
    return np.stack([latitude, np.arctan2(y, x), height_m], axis=-1)


def enu_from_ecef(origin_geodetic: FloatArray) -> Rigid:
    """The motion from ECEF coordinates to metres east, north and up of a geodetic origin (3,).

    EPSG Guidance Note 7-2, method 9836.
    """
    latitude, longitude, _ = np.asarray(origin_geodetic, float)
    sin_lat, cos_lat = np.sin(latitude), np.cos(latitude)
    sin_lon, cos_lon = np.sin(longitude), np.cos(longitude)
    rotation = np.array(
        [
            [-sin_lon, cos_lon, 0.0],
            [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat],
            [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat],
        ]
    )
    return Rigid.from_centre(rotation, ecef_from_geodetic(origin_geodetic))


def enu_from_geodetic(geodetic: FloatArray, origin_geodetic: FloatArray) -> FloatArray:
    """Metres east, north and up (..., 3) of a geodetic origin (3,), of geodetic coordinates (..., 3)."""
    return enu_from_ecef(origin_geodetic).apply(ecef_from_geodetic(geodetic))


def geodetic_from_enu(enu_m: FloatArray, origin_geodetic: FloatArray) -> FloatArray:
    """Geodetic coordinates (..., 3) of metres east, north and up (..., 3) of a geodetic origin (3,)."""
    return geodetic_from_ecef(enu_from_ecef(origin_geodetic).inverse().apply(enu_m))
