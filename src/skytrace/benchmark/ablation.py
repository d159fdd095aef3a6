"""What each part of the model is worth: the paper's table of motion priors with and without rolling shutter, and more.

Li et al. (IROS 2020), table II, reconstruct each flight with the spline alone, with least kinetic energy and with least
force, each with and without rolling shutter, lenses as calibrated. Here least jerk joins in, and lenses that the flight
refines; the default is one of the rows. Flights are reconstructed blind. Their synchronisation, which depends on the
tracks, the hints, the seed and the readout assumed, is computed once for each of the latter and handed to every
variant, unchanged.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from skytrace.datasets import DATASETS, Labels, is_at_hand, write_dataset
from skytrace.errors import InputError, ReconstructionError
from skytrace.estimation.adjust.settings import Freedom
from skytrace.estimation.correspond import ImagePath
from skytrace.estimation.hints import Hints
from skytrace.estimation.known import Known
from skytrace.estimation.priors import PriorKind
from skytrace.estimation.synchronize import Synchronisation
from skytrace.evaluation.search import CHANCE_LEVEL
from skytrace.evaluation.statistics import ErrorStatistics
from skytrace.evaluation.trajectory import TrajectoryEvaluation
from skytrace.geometry.arrays import FloatArray
from skytrace.io.flight import read_flight
from skytrace.io.truth import true_path
from skytrace.model.track import Recording
from skytrace.pipeline.config import Config
from skytrace.pipeline.flight_hints import flight_hints
from skytrace.pipeline.flight_known import flight_known
from skytrace.pipeline.judging import evaluate
from skytrace.pipeline.offline import Progress, outcome, run, synchronise_paths
from skytrace.pipeline.prepare import prepare_flight

Shutter = Literal["estimated", "assumed", "none"]


@dataclass(frozen=True, slots=True)
class Variant:
    """A model: the motion prior, the rolling shutter, and what of lenses the flight may refine."""

    motion: PriorKind
    shutter: Shutter
    focal: bool
    lens: bool  # aspect, principal point, radial distortion

    def configured(self, config: Config) -> Config:
        """The configuration of this model."""
        adjustment = replace(config.adjust, motion_prior=self.motion)
        if self.shutter == "none":
            adjustment = replace(adjustment, readout_fraction=0.0)
        freedom = Freedom(self.shutter == "estimated", focal=self.focal, lens=self.lens)
        return replace(config, adjust=adjustment, freedom=freedom)


_PRIORS: Sequence[PriorKind] = ("none", "kinetic", "force", "jerk")
_SHUTTERS: Sequence[Shutter] = ("none", "estimated")
VARIANTS: tuple[Variant, ...] = (
    *(Variant(motion, shutter, free, free) for free in (False, True) for shutter in _SHUTTERS for motion in _PRIORS),
    Variant("jerk", "assumed", True, True),
    Variant("jerk", "estimated", True, False),
    Variant("jerk", "estimated", False, True),
)


@dataclass(frozen=True, slots=True)
class Measurement:
    """One model on one flight; errors in metres after a similarity, none where it failed."""

    flight: str
    variant: Variant
    errors: ErrorStatistics | None  # of all samples of the truth that are covered
    without_large: ErrorStatistics | None  # the paper's rule: samples that err by more than 10 x the mean are dropped
    n_dropped: int
    n_total: int
    cpu_s: float  # without the synchronisation
    failure: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class Judged:
    """A flight with its truth."""

    name: str
    recordings: Sequence[Recording]
    hints: Hints
    known: Known | None
    truth: FloatArray  # (n, 3)
    rate_hz: float


def recordings_with_truth(data: Path) -> list[str]:
    """The public recordings under `data` that have a true trajectory. Raises InputError where there is none."""
    found = [name for name, dataset in DATASETS.items() if dataset.synchronisation and is_at_hand(name, data)]
    if not found:
        names = ", ".join(name for name, dataset in DATASETS.items() if dataset.synchronisation)
        raise InputError(
            data, f"none of the recordings with truth ({names}) lies there: expected drone-tracking/ inside"
        )
    return found


def read_recording(name: str, labels: Labels, data: Path, config: Config) -> Judged:
    """A public recording, ready to be measured on."""
    with TemporaryDirectory(prefix="skytrace-benchmark-") as folder:
        return read_judged(write_dataset(name, labels, data, Path(folder) / name), config)


def read_judged(path: Path, config: Config) -> Judged:
    """A FLIGHT with truth, ready to be measured on. Raises InputError where it has none."""
    flight = read_flight(path)
    if flight.truth is None:
        raise InputError(flight.path, "the flight has no [truth] section, which is what variants are judged by")
    position_m, rate_hz = true_path(flight.truth.trajectory, flight.truth.rate_hz)
    recordings = prepare_flight(flight, config.clean).recordings
    return Judged(flight.name, recordings, flight_hints(flight), flight_known(flight), position_m, rate_hz)


def measure_flight(judged: Judged, config: Config, variants: Sequence[Variant] = VARIANTS) -> Iterator[Measurement]:
    """One measurement after the other, each variant once."""
    synchronise = _Once()
    for variant in variants:
        yield _measure(judged, variant, config, synchronise)


class _Once:
    """A synchronisation that is computed when it is first asked for with a readout, which image paths account for."""

    def __init__(self) -> None:
        self.cpu_s = 0.0
        self._found: dict[float, Synchronisation | ReconstructionError] = {}

    def __call__(
        self, paths: Mapping[str, ImagePath], config: Config, hints: Hints | None, progress: Progress
    ) -> Synchronisation:
        readout, began_s = config.adjust.readout_fraction, time.process_time()
        if readout not in self._found:
            try:
                self._found[readout] = synchronise_paths(paths, config, hints, progress)
            except ReconstructionError as error:
                self._found[readout] = error
            self.cpu_s += time.process_time() - began_s
        found = self._found[readout]
        if isinstance(found, ReconstructionError):
            raise found
        return found


def _measure(judged: Judged, variant: Variant, config: Config, synchronise: _Once) -> Measurement:
    began_s, before_s = time.process_time(), synchronise.cpu_s
    found: TrajectoryEvaluation | None = None
    failure = ""
    try:
        stages = run(
            judged.recordings,
            variant.configured(config),
            hints=judged.hints,
            known=judged.known,
            synchronise=synchronise,
        )
        found = evaluate(outcome(stages).reconstruction, truth=judged.truth, rate_hz=judged.rate_hz).trajectory
    except ReconstructionError as error:
        failure = f"{error.stage}: {error.reason}"
    except ValueError as error:
        failure = f"evaluate: {error}"
    if found is not None and found.without_large.unexplained > CHANCE_LEVEL:
        found, failure = None, "evaluate: the path matches the true one no better than chance"
    cpu_s = time.process_time() - began_s - (synchronise.cpu_s - before_s)
    if found is None:
        return Measurement(judged.name, variant, None, None, 0, 0, cpu_s, failure)
    complete, kept = found.complete, found.without_large
    return Measurement(
        judged.name, variant, complete.statistics, kept.statistics, kept.n_dropped, complete.n_total, cpu_s
    )
