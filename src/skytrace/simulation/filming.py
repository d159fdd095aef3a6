"""A simulated flight as films show it: frames counted from the first one filmed, times as containers state them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skytrace.geometry.arrays import IntArray
from skytrace.model.track import Track
from skytrace.simulation.simulator import SimulatedFlight, TrueExposures, Truth


def as_filmed(simulated: SimulatedFlight, ticks_per_s: int) -> SimulatedFlight:
    """The same flight with every camera's frames and time stamps counted from the first frame it filmed.

    The instants of exposure move by up to half a tick, so that time stamps in ticks state them exactly. World time
    stays what it was: the reference camera's clock is then no longer at 0 when its frame 0 is exposed.
    """
    cameras, exposures, recordings = {}, {}, []
    for recording in simulated.recordings:
        camera_id = recording.camera_id
        camera, filmed = simulated.truth.cameras[camera_id], simulated.truth.exposures[camera_id]
        if len(filmed.frame) == 0:
            raise ValueError(f"{camera_id}: expected at least one frame of the flight")
        first, begin = filmed.frame[0], float(filmed.beat[0])
        rate_hz = recording.frame_rate_hz
        beat = np.rint((filmed.beat - begin) / rate_hz * ticks_per_s) / ticks_per_s * rate_hz
        exposures[camera_id] = TrueExposures(filmed.frame - first, beat)
        clock = camera.clock
        cameras[camera_id] = replace(camera, clock=replace(clock, offset_s=clock.offset_s + clock.period_s * begin))
        tracks = tuple(
            Track(
                track.frame - first,
                track.xy_px,
                track.sigma_px,
                None if track.time_s is None else track.time_s - begin / rate_hz,
            )
            for track in recording.tracks
        )
        recordings.append(replace(recording, tracks=tracks))
    truth = simulated.truth
    moved = Truth(truth.motion, cameras, truth.detections, exposures)
    return SimulatedFlight(simulated.scenario, tuple(recordings), moved)


def ticks(exposures: TrueExposures, frame_rate_hz: float, ticks_per_s: int) -> IntArray:
    """Time stamps (n,) of a film's frames."""
    return np.rint(exposures.beat / frame_rate_hz * ticks_per_s).astype(np.int64)
