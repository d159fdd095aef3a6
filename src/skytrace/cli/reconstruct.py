"""`skytrace reconstruct`: from a FLIGHT to a RUN."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import tomli_w

from skytrace.cli.progress import StageClock, stages
from skytrace.estimation.adjust.settings import Freedom
from skytrace.estimation.priors import PriorKind
from skytrace.io.atomic import check_replaceable
from skytrace.io.flight import Flight, read_flight
from skytrace.io.run_folder import input_hashes, write_run
from skytrace.pipeline.config import Config
from skytrace.pipeline.offline import Outcome
from skytrace.report import render_report

_VERSIONED = ("skytrace", "numpy", "scipy", "numba", "poselib")


def reconstruct_command(
    flight: Path,
    output: Path,
    motion_prior: PriorKind,
    rolling_shutter: bool,
    free_lens: bool,
    seed: int,
    as_json: bool,
) -> None:
    """Read, reconstruct, write, print."""
    config = make_config(motion_prior, rolling_shutter, free_lens, seed)
    check_replaceable(output)
    summary = reconstruct_flight(read_flight(flight), output, config)
    print(json.dumps(summary) if as_json else describe(summary, output))


def make_config(motion_prior: PriorKind, rolling_shutter: bool, free_lens: bool, seed: int) -> Config:
    """The default configuration with the command line's options."""
    default = Config()
    return replace(
        default,
        seed=seed,
        adjust=replace(default.adjust, motion_prior=motion_prior),
        freedom=Freedom(rolling_shutter, focal=free_lens, lens=free_lens),
    )


def reconstruct_flight(flight: Flight, output: Path, config: Config) -> dict[str, Any]:
    """Reconstruct a flight, write the RUN folder and return its summary."""
    from skytrace.pipeline.prepare import prepare_flight
    from skytrace.pipeline.summary import summarise

    with stages() as clock:
        clock.update("read", 1, 1)
        prepared = prepare_flight(flight, config.clean)
        clock.update("clean", 1, 1)
        hints_s = {c.camera_id: c.offset_s for c in flight.cameras if c.offset_s is not None}
        outcome = _run(prepared.recordings, config, hints_s, clock)
        summary = summarise(outcome, prepared, clock.timings_s)
        manifest = {"versions": versions(), "seed": config.seed, "inputs": input_hashes(flight.input_files)}
        settings = _without_none(config.as_dict())
        report = render_report(
            outcome.reconstruction, summary, name=flight.name, versions=manifest["versions"], settings=settings
        )
        write_run(output, outcome.reconstruction, summary, tomli_w.dumps(settings), manifest, report)
        clock.update("write", 1, 1)
    return summary


def _run(recordings, config: Config, hints_s: Mapping[str, float], clock: StageClock) -> Outcome:
    from skytrace.pipeline.offline import run

    stage = None
    for stage in run(recordings, config, hints_s=hints_s, progress=clock.update):
        clock.update(stage.name, stage.done, stage.total)
    assert stage is not None  # run yields at least one stage or raises
    return stage.product


def versions() -> dict[str, str]:
    """Versions of what computed a run."""
    return {"python": platform.python_version(), **{name: version(name) for name in _VERSIONED}}


def describe(summary: Mapping[str, Any], output: Path) -> str:
    """A run in a few lines for people."""
    lines = [
        f"covered      {summary['covered_s']:.1f} s in {len(summary['segments'])} segments",
        f"gauge        {summary['gauge']} (times on the clock of {summary['reference']})",
        f"{'camera':<12} {'used':>8} {'median px':>10} {'frames/s':>10}",
    ]
    for camera_id, camera in summary["cameras"].items():
        if camera["registered"]:
            lines.append(
                f"{camera_id:<12} {camera['n_used']:>8} {camera['reprojection_median_px']:>10.2f} "
                f"{camera['frame_rate_found_hz']:>10.4f}"
            )
        else:
            lines.append(f"{camera_id:<12} left out: {camera['reason']}")
    lines += [f"warning      {text}" for text in summary["warnings"]]
    lines.append(f"written to   {output} (open {output / 'report.html'})")
    return "\n".join(lines)


def _without_none(value: Any) -> Any:
    """TOML has no null: settings that are None are left out."""
    if isinstance(value, Mapping):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    return value
