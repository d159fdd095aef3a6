"""Videos turned into TRACKS: several at once, and none twice."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from skytrace.errors import InputError
from skytrace.io.atomic import atomic_file
from skytrace.io.run_folder import input_hashes
from skytrace.io.tracks import read_about, tracks_text
from skytrace.io.video import Frame
from skytrace.pipeline.detect import detect_video, detector_identity, read_mask
from skytrace.vision.follow import Method

FLIGHT_TRACKS = ".skytrace-tracks"  # folder of a flight

_MOST_THREADS = 4
_TELL_EVERY_S = 0.2
_POLL_S = 0.2

# Told of a job's name, how many of its frames are done, and whether that is all.
OnFrames = Callable[[str, int, bool], None]


@dataclass(frozen=True, slots=True)
class VideoJob:
    """One video and the files its tracks and pictures belong in."""

    name: str
    video: Path
    tracks: Path
    key: str  # of everything that decides what is found: the video's content, the detector, its settings, the mask
    method: Method = "tophat"
    mask: Path | None = None
    preview: Path | None = None  # contact sheet (.png) or video (.mp4)

    @property
    def done(self) -> bool:
        """Whether what would be found is there."""
        if not self.tracks.is_file() or not (self.preview is None or self.preview.is_file()):
            return False
        try:
            return read_about(self.tracks).get("key") == self.key
        except InputError:
            return False


def job_key(video: Path, method: Method = "tophat", mask: Path | None = None) -> str:
    """What tells whether tracks found before are still right, as 24 hexadecimal digits."""
    files = [video] if mask is None else [video, mask]
    contents = " ".join(input_hashes([path])[str(path)] for path in files)
    return hashlib.sha256(f"{contents} {detector_identity(method)}".encode()).hexdigest()[:24]


def flight_jobs(videos: Mapping[str, Path], flight_folder: Path) -> list[VideoJob]:
    """The jobs of a flight's videos by camera id; tracks are kept in the flight's folder, or in the user's cache.

    What was found in a video once is found again there, whichever camera or flight asks for it.
    """
    folder = _tracks_folder(flight_folder)
    keys = {camera_id: job_key(video) for camera_id, video in videos.items()}
    return [VideoJob(name, video, folder / f"{keys[name]}.csv", keys[name]) for name, video in videos.items()]


def detect_jobs(jobs: Iterable[VideoJob], on_frames: OnFrames) -> None:
    """Detect what is not done yet, as many videos at once as there are cores.

    Finished videos stay finished when another one fails or the user interrupts. Raises InputError of the first video
    that cannot be read.
    """
    open_jobs = list({job.tracks: job for job in jobs if not job.done}.values())
    cores = os.cpu_count() or 1
    if len(open_jobs) > 1 and cores > 1:
        _detect_in_parallel(open_jobs, min(cores, len(open_jobs)), on_frames)
        return
    for job in open_jobs:
        detect_to_file(job, min(cores, _MOST_THREADS), on_frames)


def detect_to_file(job: VideoJob, frame_threads: int, on_frames: OnFrames) -> None:
    """Write a video's tracks and pictures, each in one step."""
    sampler = None
    if job.preview is not None and job.preview.suffix.lower() == ".png":
        from skytrace.vision.preview import Sampler

        sampler = Sampler()

    def on_frame(frame: Frame) -> None:
        if sampler is not None:
            sampler.add(frame.index, frame.time_s, frame.luma)
        on_frames(job.name, frame.index + 1, False)

    mask = None if job.mask is None else read_mask(job.mask)
    detected = detect_video(job.video, job.method, mask, on_frame, frame_threads)
    on_frames(job.name, detected.n_frames, True)
    if job.preview is not None:
        from skytrace.pipeline.preview import write_overlay, write_sheet

        with atomic_file(job.preview) as partial:
            if sampler is not None:
                write_sheet(partial, detected, sampler.samples())
            else:
                write_overlay(
                    partial, detected, lambda done, all_done: on_frames(f"{job.name} preview", done, all_done)
                )
    with atomic_file(job.tracks) as partial:
        about = {**detected.about(), "key": job.key}
        partial.write_text(tracks_text(detected.rows(), about), encoding="utf-8")


def _detect_in_parallel(jobs: list[VideoJob], workers: int, on_frames: OnFrames) -> None:
    context = multiprocessing.get_context("spawn")
    threads = max(1, (os.cpu_count() or 1) // workers)
    waiting, running = list(jobs), dict[Connection, tuple[VideoJob, BaseProcess]]()
    try:
        while waiting or running:
            while waiting and len(running) < workers:
                job = waiting.pop(0)
                ours, theirs = context.Pipe(duplex=False)
                process = context.Process(target=_worker, args=(job, threads, theirs), daemon=True)
                with _interrupts_held():
                    process.start()
                theirs.close()
                running[ours] = (job, process)
            for connection in wait(list(running), timeout=_POLL_S):
                assert isinstance(connection, Connection)
                job, process = running[connection]
                if _take_message(connection, job, process, on_frames):
                    process.join()
                    connection.close()
                    del running[connection]
    finally:
        for _, process in running.values():
            process.terminate()
        for _, process in running.values():
            process.join()


def _take_message(connection: Connection, job: VideoJob, process: BaseProcess, on_frames: OnFrames) -> bool:
    """Hear what a worker has to tell; whether it is finished."""
    try:
        kind, *content = connection.recv()
    except EOFError:
        process.join()
        message = f"the process that looked at it ended unexpectedly (exit code {process.exitcode})"
        raise InputError(job.video, message) from None
    if kind == "error":
        path, message, line = content
        raise InputError(path, message, line=line)
    if kind == "frames":
        on_frames(*content)
    return kind == "finished"


def _worker(job: VideoJob, threads: int, connection: Connection) -> None:
    # Ctrl-C reaches the parent, too, which ends its workers; they then clear up.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _stop)
    told_s = 0.0

    def on_frames(name: str, done: int, all_done: bool) -> None:
        nonlocal told_s
        now_s = time.monotonic()
        if all_done or now_s - told_s >= _TELL_EVERY_S:
            told_s = now_s
            connection.send(("frames", name, done, all_done))

    try:
        detect_to_file(job, threads, on_frames)
        connection.send(("finished",))
    except InputError as error:
        connection.send(("error", error.path, error.message, error.line))


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Ctrl-C waits; what is started meanwhile never hears it, not even while it still imports."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _stop(number: int, frame: Any) -> None:
    sys.exit(128 + number)


def _tracks_folder(flight_folder: Path) -> Path:
    """A folder that can be written to; the user's cache where the flight's own may not be changed."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "skytrace" / "tracks"
    for folder in (flight_folder / FLIGHT_TRACKS, cache):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return folder
    raise InputError(flight_folder, f"cannot be written to, and neither can {cache}: tracks need a place")
