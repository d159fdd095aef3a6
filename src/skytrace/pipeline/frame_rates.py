"""Frame rates that synchronisation found to be grossly wrong."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from skytrace.model.track import Recording

_GROSS_RATE = 0.01  # a real clock is never off by this much: the given frame rate is a mistake


def correct_frame_rates(
    recordings: Mapping[str, Recording], clocks: Mapping[str, tuple[float, float]]
) -> tuple[dict[str, Recording], dict[str, tuple[float, float]]]:
    """Recordings with the frame rates that synchronisation found where those given are grossly wrong, and their clocks.

    The rate found is folded into the frame rate, and into the time stamps, which are stretched in slowed-down videos.
    """
    corrected, found = dict(recordings), dict(clocks)
    for camera_id, (offset_s, rate) in clocks.items():
        if abs(rate - 1) > _GROSS_RATE:
            corrected[camera_id] = _stretched(recordings[camera_id], rate)
            found[camera_id] = (offset_s, 1.0)
    return corrected, found


def _stretched(recording: Recording, rate: float) -> Recording:
    """The same frames, `rate` times as far apart."""
    tracks = tuple(t if t.time_s is None else replace(t, time_s=rate * t.time_s) for t in recording.tracks)
    return replace(recording, frame_rate_hz=recording.frame_rate_hz / rate, tracks=tracks)
