"""Where on the earth a reconstruction lies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import Similarity
from skytrace.geometry.wgs84 import geodetic_from_enu

ELLIPSOID = "WGS84 ellipsoid"


@dataclass(frozen=True, eq=False, slots=True)
class Georeference:
    """The similarity from a reconstruction's world to metres east, north and up of an origin on the WGS84 ellipsoid.

    `vertical_datum` names what heights are counted from, the origin's and those of all results. Heights are never
    converted: where the datum is a geoid's, results are right as far as that geoid is parallel to the ellipsoid over
    the scene, which is to centimetres a kilometre.
    """

    latitude_rad: float  # of the origin
    longitude_rad: float
    height_m: float
    enu_from_world: Similarity
    vertical_datum: str = ELLIPSOID

    def __post_init__(self) -> None:
        if not np.isfinite([self.latitude_rad, self.longitude_rad, self.height_m]).all():
            raise ValueError("origin: expected finite numbers")
        if not abs(self.latitude_rad) <= np.pi / 2:
            raise ValueError(f"latitude_rad: expected at most pi / 2 either way, got {self.latitude_rad}")
        if not abs(self.longitude_rad) <= 2 * np.pi:
            raise ValueError(f"longitude_rad: expected at most 2 pi either way, got {self.longitude_rad}")
        if not self.vertical_datum.strip():
            raise ValueError(f"vertical_datum: expected a name such as {ELLIPSOID!r}")

    @property
    def origin(self) -> FloatArray:
        """Latitude and longitude in radians, height in metres, (3,)."""
        return np.array([self.latitude_rad, self.longitude_rad, self.height_m])

    def enu(self, point_in_world: FloatArray) -> FloatArray:
        """Metres east, north and up of the origin (..., 3) of points in the world (..., 3)."""
        return self.enu_from_world.apply(point_in_world)

    def geodetic(self, point_in_world: FloatArray) -> FloatArray:
        """Latitude and longitude in radians and height in metres (..., 3) of points in the world (..., 3)."""
        return geodetic_from_enu(self.enu(point_in_world), self.origin)

    @property
    def in_words(self) -> str:
        """The frame of east, north and up, and its origin."""
        latitude_deg, longitude_deg = np.degrees(self.origin[:2])
        return (
            f"east, north, up of latitude {latitude_deg:.9f} deg, longitude {longitude_deg:.9f} deg (WGS84), "
            f"height {self.height_m:.3f} m above {self.vertical_datum}"
        )
