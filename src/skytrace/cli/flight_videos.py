"""Flights whose cameras name videos: what flies in them is found before anything else is done."""

from __future__ import annotations

from pathlib import Path

from skytrace.io.flight import read_videos


def find_tracks(flight: Path) -> dict[str, Path]:
    """The TRACKS files of those cameras of a FLIGHT that name a video; detects what was not detected before."""
    videos = read_videos(flight)
    if not videos:
        return {}
    from skytrace.cli.frame_progress import detect_with_progress
    from skytrace.pipeline.videos import flight_jobs

    jobs = flight_jobs(videos, flight if flight.is_dir() else flight.absolute().parent)
    detect_with_progress(jobs)
    return {job.name: job.tracks for job in jobs}
