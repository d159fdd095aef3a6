"""The Python interface: what `import skytrace` offers beside the types, doing what the command line does."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import Any

from skytrace.errors import ReconstructionError
from skytrace.estimation.hints import Hints
from skytrace.estimation.known import Known
from skytrace.io.flight import Flight
from skytrace.io.georeference import GEOREFERENCE, georeference_text
from skytrace.io.run_folder import input_hashes
from skytrace.io.run_folder import write_run as write_run_files
from skytrace.model.reconstruction import Reconstruction
from skytrace.model.track import Recording
from skytrace.pipeline.config import Config
from skytrace.pipeline.flight_hints import flight_hints
from skytrace.pipeline.flight_known import flight_known
from skytrace.pipeline.offline import Outcome, run
from skytrace.pipeline.prepare import Prepared, prepare_flight, prepare_recordings
from skytrace.pipeline.rough_offsets import require_offsets
from skytrace.pipeline.summary import summarise

Progress = Callable[[str, int, int], None]
_VERSIONED = ("skytrace", "numpy", "scipy", "numba", "poselib")


@dataclass(frozen=True, eq=False, slots=True)
class Result:
    """A finished reconstruction, and what `write_run` and `summary` tell about how it came about."""

    outcome: Outcome
    prepared: Prepared  # the cleaned detections, and what was dropped
    config: Config
    timings_s: Mapping[str, float] = field(default_factory=dict)  # CPU seconds of each stage
    flight: Flight | None = None  # what was reconstructed, where it was read from files

    def __post_init__(self) -> None:
        object.__setattr__(self, "timings_s", MappingProxyType(dict(self.timings_s)))

    @property
    def reconstruction(self) -> Reconstruction:
        """Cameras, clocks and trajectory."""
        return self.outcome.reconstruction

    def summary(self) -> dict[str, Any]:
        """What summary.json holds: coverage, residuals, synchronisation, observability, warnings."""
        summary = summarise(self.outcome, self.prepared, self.timings_s)
        given = [] if self.flight is None else self.flight.warnings
        return {**summary, "warnings": [*given, *summary["warnings"]]}


def reconstruct(
    recordings: Flight | Iterable[Recording],
    config: Config | None = None,
    *,
    hints: Hints | None = None,
    known: Known | None = None,
    progress: Progress | None = None,
) -> Result:
    """Reconstruct a flight from what its cameras measured: a FLIGHT as read, or recordings made in memory.

    Detections are cleaned first, as by `skytrace reconstruct`: those outside the image, stuck or jumping are dropped
    and counted; the tracks of one recording are taken as one stream. `hints` are what is known of the clocks, in
    seconds, `known` what is known of the cameras' places, in metres; None takes what the FLIGHT says. `progress` hears
    of every stage: its name, how far it is, and of how much. Lengths in the result are in the unit that its `gauge`
    names, times in seconds on the reference camera's clock.

    Raises ReconstructionError where the data determine nothing.
    """
    config = config or Config()
    stopwatch = _Stopwatch(progress)
    if isinstance(recordings, Flight):
        flight: Flight | None = recordings
        require_offsets(recordings, config.synchronise.method)
        prepared = prepare_flight(recordings, config.clean)
        hints = flight_hints(recordings) if hints is None else hints
        known = flight_known(recordings) if known is None else known
    else:
        flight, prepared = None, prepare_recordings(recordings, config.clean)
    require_detections(prepared)
    n = len(prepared.recordings)
    stopwatch("clean", n, n)
    stage = None
    for stage in run(prepared.recordings, config, hints=hints, known=known, progress=stopwatch):
        stopwatch(stage.name, stage.done, stage.total)
    assert stage is not None  # run yields at least one stage or raises
    return Result(stage.product, prepared, config, stopwatch.timings_s, flight)


def require_detections(prepared: Prepared) -> None:
    """Raise ReconstructionError, saying what became of the detections, where too few are left to begin."""
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


class _Stopwatch:
    """Books CPU time on stages while it passes their progress on."""

    def __init__(self, progress: Progress | None) -> None:
        self._progress = progress
        self._last_s = time.process_time()
        self.timings_s: dict[str, float] = {}

    def __call__(self, name: str, done: int, total: int) -> None:
        now = time.process_time()
        self.timings_s[name] = self.timings_s.get(name, 0.0) + now - self._last_s
        self._last_s = now
        if self._progress is not None:
            self._progress(name, done, total)


def write_run(destination: Path | str, result: Result, *, report: bool = True) -> dict[str, Any]:
    """Write a RUN folder as `skytrace reconstruct` does, whole or not at all, and return its summary.

    An earlier run at the destination is replaced. Raises InputError where something else lies there.
    """
    summary, flight = result.summary(), result.flight
    name = Path(destination).absolute().name if flight is None else flight.name
    inputs = () if flight is None else flight.input_files
    write_outcome(destination, result.outcome, summary, result.config, name=name, inputs=inputs, report=report)
    return summary


def write_outcome(
    destination: Path | str,
    outcome: Outcome,
    summary: Mapping[str, Any],
    config: Config,
    *,
    name: str,
    inputs: Iterable[Path] = (),
    report: bool = True,
) -> None:
    """Write a RUN folder with a summary of one's own; `inputs` are the files whose hashes the manifest holds."""
    import tomli_w

    reconstruction, settings = outcome.reconstruction, without_none(config.as_dict())
    manifest = {"versions": versions(), "seed": config.seed, "inputs": input_hashes(inputs)}
    page = None
    if report:
        from skytrace.report import render_report

        page = render_report(reconstruction, summary, name=name, versions=manifest["versions"], settings=settings)
    here = reconstruction.georeference
    details = {"from": "known positions of cameras", "known": summary.get("known")}
    more = {} if here is None else {GEOREFERENCE: georeference_text(here, details)}
    write_run_files(destination, reconstruction, summary, tomli_w.dumps(settings), manifest, page, more)


def versions() -> dict[str, str]:
    """Versions of what computed a run."""
    return {"python": platform.python_version(), **{name: version(name) for name in _VERSIONED}}


def without_none(value: Any) -> Any:
    """Settings for TOML, which has no null: those that are None are left out."""
    if isinstance(value, Mapping):
        return {k: without_none(v) for k, v in value.items() if v is not None}
    return value
