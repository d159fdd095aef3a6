"""What a FLIGHT says of its cameras' places, distances, verticals and readouts, as knowledge for the reconstruction."""

from __future__ import annotations

import math

import numpy as np

from skytrace.estimation.known import Known, KnownDistance, KnownPosition, KnownReadout, KnownUp
from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import Similarity
from skytrace.geometry.wgs84 import ecef_from_geodetic, enu_from_geodetic, geodetic_from_ecef
from skytrace.io.flight import Flight, FlightCamera
from skytrace.model.georeference import ELLIPSOID, Georeference

# Deviations where none is given.
SURVEY_SIGMA_M = 0.1  # of position_m
PHONE_SIGMA_M = (5.0, 5.0, 10.0)  # of position_wgs84, east, north and up
DISTANCE_SHARE, DISTANCE_SIGMA_M = 0.01, 0.02  # of a distance; at least
UP_SIGMA_DEG = 2.0  # a phone's accelerometer at rest, and how its camera is mounted
READOUT_SIGMA_S = 5e-4


def flight_known(flight: Flight) -> Known | None:
    """What a FLIGHT tells of its cameras; None where it tells nothing. Positions on the earth become metres east, north
    and up of their middle (`middle_of_earth_positions`)."""
    known = Known(
        positions=_positions(flight),
        distances=tuple(
            KnownDistance(d.camera_ids, d.metres, d.sigma_m or max(DISTANCE_SHARE * d.metres, DISTANCE_SIGMA_M))
            for d in flight.distances
        ),
        ups=tuple(
            KnownUp(c.camera_id, c.up_in_camera, math.radians(c.up_sigma_deg or UP_SIGMA_DEG))
            for c in flight.cameras
            if c.up_in_camera is not None
        ),
        readouts=tuple(
            KnownReadout(c.camera_id, c.readout_s, c.readout_sigma_s or READOUT_SIGMA_S)
            for c in flight.cameras
            if c.readout_s is not None
        ),
        earth=_earth(flight),
    )
    return known if known.of_places or known.readouts else None


def middle_of_earth_positions(geodetic: FloatArray) -> FloatArray:
    """The geodetic origin (3,) among geodetic positions (n, 3): their median, which one wrong one cannot carry away."""
    return geodetic_from_ecef(np.median(ecef_from_geodetic(geodetic), axis=0))


def _earth(flight: Flight) -> Georeference | None:
    given = [_geodetic(c.position_wgs84) for c in flight.cameras if c.position_wgs84 is not None]
    if not given:
        return None
    latitude, longitude, height_m = middle_of_earth_positions(np.array(given)).tolist()
    unmoved = Similarity(1.0, np.eye(3), np.zeros(3))
    return Georeference(latitude, longitude, height_m, unmoved, flight.vertical_datum or ELLIPSOID)


def _positions(flight: Flight) -> tuple[KnownPosition, ...]:
    earth = _earth(flight)
    return tuple(
        KnownPosition(camera.camera_id, position_m, _sigma_m(camera))
        for camera in flight.cameras
        for position_m in [_position_m(camera, earth)]
        if position_m is not None
    )


def _position_m(camera: FlightCamera, earth: Georeference | None) -> FloatArray | None:
    if earth is None or camera.position_wgs84 is None:
        return camera.position_m
    return enu_from_geodetic(_geodetic(camera.position_wgs84), earth.origin)


def _sigma_m(camera: FlightCamera) -> FloatArray:
    if camera.position_sigma_m is not None:
        return camera.position_sigma_m
    return np.array(PHONE_SIGMA_M if camera.position_m is None else (SURVEY_SIGMA_M,) * 3)


def _geodetic(position_wgs84: FloatArray) -> FloatArray:
    """Radians and metres of degrees and metres."""
    return np.array([*np.radians(position_wgs84[:2]), position_wgs84[2]])
