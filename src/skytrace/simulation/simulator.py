"""A scenario played out: recordings as they would be measured, and the truth behind them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from skytrace.geometry.arrays import BoolArray, FloatArray, IntArray, frozen_array
from skytrace.model.track import Recording, Track
from skytrace.simulation.cameras import TrueCamera, draw_cameras, draw_clocks
from skytrace.simulation.detector import detect
from skytrace.simulation.flight import Motion, build_motion
from skytrace.simulation.observe import observe
from skytrace.simulation.scenario import Scenario
from skytrace.simulation.wander import wander

# A phone's exposure control takes about a second to wander: autocorrelation from one frame to the next.
_JITTER_CORRELATION = 0.95
_SWING_S = (10.0, 40.0)  # how long the frame rate takes to sink and to rise again


@dataclass(frozen=True, eq=False, slots=True)
class TrueDetections:
    """What lies behind one camera's detections, row by row of its track."""

    time_s: FloatArray  # (n,) world time of the row the target is on; of the middle row where it is not in view
    xy_px: FloatArray  # (n, 2) where the target projects, without noise; NaN where it is not in view
    is_outlier: BoolArray  # (n,) the detection is not of the target

    def __post_init__(self) -> None:
        object.__setattr__(self, "time_s", frozen_array(self.time_s, (None,), "time_s"))
        n = len(self.time_s)
        object.__setattr__(self, "xy_px", frozen_array(self.xy_px, (n, 2), "xy_px", finite=False))
        object.__setattr__(self, "is_outlier", frozen_array(self.is_outlier, (n,), "is_outlier", np.bool_))


@dataclass(frozen=True, eq=False, slots=True)
class TrueExposures:
    """When one camera exposed the frames of its part of the flight, whatever they show."""

    frame: IntArray  # (n,) consecutive
    beat: FloatArray  # (n,) time of the exposure on the camera's own clock, in nominal frame periods

    def __post_init__(self) -> None:
        object.__setattr__(self, "frame", frozen_array(self.frame, (None,), "frame", np.int64))
        object.__setattr__(self, "beat", frozen_array(self.beat, (len(self.frame),), "beat"))


@dataclass(frozen=True, eq=False, slots=True)
class Truth:
    """The flight as it was. The first camera is the reference of the clocks."""

    motion: Motion
    cameras: Mapping[str, TrueCamera]
    detections: Mapping[str, TrueDetections]
    exposures: Mapping[str, TrueExposures]

    def __post_init__(self) -> None:
        for name in ("cameras", "detections", "exposures"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    @property
    def reference(self) -> str:
        return next(iter(self.cameras))

    @property
    def is_outlier(self) -> Mapping[str, BoolArray]:
        return {camera_id: d.is_outlier for camera_id, d in self.detections.items()}

    @property
    def true_xy_px(self) -> Mapping[str, FloatArray]:
        return {camera_id: d.xy_px for camera_id, d in self.detections.items()}

    def synchronisation(self, camera_id: str) -> tuple[float, float]:
        """(slope, intercept): frame of the camera = slope * reference frame + intercept, at their middle rows."""
        reference, clock = self.cameras[self.reference].clock, self.cameras[camera_id].clock
        slope = reference.period_s / clock.period_s
        middle_s = reference.offset_s - clock.offset_s + 0.5 * (reference.readout_s - clock.readout_s)
        return slope, middle_s / clock.period_s


@dataclass(frozen=True, eq=False, slots=True)
class SimulatedFlight:
    """Recordings with their truth."""

    scenario: Scenario
    recordings: tuple[Recording, ...]  # one track each
    truth: Truth


def simulate(scenario: Scenario, rng: np.random.Generator) -> SimulatedFlight:
    """Play a scenario out; the same scenario and state of `rng` give the same flight.

    Flight, cameras, clocks and detector draw from streams of their own, so that scenarios which differ only in, say,
    noise give the same flight and cameras for the same seed.
    """
    motion_rng, camera_rng, clock_rng, *detector_rngs = rng.spawn(3 + scenario.n_cameras)
    clocks, begin_s = draw_clocks(scenario, clock_rng)
    motion = build_motion(scenario, begin_s, motion_rng)
    cameras = dict(zip(scenario.camera_ids, draw_cameras(scenario, clocks, camera_rng), strict=True))
    recordings, detections, exposures = [], {}, {}
    for i, (camera_id, camera) in enumerate(cameras.items()):
        track, detections[camera_id], exposures[camera_id] = _record(scenario, i, camera, motion, detector_rngs[i])
        recordings.append(Recording(camera_id, camera.calibrated, camera.frame_rate_hz, (track,)))
    return SimulatedFlight(scenario, tuple(recordings), Truth(motion, cameras, detections, exposures))


def _record(
    scenario: Scenario, index: int, camera: TrueCamera, motion: Motion, rng: np.random.Generator
) -> tuple[Track, TrueDetections, TrueExposures]:
    jitter_rng, detector_rng = rng.spawn(2)
    first, last, begin_s, end_s = _watched_beats(scenario, index, camera, motion)
    beats = _beats_of_frames(scenario, last, camera.frame_rate_hz, jitter_rng)
    frame = np.flatnonzero((beats >= first) & (beats <= last))
    beat = beats[frame] + _exposure_jitter(len(frame), scenario.variable_frame_rate, jitter_rng)
    xy_px, time_s = observe(motion, camera.camera_from_world, camera.clock, camera.intrinsics, beat)
    xy_px[(time_s < begin_s) | (time_s > end_s)] = np.nan
    kept, measured_px, false = detect(xy_px, camera.frame_rate_hz, camera.intrinsics.size_px, scenario, detector_rng)
    stamps_s = beat[kept] / camera.frame_rate_hz if scenario.timestamps else None
    track = Track(frame[kept], measured_px, time_s=stamps_s)
    return track, TrueDetections(time_s[kept], xy_px[kept], false), TrueExposures(frame, beat)


def _watched_beats(scenario: Scenario, index: int, camera: TrueCamera, motion: Motion) -> tuple[int, int, float, float]:
    """First and last beat of a camera in its part of the flight, and the world times that bound the part."""
    length_s = scenario.watched_fraction * (motion.end_s - motion.begin_s)
    slack_s = (motion.end_s - motion.begin_s) - length_s
    begin_s = motion.begin_s + slack_s * index / (scenario.n_cameras - 1)
    end_s = min(begin_s + length_s, motion.end_s)
    clock = camera.clock
    first = max(0, int(np.ceil((begin_s - clock.readout_s - clock.offset_s) / clock.period_s)))
    last = int(np.floor((end_s - clock.offset_s) / clock.period_s))
    return first, last, begin_s, end_s


def _beats_of_frames(scenario: Scenario, last: int, rate_hz: float, rng: np.random.Generator) -> FloatArray:
    """When frames 0, 1, ... are taken, up to beat `last`, in nominal frame periods: at every beat, unless uneven."""
    beats = np.arange(last + 1.0)
    if scenario.rate_swing > 0:
        phase = 2 * np.pi * (beats / (rate_hz * rng.uniform(*_SWING_S)) + rng.uniform())
        interval = 1 / (1 - scenario.rate_swing * 0.5 * (1 + np.sin(phase)))
        beats = np.cumsum(interval) - interval[0]
    if scenario.dropped_frames > 0:
        beats = beats[rng.uniform(size=len(beats)) >= scenario.dropped_frames]
    return beats[beats <= last]


def _exposure_jitter(n: int, deviation: float, rng: np.random.Generator) -> FloatArray:
    """Deviation (n,) of exposures from the regular beat, in frame periods: a wander that never swaps two frames."""
    if deviation == 0 or n == 0:
        return np.zeros(n)
    return deviation * np.clip(wander(n, _JITTER_CORRELATION, rng), -4, 4)
