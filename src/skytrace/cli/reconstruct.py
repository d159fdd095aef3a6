"""`skytrace reconstruct`: from a FLIGHT to a RUN."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import typer

from skytrace import api
from skytrace.cli.flight_videos import find_tracks
from skytrace.cli.progress import StageClock, stages
from skytrace.errors import InputError
from skytrace.estimation.adjust.settings import Freedom
from skytrace.estimation.hints import Hints
from skytrace.estimation.known import Known
from skytrace.estimation.priors import PriorKind
from skytrace.estimation.sync_settings import SyncMethod
from skytrace.io.atomic import check_replaceable
from skytrace.io.flight import Flight, read_flight
from skytrace.io.run_folder import json_text
from skytrace.pipeline.config import Config
from skytrace.pipeline.flight_hints import flight_hints
from skytrace.pipeline.flight_known import flight_known
from skytrace.pipeline.offline import Outcome, run
from skytrace.pipeline.prepare import Prepared, prepare_flight
from skytrace.pipeline.rough_offsets import require_offsets
from skytrace.pipeline.summary import summarise


@dataclass(frozen=True, eq=False, slots=True)
class Given:
    """A FLIGHT as read, and its detections as cleaned."""

    flight: Flight
    prepared: Prepared


@dataclass(frozen=True, slots=True)
class Options:
    """What the command line changes of the default configuration."""

    motion_prior: PriorKind = "jerk"
    motion_prior_weight: float | None = None
    rolling_shutter: bool = True
    fix_focal: bool = False
    fix_lens: bool = False
    min_cameras: int | None = None
    max_sigma_ratio: float | None = None
    method: SyncMethod = "exhaustive"
    seed: int = 0


def reconstruct_command(flights: Sequence[Path], output: Path, options: Options, as_json: bool) -> None:
    """Read, reconstruct, write, print; several flights together."""
    config = make_config(options)
    check_replaceable(output)
    if len(flights) > 1:
        from skytrace.cli.reconstruct_flights import reconstruct_flights

        reconstruct_flights(flights, output, config, as_json)
        return
    summary = reconstruct_flight(flights[0], output, config)
    print(json_text(summary, ascii_only=True) if as_json else describe(summary, output))


def make_config(options: Options) -> Config:
    """The default configuration with the command line's options. Raises typer.BadParameter where they contradict."""
    default, weight = Config(), options.motion_prior_weight
    if weight is not None:
        _check_weight(weight, options.motion_prior)
    ratio = options.max_sigma_ratio
    if ratio is not None and not ratio >= 1:
        raise typer.BadParameter(f"expected a number from 1, got {ratio:g}", param_hint="--max-sigma-ratio")
    coverage = {"min_cameras": options.min_cameras, "max_sigma_ratio": ratio}
    return replace(
        default,
        seed=options.seed,
        synchronise=replace(default.synchronise, method=options.method),
        adjust=replace(default.adjust, motion_prior=options.motion_prior, motion_prior_weight=weight),
        freedom=Freedom(
            options.rolling_shutter, focal=not (options.fix_focal or options.fix_lens), lens=not options.fix_lens
        ),
        coverage=replace(default.coverage, **{k: v for k, v in coverage.items() if v is not None}),
    )


def _check_weight(weight: float, kind: PriorKind) -> None:
    if not (math.isfinite(weight) and weight > 0):
        raise typer.BadParameter(f"expected a number above 0, got {weight:g}", param_hint="--motion-prior-weight")
    if kind == "none":
        raise typer.BadParameter(
            "there is no prior to weigh: leave it away, or choose another --motion-prior",
            param_hint="--motion-prior-weight",
        )


def reconstruct_flight(path: Path, output: Path, config: Config) -> dict[str, Any]:
    """Reconstruct the FLIGHT at `path`, write the RUN folder and return its summary."""
    tracks = find_tracks(path)
    with stages() as clock:
        flight = read_described(path, tracks, config, clock)
        given = Given(flight, clean(flight, config, clock))
        outcome = reconstruct(given, config, clock)
        summary = summary_of(given, outcome, clock.timings_s)
        write_outcome(output, given, outcome, summary, config)
        clock.update("write", 1, 1)
    return summary


def read_described(path: Path, tracks: Mapping[str, Path], config: Config, clock: StageClock) -> Flight:
    """Read a FLIGHT."""
    flight = read_flight(path, tracks)
    require_offsets(flight, config.synchronise.method)
    n, least = len(flight.cameras), config.coverage.min_cameras
    if n < least:
        raise InputError(flight.path, f"the flight has {n} cameras: --min-cameras {least} would cover nothing of it")
    clock.update("read", n, n)
    return flight


def clean(flight: Flight, config: Config, clock: StageClock) -> Prepared:
    """Clean the detections of a FLIGHT. Raises ReconstructionError where too few are left."""
    prepared = prepare_flight(flight, config.clean)
    api.require_detections(prepared)
    n = len(flight.cameras)
    clock.update("clean", n, n)
    return prepared


def reconstruct(given: Given, config: Config, clock: StageClock) -> Outcome:
    """Reconstruct a FLIGHT that was read."""
    return _run(given.prepared.recordings, config, flight_hints(given.flight), flight_known(given.flight), clock)


def summary_of(given: Given, outcome: Outcome, timings_s: Mapping[str, float]) -> dict[str, Any]:
    """The content of summary.json, with what is odd about the FLIGHT's files."""
    summary = summarise(outcome, given.prepared, timings_s)
    summary["warnings"] = [*given.flight.warnings, *summary["warnings"]]
    return summary


def write_outcome(
    destination: Path, given: Given, outcome: Outcome, summary: Mapping[str, Any], config: Config
) -> None:
    """Write the RUN folder of a FLIGHT."""
    flight = given.flight
    api.write_outcome(destination, outcome, summary, config, name=flight.name, inputs=flight.input_files)


def _run(recordings, config: Config, hints: Hints, known: Known | None, clock: StageClock) -> Outcome:
    stage = None
    for stage in run(recordings, config, hints=hints, known=known, progress=clock.update):
        clock.update(stage.name, stage.done, stage.total)
    assert stage is not None  # run yields at least one stage or raises
    return stage.product


def describe(summary: Mapping[str, Any], output: Path) -> str:
    """A run in a few lines for people."""
    n, arbitrary = len(summary["segments"]), summary["gauge"] == "arbitrary"
    width = max(12, *map(len, summary["cameras"]))
    lines = [
        f"covered      {summary['covered_s']:.1f} s in {n} segment{'' if n == 1 else 's'}",
        f"lengths      in {'an arbitrary unit' if arbitrary else 'metres'}",
        *_known_lines(summary),
        f"times        in seconds on the clock of {summary['reference']}",
        f"{'camera':<{width}} {'used':>8} {'median px':>10} {'frames/s':>10}",
    ]
    for camera_id, camera in summary["cameras"].items():
        if camera["registered"]:
            lines.append(
                f"{camera_id:<{width}} {camera['n_used']:>8} {camera['reprojection_median_px']:>10.2f} "
                f"{camera['frame_rate_found_hz']:>10.4f}"
            )
        else:
            lines.append(f"{camera_id:<{width}} left out: {camera['reason']}")
    lines += [f"warning      {text}" for text in summary["warnings"]]
    lines.append(f"written to   {output} (open {output / 'report.html'})")
    return "\n".join(lines)


def _known_lines(summary: Mapping[str, Any]) -> list[str]:
    """How far what was given lies from the result."""
    things = summary.get("known", {}).get("things", {})
    return [
        f"known        {name}: {abs(thing['residual_sd']):.1f} deviations off{'' if thing['used'] else ', not used'}"
        for name, thing in things.items()
    ]
