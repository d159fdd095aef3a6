"""`skytrace detect`: what moves through videos, as TRACKS."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from skytrace.cli.frame_progress import detect_with_progress
from skytrace.errors import InputError
from skytrace.io.atomic import check_file
from skytrace.io.run_folder import json_text
from skytrace.io.tracks import read_about
from skytrace.io.video import open_video
from skytrace.pipeline.detect import check_mask, read_mask
from skytrace.pipeline.videos import VideoJob, job_key
from skytrace.vision.follow import Method

_PREVIEWS = (".png", ".mp4")


def detect_command(
    videos: Sequence[Path], output: Path, method: Method, mask: Path | None, preview: Path | None, as_json: bool
) -> None:
    """Decode, detect, track, write, print."""
    jobs = plan(videos, output, method, mask, preview)
    found_before = [job for job in jobs if job.done]
    detect_with_progress(jobs)
    abouts = [read_about(job.tracks) for job in jobs]
    for job, about in zip(jobs, abouts, strict=True):
        for message in about["warnings"]:
            print(f"skytrace: warning: {job.video}: {message}", file=sys.stderr)
    if as_json:
        print(json_text(abouts, ascii_only=True))
    else:
        lines = (describe(about, job, job in found_before) for job, about in zip(jobs, abouts, strict=True))
        print("\n\n".join(lines))


def plan(
    videos: Sequence[Path],
    output: Path,
    method: Method = "tophat",
    mask: Path | None = None,
    preview: Path | None = None,
) -> list[VideoJob]:
    """The jobs of a command line, with everything checked that can be before any work is done."""
    in_folders = len(videos) > 1 or output.is_dir()
    names = [video.stem for video in videos] if in_folders else [videos[0].name]
    for name in names:
        if names.count(name) > 1:
            raise InputError(output, f"two of the videos are called {name!r}: their tracks would overwrite each other")
    if preview is not None and not in_folders and preview.suffix.lower() not in _PREVIEWS:
        raise InputError(preview, "expected a name that ends in .png for a contact sheet or in .mp4 for a video")
    shown = None if mask is None else read_mask(mask)
    jobs = []
    for name, video in zip(names, videos, strict=True):
        info = open_video(video)
        if shown is not None:
            check_mask(shown, info.size_px)
        tracks = output / f"{name}.csv" if in_folders else output
        picture = preview / f"{name}.png" if in_folders and preview is not None else preview
        for path in (tracks, picture):
            if path is not None:
                _check_output(path, videos)
        if picture is not None and picture.resolve() == tracks.resolve():
            raise InputError(picture, "is also the file for the tracks: give the preview a name of its own")
        jobs.append(VideoJob(name, video, tracks, job_key(video, method, mask), method, mask, picture))
    return jobs


def _check_output(path: Path, videos: Sequence[Path]) -> None:
    check_file(path)
    if path.exists() and any(path.samefile(video) for video in videos):
        raise InputError(path, "is the video itself: choose another file to write")


def describe(about: Mapping[str, Any], job: VideoJob, found_before: bool) -> str:
    """What was found in a video, in a few lines for people."""
    length_s = about["end_s"] - about["begin_s"]
    lines = [
        f"{job.video.name}",
        f"read         {about['frames']} frames, {length_s:.1f} s{' (found before)' if found_before else ''}",
        f"target       seen in {about['on_target']} of them",
    ]
    if about["tracks"]:
        head = f"{'track':<7} {'target':<7} {'from s':>9} {'to s':>9} {'detections':>11} {'quality':>8} {'size px':>8}"
        lines.append(head)
    for t in about["tracks"]:
        lines.append(
            f"{t['id']:<7} {'yes' if t['target'] else '':<7} {t['begin_s']:>9.3f} {t['end_s']:>9.3f} "
            f"{t['detections']:>11} {t['quality']:>8.2f} {t['size_px']:>8.1f}"
        )
    lines.append(f"written to   {job.tracks}")
    if job.preview is not None:
        lines.append(f"pictures in  {job.preview}")
    return "\n".join(lines)
