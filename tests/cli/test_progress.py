"""Stages on stderr: one after the other, with counts, as lines or as bars."""

from __future__ import annotations

import io
import time

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TextColumn

from skytrace.cli.progress import STAGES, Bars, Lines, StageClock

from .command import STAGE_LINE


class Recorder:
    """A display that writes down what it is told."""

    def __init__(self) -> None:
        self.told: list[str] = []

    def open(self, name: str, began_s: float) -> None:
        assert 0 <= time.monotonic() - began_s < 5
        self.told.append(name)

    def count(self, done: int, total: int) -> None:
        self.told.append(f"{done}/{total}")

    def close(self) -> None:
        self.told.append("end")


def feed(clock: StageClock) -> None:
    clock.update("read", 4, 4)
    clock.update("clean", 4, 4)
    for done in (0, 3, 6):
        clock.update("synchronise", done, 6)
    clock.update("synchronise", 1, 1)
    clock.update("initialise", 1, 1)
    for done in (2, 3):
        clock.update("grow", done, 4)
    clock.update("adjust", 1, 2)


def test_stages_follow_each_other() -> None:
    display = Recorder()
    clock = StageClock(display)
    assert display.told == []  # a flight that cannot be read shows its error and nothing else
    feed(clock)
    expected = "read 4/4 end clean 4/4 end synchronise 0/6 3/6 6/6 end initialise 1/1 end grow 2/4 3/4 end adjust 1/2"
    assert display.told == expected.split()
    clock.close()
    clock.close()
    assert display.told == [*expected.split(), "end"]


def test_cpu_time_is_booked_on_the_stage_that_used_it() -> None:
    clock = StageClock(Recorder())
    begin = time.process_time()
    while time.process_time() < begin + 0.05:
        pass
    clock.update("synchronise", 1, 2)
    clock.update("initialise", 1, 1)
    while time.process_time() < begin + 0.1:
        pass
    clock.update("synchronise", 2, 2)
    assert set(clock.timings_s) == {"synchronise", "initialise"}
    assert 0.09 < clock.timings_s["synchronise"] < 0.2
    assert clock.timings_s["initialise"] < 0.04


def test_lines() -> None:
    stream = io.StringIO()
    clock = StageClock(Lines(stream))
    feed(clock)
    *ended, running = stream.getvalue().split("\n")
    assert all(STAGE_LINE.fullmatch(line) for line in ended)
    assert [line.split()[:2] for line in ended][-1] == ["grow", "3/4"]
    assert running.strip() == "adjust"  # its name stands there while it runs
    clock.close()
    assert STAGE_LINE.fullmatch(stream.getvalue().split("\n")[-2])


def test_bars() -> None:
    stream = io.StringIO()
    columns = (TextColumn("{task.description}"), MofNCompleteColumn())
    with Progress(*columns, console=Console(file=stream, width=80), get_time=time.monotonic) as progress:
        clock = StageClock(Bars(progress))
        feed(clock)
        clock.close()
        assert all((task.elapsed or 0) >= 0 for task in progress.tasks)
        assert [t.description for t in progress.tasks] == list(STAGES[:6])
    shown = [line.split() for line in stream.getvalue().splitlines()]
    assert ["synchronise", "6/6"] in shown
    assert ["grow", "3/4"] in shown
