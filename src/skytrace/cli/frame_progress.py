"""Progress through videos on stderr: frames done, frames a second, time left; several videos at once."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol, TextIO

if TYPE_CHECKING:
    from skytrace.pipeline.videos import VideoJob

_EVERY_S = 5.0  # between lines about one video where no bar can be drawn


class FrameDisplay(Protocol):
    """Shows how far each of several videos is."""

    def count(self, name: str, done: int) -> None:
        """A video is at its frame `done`."""
        ...

    def close(self, name: str, done: int) -> None:
        """A video is finished after `done` frames."""
        ...


class FrameLines:
    """A line now and then, and one when a video is finished."""

    def __init__(self, stream: TextIO, totals: Mapping[str, int | None]) -> None:
        self._stream, self._totals = stream, totals
        self._began_s: dict[str, float] = {}
        self._told_s: dict[str, float] = {}

    def count(self, name: str, done: int) -> None:
        now_s = time.monotonic()
        began_s = self._began_s.setdefault(name, now_s)
        if now_s - self._told_s.setdefault(name, now_s) >= _EVERY_S:
            self._told_s[name] = now_s
            self._write(name, done, now_s - began_s, "")

    def close(self, name: str, done: int) -> None:
        self._write(name, done, time.monotonic() - self._began_s.get(name, time.monotonic()), "done")

    def _write(self, name: str, done: int, spent_s: float, state: str) -> None:
        total = self._totals.get(name)
        rate = done / spent_s if spent_s > 0 else 0.0
        if not state and total is not None and rate > 0:
            state = f"{max(total - done, 0) / rate:.0f} s left"
        of = f"/{total}" if total is not None and state != "done" else ""
        self._stream.write(f"{name:<12} {done}{of} frames {rate:7.1f} a second  {state}\n")
        self._stream.flush()


class FrameBars:
    """A bar a video."""

    def __init__(self, progress, totals: Mapping[str, int | None]) -> None:
        self._progress, self._totals = progress, totals
        self._tasks: dict[str, Any] = {}

    def count(self, name: str, done: int) -> None:
        self._progress.update(self._task(name), completed=done)

    def close(self, name: str, done: int) -> None:
        self._progress.update(self._task(name), completed=done, total=done)
        self._progress.stop_task(self._task(name))

    def _task(self, name: str) -> Any:
        if name not in self._tasks:
            self._tasks[name] = self._progress.add_task(name, total=self._totals.get(name))
        return self._tasks[name]


@contextmanager
def frame_progress(totals: Mapping[str, int | None]) -> Iterator[FrameDisplay]:
    """A display on stderr for videos by name, with about how many frames each has."""
    if not sys.stderr.isatty() or os.environ.get("TERM") == "dumb":
        yield FrameLines(sys.stderr, totals)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn, TimeRemainingColumn
    from rich.text import Text

    class Rate(ProgressColumn):
        def render(self, task) -> Text:
            speed = task.finished_speed or task.speed
            return Text("" if speed is None else f"{speed:.0f} frames/s")

    columns = (
        TextColumn("{task.description:<12}"),
        BarColumn(),
        MofNCompleteColumn(),
        Rate(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(file=sys.stderr), get_time=time.monotonic) as progress:
        yield FrameBars(progress, totals)


def detect_with_progress(jobs: Sequence[VideoJob]) -> None:
    """Detect what is not done yet, and show how far it is."""
    from skytrace.io.video import open_video
    from skytrace.pipeline.detect import expected_frames
    from skytrace.pipeline.videos import detect_jobs

    totals = {job.name: expected_frames(open_video(job.video)) for job in jobs}
    with frame_progress(totals) as display:

        def on_frames(name: str, done: int, all_done: bool) -> None:
            (display.close if all_done else display.count)(name, done)

        detect_jobs(jobs, on_frames)
