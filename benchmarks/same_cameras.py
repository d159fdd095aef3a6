"""Short simulated flights filmed by the same cameras, whose calibrations are wrong alike in all of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skytrace.model.track import Recording
from skytrace.simulation import Scenario, simulate
from skytrace.simulation.simulator import SimulatedFlight

WEAK = Scenario(
    duration_s=45.0,
    n_cameras=3,
    frame_rates_hz=(30.0, 25.0, 50.0),
    resolutions_px=((1920, 1080),),
    distortion=0.0,
    focal_error=0.03,
    readout_fraction=0.4,
    noise_px=0.4,
    drift_px=0.7,
    offset_range_s=10.0,
)


class _Streams:
    """What the simulator draws from: a stream each for the flight, the cameras, the clocks, and every detector."""

    def __init__(self, cameras: int, flight: int) -> None:
        self._cameras, self._flight = cameras, flight

    def spawn(self, n: int) -> list[np.random.Generator]:
        seeds = [[self._cameras, self._flight, k] for k in range(n)]
        seeds[1] = [self._cameras]
        return [np.random.default_rng(seed) for seed in seeds]


def filmed_by_the_same(cameras: int, flight: int, scenario: Scenario = WEAK) -> SimulatedFlight:
    """One of the flights filmed by the cameras of a seed: these have their lenses and places in all of them."""
    return simulate(scenario, _Streams(cameras, flight))  # type: ignore[arg-type]


def zoomed(simulated: SimulatedFlight, camera_id: str, factor: float) -> SimulatedFlight:
    """The same with the zoom of a camera changed after its calibration; its lens must be free of distortion."""
    lens = simulated.truth.cameras[camera_id].intrinsics
    if lens.distortion.any():
        raise ValueError(f"{camera_id}: expected a lens without distortion")

    def seen(recording: Recording) -> Recording:
        if recording.camera_id != camera_id:
            return recording
        tracks = []
        for track in recording.tracks:
            xy_px = lens.principal_px + factor * (track.xy_px - lens.principal_px)
            inside = ((xy_px >= 0) & (xy_px <= np.array(lens.size_px) - 1)).all(axis=1)
            tracks.append(replace(track, xy_px=xy_px).select(inside))
        return replace(recording, tracks=tuple(tracks))

    return replace(simulated, recordings=tuple(seen(r) for r in simulated.recordings))
