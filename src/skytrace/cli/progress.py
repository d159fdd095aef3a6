"""Progress on stderr: one bar a stage, with its name, counts and time."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager


class StageClock:
    """Shows each stage as a bar and keeps how long it took."""

    def __init__(self, bars) -> None:
        self._bars = bars
        self._tasks: dict[str, object] = {}
        self._last = time.process_time()
        self.timings_s: dict[str, float] = {}

    def update(self, name: str, done: int, total: int) -> None:
        """A stage is at `done` of `total`; CPU time since the last call is booked on it."""
        now = time.process_time()
        self.timings_s[name] = self.timings_s.get(name, 0.0) + now - self._last
        self._last = now
        if name not in self._tasks:
            self._tasks[name] = self._bars.add_task(name, total=total)
        self._bars.update(self._tasks[name], completed=done, total=total)


@contextmanager
def stages() -> Iterator[StageClock]:
    """A clock whose bars live on stderr; where stderr is no terminal only the finished bars are printed."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description:<12}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(file=sys.stderr), transient=False) as bars:
        yield StageClock(bars)
