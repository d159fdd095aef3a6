"""`skytrace sync`: when each camera of a FLIGHT filmed, as a JSON file, without any reconstruction."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from skytrace.cli.files import write_text
from skytrace.cli.flight_videos import find_tracks
from skytrace.errors import InputError, ReconstructionError
from skytrace.estimation.correspond import ImagePath, image_path
from skytrace.estimation.hints import Hints
from skytrace.estimation.sync_curves import sync_curves
from skytrace.estimation.sync_settings import SyncMethod
from skytrace.estimation.synchronize import Synchronisation, synchronize, weigh_offsets
from skytrace.io.flight import read_flight
from skytrace.pipeline.config import Config
from skytrace.pipeline.flight_hints import flight_hints
from skytrace.pipeline.prepare import prepare_flight
from skytrace.pipeline.rough_offsets import require_offsets
from skytrace.pipeline.sync_document import as_document
from skytrace.report import render_sync_report


def sync_command(
    flight: Path,
    output: Path,
    seed: int,
    as_json: bool,
    report: Path | None = None,
    method: SyncMethod = "exhaustive",
) -> None:
    """Read, synchronise, write, print. The report is written even where there is no solution: it shows why."""
    check_outputs(output, report)
    default = Config(seed=seed)
    config = replace(default, synchronise=replace(default.synchronise, method=method))
    given = read_flight(flight, find_tracks(flight))
    require_offsets(given, method)
    recordings = {r.camera_id: r for r in prepare_flight(given, config.clean).recordings}
    paths = {c: image_path(r, config.adjust.readout_fraction) for c, r in recordings.items() if r.n_detections}
    try:
        found, failure = _synchronised(paths, len(recordings), config, flight_hints(given)), None
    except ReconstructionError as error:
        if report is None:
            raise
        found, failure = _unsolved(paths, list(recordings), config, flight_hints(given)), error
    document = as_document(found, [c.camera_id for c in given.cameras])
    document["warnings"] = [*given.warnings, *document["warnings"]]
    if report is not None:
        curves = sync_curves(paths, found, config.synchronise)
        page = render_sync_report(document, curves, recordings, config.synchronise, name=given.name, failure=failure)
        write_text(report, page)
    if failure is not None:
        raise _with_page(failure, report)
    write_text(output, json.dumps(document, indent=1) + "\n")
    print(json.dumps(document) if as_json else describe(document, output, report))


def check_outputs(output: Path, report: Path | None) -> None:
    """Raise InputError where the files to write are folders, or one and the same."""
    for path in (output, report):
        if path is not None and path.is_dir():
            raise InputError(path, "expected a file to write, got a folder")
    if report is not None and report.resolve() == output.resolve():
        raise InputError(report, "is also the file for the JSON: give the report a name of its own")


def _synchronised(paths: Mapping[str, ImagePath], n_cameras: int, config: Config, hints: Hints) -> Synchronisation:
    if len(paths) < 2:
        counts = {"cameras given": n_cameras, "with detections": len(paths)}
        raise ReconstructionError("synchronise", "fewer than two cameras have usable detections", counts=counts)
    return synchronize(paths, config.synchronise, np.random.default_rng(config.seed), hints)


def _unsolved(
    paths: Mapping[str, ImagePath], camera_ids: Sequence[str], config: Config, hints: Hints
) -> Synchronisation:
    """The evidence where nothing can be tied together."""
    if len(paths) < 2:
        return Synchronisation(
            camera_ids[0], {}, (), np.zeros(0), dict.fromkeys(paths, "there is no other to tie it to")
        )
    return weigh_offsets(paths, config.synchronise, np.random.default_rng(config.seed), hints)


def _with_page(failure: ReconstructionError, report: Path | None) -> ReconstructionError:
    """The failure, saying where to look."""
    hint = ". ".join(text for text in (failure.hint, f"{report} shows what the tracks say") if text)
    return ReconstructionError(
        failure.stage,
        failure.reason,
        camera=failure.camera,
        counts=failure.counts,
        threshold=failure.threshold,
        hint=hint,
    )


def describe(document: dict[str, Any], output: Path, report: Path | None = None) -> str:
    """The document in a few lines for people."""
    lines = [f"{'camera':<12} {'offset s':>12} {'sd s':>8} {'rate':>11} {'confidence':>11}"]
    for camera_id, c in document["cameras"].items():
        if "offset_s" in c:
            group = f"  group {c['group'] + 1}" if c["group"] else ""
            lines.append(
                f"{camera_id:<12} {c['offset_s']:>12.4f} {c['offset_sd_s']:>8.4f} {c['rate']:>11.6f} "
                f"{c['confidence']:>11.4f}{group}"
            )
        else:
            lines.append(f"{camera_id:<12} not tied in: {c['reason']}")
    for p in document["pairs"]:
        if p["accepted"] and p["rivals"]:
            rivals = ", ".join(f"{r['offset_s']:.2f}" for r in p["rivals"])
            lines.append(f"ambiguous    {p['camera0']}-{p['camera1']}: also plausible at offsets of {rivals} s")
    lines += [f"warning      {text}" for text in document["warnings"]]
    lines.append(f"written to   {output}")
    if report is not None:
        lines.append(f"report       {report}")
    return "\n".join(lines)
