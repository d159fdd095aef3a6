"""`skytrace reconstruct` of several flights: each by itself, then together where the same devices filmed them."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from skytrace.api import versions
from skytrace.cli.flight_videos import find_tracks
from skytrace.cli.progress import STAGES, Display, StageClock, shown
from skytrace.cli.reconstruct import (
    Given,
    clean,
    describe,
    read_described,
    reconstruct,
    summary_of,
    write_outcome,
)
from skytrace.errors import InputError, ReconstructionError
from skytrace.io.flight import Flight
from skytrace.io.flights_folder import folder_name, write_flights
from skytrace.io.run_folder import MANIFEST, SUMMARY, json_text
from skytrace.pipeline.config import Config
from skytrace.pipeline.joint import Joint, join
from skytrace.pipeline.joint_summary import joint_summary, shared_of_flight
from skytrace.pipeline.offline import Outcome

_READ, _SOLVE, _END = STAGES[:1], STAGES[1:-1], ("share", "write")


def reconstruct_flights(paths: Sequence[Path], output: Path, config: Config, as_json: bool) -> None:
    """Read all flights, reconstruct each, let them share their devices, write, print.

    A flight that cannot be reconstructed does not keep the others from it: they are written, and then its
    ReconstructionError is raised. Raises InputError, before anything is reconstructed, where an input is wrong.
    """
    _check_given_once(paths)
    tracks = [find_tracks(path) for path in paths]
    timings: dict[str, dict[str, float]] = {}
    with shown() as display:
        flights = _read(paths, tracks, config, display)
        given, outcomes, failures = _reconstruct_each(flights, config, display, timings)
        if not outcomes:
            raise _failed(failures)
        clock = StageClock(display, _END)
        devices = {f: {c.camera_id: c.device for c in given[f].flight.cameras if c.device} for f in outcomes}
        joint = join(outcomes, devices, config, lambda done, total: clock.update("share", done, total))
        summaries = {f: _summary(f, given[f], joint, timings[f]) for f in outcomes}
        summary = joint_summary(joint, summaries, {f: str(e) for f, e in failures.items()}, clock.timings_s)
        runs = {
            folder_name(f): partial(
                write_outcome, given=given[f], outcome=joint.outcomes[f], summary=summaries[f], config=config
            )
            for f in outcomes
        }
        write_flights(output, runs, summary, {"versions": versions(), "seed": config.seed, "flights": list(runs)})
        clock.update("write", 1, 1)
    print(json_text(summary, ascii_only=True) if as_json else _describe(summary, summaries, output))
    if failures:
        raise _failed(failures)


def _check_given_once(paths: Sequence[Path]) -> None:
    seen: dict[str, Path] = {}
    for path in paths:
        real = os.path.realpath(path.parent if path.is_file() else path)
        if real in seen:
            raise InputError(path, f"is the flight given as {seen[real]} already; give each flight once")
        seen[real] = path


def _read(
    paths: Sequence[Path], tracks: Sequence[Mapping[str, Path]], config: Config, display: Display
) -> dict[str, Flight]:
    """The flights by name."""
    flights: dict[str, Flight] = {}
    taken = {SUMMARY: "", MANIFEST: ""}
    for path, found in zip(paths, tracks, strict=True):
        flight = read_described(path, found, config, StageClock(display, _READ, f"{path.name}: "))
        folder = folder_name(flight.name).casefold()
        if folder in taken:
            other = f"that of {taken[folder]}" if taken[folder] else "a file of the run"
            message = f'name = "{flight.name}" gives the run the same folder as {other}: give the flight another name'
            raise InputError(flight.path, message)
        taken[folder] = str(flight.path)
        flights[flight.name] = flight
    return flights


def _reconstruct_each(
    flights: Mapping[str, Flight], config: Config, display: Display, timings: dict[str, dict[str, float]]
) -> tuple[dict[str, Given], dict[str, Outcome], dict[str, ReconstructionError]]:
    given: dict[str, Given] = {}
    outcomes: dict[str, Outcome] = {}
    failures: dict[str, ReconstructionError] = {}
    for name, flight in flights.items():
        clock = StageClock(display, _SOLVE, f"{name}: ")
        try:
            given[name] = Given(flight, clean(flight, config, clock))
            outcomes[name] = reconstruct(given[name], config, clock)
        except ReconstructionError as error:
            failures[name] = error
        finally:
            clock.close()
        timings[name] = clock.timings_s
    return given, outcomes, failures


def _summary(flight: str, given: Given, joint: Joint, timings_s: Mapping[str, float]) -> dict[str, Any]:
    shared, warnings = shared_of_flight(joint, flight)
    summary = summary_of(given, joint.outcomes[flight], timings_s)
    return {**summary, "warnings": [*summary["warnings"], *warnings], "shared_devices": shared}


def _failed(failures: Mapping[str, ReconstructionError]) -> ReconstructionError:
    """One error of all flights that failed."""
    (first, error), *others = failures.items()
    text = "; ".join([str(error), *(f"{name}: {other}" for name, other in others)])
    return ReconstructionError(first, text)


def _describe(summary: Mapping[str, Any], summaries: Mapping[str, Mapping[str, Any]], output: Path) -> str:
    """All runs in a few lines for people."""
    blocks = [f"{name}\n{describe(own, output / folder_name(name))}" for name, own in summaries.items()]
    lines = []
    for device in summary["devices"]:
        where = ", ".join(f"{camera_id} of {flight}" for flight, camera_id in device["cameras"].items())
        lines.append(f"device       {device['name']}: {where}")
        focal = device["parameters"].get("focal_scale")
        if focal is not None:
            alone = ", ".join(f"{f} {_percent(e)}" for f, e in focal["alone"].items())
            lines.append(f"  focal length against its calibration: together {_percent(focal['joint'])}; alone {alone}")
        elif not device["parameters"]:
            lines.append("  nothing is shared")
    lines += [f"warning      {text}" for text in summary["warnings"]]
    lines.append(f"written to   {output}")
    return "\n\n".join([*blocks, "\n".join(lines)])


def _percent(estimate: Mapping[str, float]) -> str:
    return f"{100 * estimate['value']:+.2f} +- {100 * estimate['sd']:.2f} %"
