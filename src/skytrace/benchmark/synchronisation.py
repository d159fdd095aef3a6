"""How much pairwise synchronisation matters: the paper's experiment on dataset3, and its rivals.

Li et al. (IROS 2020) start their pipeline from offsets that are wrong by so many frames, and take away first the
pairwise solver, then the offsets' part in the bundle adjustment. The rough offsets are the known ones plus the shift:
the truth enters there, as it did for the paper, and in judging the outcome. Nothing else sees it. The stages after the
synchronisation are this program's in every row.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal, get_args

from skytrace.benchmark.known_offsets import KnownOffsets, OffsetErrors, camera_clock
from skytrace.datasets import write_dataset
from skytrace.errors import ReconstructionError
from skytrace.estimation.hints import Hints, OffsetHint
from skytrace.estimation.synchronize import Synchronisation
from skytrace.evaluation.path import SampledPath
from skytrace.evaluation.search import CHANCE_LEVEL
from skytrace.evaluation.trajectory import evaluate_trajectory
from skytrace.geometry.arrays import FloatArray
from skytrace.io.flight import read_flight
from skytrace.io.truth import read_true_synchronisation, read_truth_trajectory
from skytrace.model.reconstruction import Reconstruction
from skytrace.model.track import Recording
from skytrace.pipeline.config import Config
from skytrace.pipeline.offline import Outcome, run
from skytrace.pipeline.prepare import prepare_flight

RECORDING = "dataset3"
SHIFTS = (5.0, 10.0, 15.0, 20.0, 50.0, 500.0, 3000.0)  # frames of the reference camera; the paper's end at 50

Pipeline = Literal["full", "blind", "without_pairwise", "with_neither"]
PIPELINES: Mapping[Pipeline, str] = {
    "full": "full, from rough offsets",
    "blind": "full, blind (the default)",
    "without_pairwise": "without the pairwise solver",
    "with_neither": "with neither",
}


@dataclass(frozen=True, slots=True)
class TrajectoryError:
    """Distance from the true path after similarity, without samples that err by more than ten times the mean."""

    mean_cm: float
    n_covered: int  # samples of the truth
    n_dropped: int
    n_total: int


@dataclass(frozen=True, slots=True)
class Measurement:
    """What one pipeline made of rough offsets wrong by `shift_frames` (none: it was not told any)."""

    pipeline: Pipeline
    shift_frames: float | None
    before: OffsetErrors | None  # that the adjustment starts from
    after: OffsetErrors | None
    trajectory: TrajectoryError | None
    failure: str  # why what is none could not be had; empty where all is there
    cpu_s: float


@dataclass(frozen=True, eq=False, slots=True)
class _Experiment:
    """What all measurements share."""

    recordings: Sequence[Recording]
    known: KnownOffsets
    truth: FloatArray  # (n, 3)
    truth_rate_hz: float
    config: Config


def measure_all(data: Path, shifts: Sequence[float] = SHIFTS, seed: int = 0) -> Iterator[Measurement]:
    """One measurement after the other: each pipeline at each shift, the blind one once.

    Raises InputError where the recording does not lie under `data`.
    """
    experiment = _read(data, seed)
    for pipeline in get_args(Pipeline):
        for shift in (None,) if pipeline == "blind" else shifts:
            yield _measure(experiment, pipeline, shift)


def count(shifts: Sequence[float]) -> int:
    """How many measurements `measure_all` makes."""
    return (len(PIPELINES) - 1) * len(shifts) + 1


def _read(data: Path, seed: int) -> _Experiment:
    config = Config(seed=seed)
    with TemporaryDirectory(prefix="skytrace-benchmark-") as folder:
        flight = read_flight(write_dataset(RECORDING, "auto", data, Path(folder) / RECORDING))
        truth = flight.truth
        assert truth is not None  # written with the recording
        assert truth.rate_hz is not None
        assert truth.synchronisation is not None
        recordings = prepare_flight(flight, config.clean).recordings
        known = KnownOffsets.of(
            recordings, read_true_synchronisation(truth.synchronisation), config.adjust.readout_fraction
        )
        return _Experiment(recordings, known, read_truth_trajectory(truth.trajectory).position_m, truth.rate_hz, config)


def _measure(experiment: _Experiment, pipeline: Pipeline, shift: float | None) -> Measurement:
    began_s = time.process_time()
    before = after = trajectory = None
    failure = ""
    try:
        config, hints = _configured(experiment.config, pipeline), _hints(experiment, shift)
        for stage in run(experiment.recordings, config, hints=hints):
            if isinstance(stage.product, Synchronisation):
                before = _pairwise_errors(experiment, stage.product)
            if isinstance(stage.product, Outcome):
                reconstruction = stage.product.reconstruction
                after = experiment.known.errors({c: e.clock for c, e in reconstruction.cameras.items()})
                trajectory, failure = _trajectory_error(experiment, reconstruction)
    except ReconstructionError as error:
        failure = f"{error.stage}: {error.reason}"
    return Measurement(pipeline, shift, before, after, trajectory, failure, time.process_time() - began_s)


def _configured(config: Config, pipeline: Pipeline) -> Config:
    method = {"full": "paper", "blind": "exhaustive"}.get(pipeline, "given")
    return replace(
        config,
        synchronise=replace(config.synchronise, method=method),
        freedom=replace(config.freedom, clocks=pipeline != "with_neither"),
    )


def _hints(experiment: _Experiment, shift: float | None) -> Hints:
    if shift is None:
        return Hints()
    rough_s = experiment.known.rough_offsets_s(shift)
    return Hints(tuple(OffsetHint(c, offset_s) for c, offset_s in rough_s.items()))


def _pairwise_errors(experiment: _Experiment, found: Synchronisation) -> OffsetErrors:
    readout = experiment.config.adjust.readout_fraction
    recordings = {r.camera_id: r for r in experiment.recordings}
    clocks = {c: camera_clock(recordings[c], *clock, readout) for c, clock in found.clocks.items()}
    return experiment.known.errors(clocks)


def _trajectory_error(
    experiment: _Experiment, reconstruction: Reconstruction
) -> tuple[TrajectoryError, str] | tuple[None, str]:
    """The error, or why the path cannot be brought to match the true one."""
    path = SampledPath.from_trajectory(reconstruction.trajectory)
    try:
        found = evaluate_trajectory(path, experiment.truth, experiment.truth_rate_hz)
    except ValueError as error:
        return None, f"evaluate: {error}"
    kept = found.without_large
    if kept.unexplained > CHANCE_LEVEL:
        return None, "evaluate: the path matches the true one no better than chance"
    n_covered, n_total = found.complete.statistics.n, found.complete.n_total
    return TrajectoryError(100 * kept.statistics.mean, n_covered, kept.n_dropped, n_total), ""
