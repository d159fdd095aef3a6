"""What a FLIGHT says of its cameras' clocks, as hints for the synchronisation."""

from __future__ import annotations

from skytrace.estimation.hints import OFFSET_SIGMA_S, Hints, OffsetHint, SimultaneousHint, from_start_times
from skytrace.io.flight import Flight, FlightMoment

_FRAME_SHARE = 0.5  # of a frame of the slowest camera: how well a moment is read off the frames that show it


def flight_hints(flight: Flight) -> Hints:
    """The hints in a FLIGHT: `offset_s`, `start_time` and `[[simultaneous]]`, frames turned into camera times."""
    offsets = tuple(
        OffsetHint(c.camera_id, c.offset_s, c.offset_sigma_s or OFFSET_SIGMA_S)
        for c in flight.cameras
        if c.offset_s is not None
    )
    started = {c.camera_id: c.start_time for c in flight.cameras if c.start_time is not None}
    starts = from_start_times(started, {c.camera_id: c.camera_time_s(0.0) for c in flight.cameras})
    return Hints((*offsets, *starts), tuple(_simultaneous(flight, moment) for moment in flight.simultaneous))


def _simultaneous(flight: Flight, moment: FlightMoment) -> SimultaneousHint:
    cameras = {c.camera_id: c for c in flight.cameras}
    slowest_hz = min(cameras[c].frame_rate_hz for c in moment.frames)
    times = {c: cameras[c].camera_time_s(frame) for c, frame in moment.frames.items()}
    return SimultaneousHint(moment.name, times, moment.sigma_s or _FRAME_SHARE / slowest_hz)
