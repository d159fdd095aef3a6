"""Flights in the one order and time that everything is computed in, so that results do not depend on those given.

Cameras go by their names, and each camera's time begins with its first detection: results are then the same, but for
the rounding of time stamps, whichever camera is listed first and wherever frame numbers begin.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from skytrace.estimation.hints import Hints
from skytrace.estimation.synchronize import Synchronisation
from skytrace.model.camera import Clock
from skytrace.model.reconstruction import CameraEstimate
from skytrace.model.track import Recording, Track

_ROUNDING_S = 1e-10


@dataclass(frozen=True, slots=True)
class Origin:
    """The frame and the time on a camera's own clock from which its time is counted."""

    frame: int
    time_s: float

    def stretched(self, factor: float) -> Origin:
        """The same on a clock that runs `factor` times as fast."""
        return replace(self, time_s=factor * self.time_s)

    def rebased(self, recording: Recording) -> Recording:
        """The recording with frames and time counted from here."""
        return replace(recording, tracks=tuple(self._rebased(track) for track in recording.tracks))

    def _rebased(self, track: Track) -> Track:
        time_s = None if track.time_s is None else track.time_s - self.time_s
        return replace(track, frame=track.frame - self.frame, time_s=time_s)

    def restored(self, camera: CameraEstimate) -> CameraEstimate:
        """The estimate with frames counted as they were given."""
        clock = camera.clock
        offset_s = clock.offset_s - self.frame * clock.period_s
        if abs(offset_s) < _ROUNDING_S:  # the reference camera has 0, not what subtraction leaves of it
            offset_s = 0.0
        return replace(
            camera,
            clock=Clock(offset_s, clock.period_s, clock.readout_s, clock.height_px),
            residuals=replace(camera.residuals, frame=camera.residuals.frame + self.frame),
        )


def origins(recordings: Mapping[str, Recording]) -> dict[str, Origin]:
    """The first detection of each camera, cameras by name."""
    found = {}
    for camera_id in sorted(recordings):
        track = min(recordings[camera_id].tracks, key=lambda t: t.frame[0])
        found[camera_id] = Origin(int(track.frame[0]), float(recordings[camera_id].camera_time_s(track)[0]))
    return found


def rebased_hints(hints: Hints, origin: Mapping[str, Origin]) -> Hints:
    """What hints say of clocks that are counted from their origins; hints of other cameras stay."""

    def begin_s(camera_id: str) -> float:
        return origin[camera_id].time_s if camera_id in origin else 0.0

    return Hints(
        tuple(replace(h, offset_s=h.offset_s + begin_s(h.camera_id)) for h in hints.offsets),
        tuple(
            replace(h, camera_time_s={c: t - begin_s(c) for c, t in h.camera_time_s.items()})
            for h in hints.simultaneous
        ),
    )


def restored_synchronisation(found: Synchronisation, origin: Mapping[str, Origin]) -> Synchronisation:
    """The synchronisation between the clocks as they were given."""

    def between(camera0: str, camera1: str, offset_s: float, rate: float) -> float:
        return offset_s + origin[camera1].time_s - rate * origin[camera0].time_s

    def group(clocks: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
        first = next(iter(clocks), "")
        return {c: (between(c, first, offset_s, rate), rate) for c, (offset_s, rate) in clocks.items()}

    pairs = [replace(p, offset_s=between(p.camera0, p.camera1, p.offset_s, p.rate)) for p in found.pairs]
    evidence = [
        replace(
            p,
            offset_s=between(p.camera0, p.camera1, p.offset_s, p.rate),
            rivals=tuple((between(p.camera0, p.camera1, offset_s, p.rate), score) for offset_s, score in p.rivals),
        )
        for p in found.evidence
    ]
    groups = tuple(group(g) for g in found.groups)
    return replace(found, clocks=group(found.clocks), pairs=tuple(pairs), groups=groups, evidence=tuple(evidence))
