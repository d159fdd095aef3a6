"""Progress on stderr: every stage with its name, counts and time, as bars on a terminal and as lines elsewhere."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol, TextIO

STAGES = ("read", "clean", "synchronise", "initialise", "grow", "adjust", "cover", "write")


class Display(Protocol):
    """Shows one stage after the other."""

    def open(self, name: str, began_s: float) -> None:
        """A stage is under way since `began_s` (time.monotonic)."""
        ...

    def count(self, done: int, total: int) -> None:
        """The open stage is at `done` of `total`."""
        ...

    def close(self) -> None:
        """The open stage is over."""
        ...


class StageClock:
    """Tells a display which stage is under way and keeps how long each took.

    `names` are the stages it is told of, in their order; `label` stands before each on the display.
    """

    def __init__(self, display: Display, names: Sequence[str] = STAGES, label: str = "") -> None:
        self._display, self._names, self.label = display, tuple(names), label
        self._last_cpu_s = time.process_time()
        self._began_s = time.monotonic()
        self._open: str | None = None
        self._closed: set[str] = set()
        self.timings_s: dict[str, float] = {}

    def update(self, name: str, done: int, total: int) -> None:
        """A stage is at `done` of `total`; CPU time since the last call is booked on it."""
        now = time.process_time()
        self.timings_s[name] = self.timings_s.get(name, 0.0) + now - self._last_cpu_s
        self._last_cpu_s = now
        if name in self._closed:
            return
        if name != self._open:
            self.close()
            self._begin(name)
        self._display.count(done, total)
        if done >= total:
            self.close()
            following = self._names[self._names.index(name) + 1 :]
            if following:
                self._begin(following[0])

    def close(self) -> None:
        """No further update of the open stage comes."""
        if self._open is not None:
            self._display.close()
            self._closed.add(self._open)
            self._open, self._began_s = None, time.monotonic()

    def _begin(self, name: str) -> None:
        self._open = name
        self._display.open(f"{self.label}{name}", self._began_s)


class Lines:
    """A line a stage, its name written when it begins and its counts when it ends."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._began_s = 0.0
        self._counts = ""

    def open(self, name: str, began_s: float) -> None:
        self._began_s, self._counts = began_s, ""
        self._write(f"{name:<12} ")

    def count(self, done: int, total: int) -> None:
        self._counts = f"{done}/{total}"

    def close(self) -> None:
        self._write(f"{self._counts:>7} {time.monotonic() - self._began_s:7.1f} s\n")

    def _write(self, text: str) -> None:
        self._stream.write(text)
        self._stream.flush()


class Bars:
    """A bar a stage."""

    def __init__(self, progress) -> None:
        self._progress = progress
        self._task = None

    def open(self, name: str, began_s: float) -> None:
        self._task = self._progress.add_task(name, total=None)
        self._progress.tasks[-1].start_time = began_s

    def count(self, done: int, total: int) -> None:
        self._progress.update(self._task, completed=done, total=total)

    def close(self) -> None:
        self._progress.stop_task(self._task)


@contextmanager
def stages() -> Iterator[StageClock]:
    """A clock that shows its stages on stderr."""
    with shown() as display:
        clock = StageClock(display)
        try:
            yield clock
        finally:
            clock.close()


@contextmanager
def shown() -> Iterator[Display]:
    """A display on stderr, for work whose stages are not known beforehand."""
    if not sys.stderr.isatty() or os.environ.get("TERM") == "dumb":
        yield Lines(sys.stderr)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description:<12}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(file=sys.stderr), get_time=time.monotonic) as progress:
        yield Bars(progress)
