"""`skytrace reconstruct`: from a FLIGHT to a RUN."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import tomli_w

from skytrace.cli.progress import StageClock, stages
from skytrace.errors import ReconstructionError
from skytrace.estimation.adjust.settings import Freedom
from skytrace.estimation.hints import Hints
from skytrace.estimation.priors import PriorKind
from skytrace.estimation.sync_settings import SyncMethod
from skytrace.io.atomic import check_replaceable
from skytrace.io.flight import Flight, read_flight
from skytrace.io.run_folder import input_hashes, json_text, write_run
from skytrace.pipeline.config import Config
from skytrace.pipeline.flight_hints import flight_hints
from skytrace.pipeline.offline import Outcome, run
from skytrace.pipeline.prepare import Prepared, prepare_flight
from skytrace.pipeline.rough_offsets import require_offsets
from skytrace.pipeline.summary import summarise
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
    method: SyncMethod = "exhaustive",
) -> None:
    """Read, reconstruct, write, print."""
    config = make_config(motion_prior, rolling_shutter, free_lens, seed, method)
    check_replaceable(output)
    summary = reconstruct_flight(flight, output, config)
    print(json_text(summary, ascii_only=True) if as_json else describe(summary, output))


def make_config(
    motion_prior: PriorKind, rolling_shutter: bool, free_lens: bool, seed: int, method: SyncMethod = "exhaustive"
) -> Config:
    """The default configuration with the command line's options."""
    default = Config()
    return replace(
        default,
        seed=seed,
        synchronise=replace(default.synchronise, method=method),
        adjust=replace(default.adjust, motion_prior=motion_prior),
        freedom=Freedom(rolling_shutter, focal=free_lens, lens=free_lens),
    )


def reconstruct_flight(path: Path, output: Path, config: Config) -> dict[str, Any]:
    """Reconstruct the FLIGHT at `path`, write the RUN folder and return its summary."""
    with stages() as clock:
        flight = read_flight(path)
        require_offsets(flight, config.synchronise.method)
        n = len(flight.cameras)
        clock.update("read", n, n)
        prepared = prepare_flight(flight, config.clean)
        _require_detections(prepared)
        clock.update("clean", n, n)
        outcome = _run(prepared.recordings, config, flight_hints(flight), clock)
        summary = summarise(outcome, prepared, clock.timings_s)
        summary["warnings"] = [*flight.warnings, *summary["warnings"], *unused_keys(flight)]
        manifest = {"versions": versions(), "seed": config.seed, "inputs": input_hashes(flight.input_files)}
        settings = _without_none(config.as_dict())
        report = render_report(
            outcome.reconstruction, summary, name=flight.name, versions=manifest["versions"], settings=settings
        )
        write_run(output, outcome.reconstruction, summary, tomli_w.dumps(settings), manifest, report)
        clock.update("write", 1, 1)
    return summary


def _require_detections(prepared: Prepared) -> None:
    """Say what became of the detections where too few are left to begin."""
    usable = [r.camera_id for r in prepared.recordings if r.n_detections]
    if len(usable) >= 2:
        return
    counts: dict[str, float] = {}
    for camera_id, dropped in prepared.dropped.items():
        counts |= {f"{camera_id} detections": prepared.n_detections[camera_id]}
        counts |= {f"{camera_id} dropped as {why}": n for why, n in dropped.items() if n}
    raise ReconstructionError(
        "clean",
        "fewer than two cameras have usable detections",
        counts=counts,
        hint="Check the image sizes in the calibrations and the columns of the detections",
    )


def _run(recordings, config: Config, hints: Hints, clock: StageClock) -> Outcome:
    stage = None
    for stage in run(recordings, config, hints=hints, progress=clock.update):
        clock.update(stage.name, stage.done, stage.total)
    assert stage is not None  # run yields at least one stage or raises
    return stage.product


def unused_keys(flight: Flight) -> list[str]:
    """What the flight gives and the reconstruction does not use, in words."""
    out = []
    for name in ("position_m", "position_wgs84", "readout_s"):
        cameras = [c.camera_id for c in flight.cameras if getattr(c, name) is not None]
        if cameras:
            out.append(f"{name} of {', '.join(cameras)} is not used by the reconstruction yet.")
    return out


def versions() -> dict[str, str]:
    """Versions of what computed a run."""
    return {"python": platform.python_version(), **{name: version(name) for name in _VERSIONED}}


def describe(summary: Mapping[str, Any], output: Path) -> str:
    """A run in a few lines for people."""
    n, arbitrary = len(summary["segments"]), summary["gauge"] == "arbitrary"
    width = max(12, *map(len, summary["cameras"]))
    lines = [
        f"covered      {summary['covered_s']:.1f} s in {n} segment{'' if n == 1 else 's'}",
        f"lengths      in {'an arbitrary unit' if arbitrary else 'metres'}",
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


def _without_none(value: Any) -> Any:
    """TOML has no null: settings that are None are left out."""
    if isinstance(value, Mapping):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    return value
