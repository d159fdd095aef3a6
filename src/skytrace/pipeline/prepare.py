"""From what was measured to what is estimated on: every camera's detections cleaned, and what was dropped counted."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from skytrace.estimation.clean import CleanSettings, CleanTracks, clean_detections
from skytrace.io.flight import Flight, FlightCamera
from skytrace.model.track import Recording


@dataclass(frozen=True, eq=False, slots=True)
class Prepared:
    """Cleaned recordings in the order given, and per camera how many detections came in and were dropped for what."""

    recordings: tuple[Recording, ...]
    n_detections: Mapping[str, int]
    dropped: Mapping[str, Mapping[str, int]]


def prepare_flight(flight: Flight, settings: CleanSettings) -> Prepared:
    """Clean the detections of a FLIGHT."""
    return _collect((_from_file(camera, settings), len(camera.detections)) for camera in flight.cameras)


def prepare_recordings(recordings: Iterable[Recording], settings: CleanSettings) -> Prepared:
    """Clean recordings made in memory: the tracks of each are taken as one stream of detections."""
    return _collect((_from_tracks(recording, settings), recording.n_detections) for recording in recordings)


def _from_file(camera: FlightCamera, settings: CleanSettings) -> tuple[Recording, CleanTracks]:
    raw = camera.detections
    clean = clean_detections(
        raw.frame, raw.xy_px, camera.frame_rate_hz, camera.intrinsics.size_px, settings, raw.sigma_px, raw.time_s
    )
    return Recording(camera.camera_id, camera.intrinsics, camera.frame_rate_hz, clean.tracklets), clean


def _from_tracks(recording: Recording, settings: CleanSettings) -> tuple[Recording, CleanTracks]:
    tracks = [t for t in recording.tracks if len(t)]
    if not tracks:
        return replace(recording, tracks=()), CleanTracks((), {})

    def joined(name: str) -> Any:
        parts = [getattr(t, name) for t in tracks]
        return None if any(p is None for p in parts) else np.concatenate(parts)

    clean = clean_detections(
        joined("frame"),
        joined("xy_px"),
        recording.frame_rate_hz,
        recording.intrinsics.size_px,
        settings,
        joined("sigma_px"),
        joined("time_s"),
    )
    return replace(recording, tracks=clean.tracklets), clean


def _collect(cleaned: Iterable[tuple[tuple[Recording, CleanTracks], int]]) -> Prepared:
    rows = list(cleaned)
    return Prepared(
        tuple(recording for (recording, _), _ in rows),
        {recording.camera_id: n for (recording, _), n in rows},
        {recording.camera_id: dict(clean.dropped) for (recording, clean), _ in rows},
    )
