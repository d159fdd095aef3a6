"""`skytrace evaluate`: a RUN against what is known of the truth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from skytrace.errors import InputError
from skytrace.evaluation.summary import Evaluation
from skytrace.evaluation.table import format_table
from skytrace.io.flight import FlightTruth, read_flight
from skytrace.io.run_folder import RunFolder, json_text, read_run
from skytrace.pipeline.judging import evaluate_by, evaluate_files


@dataclass(frozen=True, slots=True)
class TruthFiles:
    """What the command line says of the truth."""

    trajectory: Path | None = None
    rate_hz: float | None = None
    positions: Path | None = None
    orientations: Path | None = None
    synchronisation: Path | None = None
    flight: Path | None = None

    def with_flight(self) -> TruthFiles:
        """The files with those that the FLIGHT names where none were given. Raises InputError where it names none."""
        if self.flight is None:
            return self
        known = read_flight(self.flight).truth
        if known is None:
            raise InputError(self.flight, "the flight has no [truth] section; give --truth FILE --rate HZ")
        return replace(
            self,
            trajectory=self.trajectory or known.trajectory,
            rate_hz=self.rate_hz or known.rate_hz,
            positions=self.positions or known.positions,
            orientations=self.orientations or known.orientations,
            synchronisation=self.synchronisation or known.synchronisation,
            flight=None,
        )

    @property
    def any(self) -> bool:
        """Whether anything was given."""
        return any((self.trajectory, self.positions, self.orientations, self.synchronisation, self.flight))

    def judge(self, run: RunFolder) -> Evaluation:
        """A run against the files, those of a FLIGHT left aside."""
        return evaluate_files(
            run, self.trajectory, self.rate_hz, self.positions, self.synchronisation, self.orientations
        )


def evaluate_command(run_folder: Path, truth: TruthFiles, as_json: bool) -> None:
    """Read, compare, print."""
    run = read_run(run_folder)
    if not truth.any:
        raise InputError(
            run_folder,
            "nothing to compare with: give --truth FILE --rate HZ, --positions, --orientations, --synchronisation or "
            "--flight",
        )
    evaluation = truth.with_flight().judge(run)
    if as_json:
        print(json_text(evaluation.as_dict(), ascii_only=True))
    else:
        print(format_table(evaluation), end="")


def evaluate_truth(run_folder: Path, truth: FlightTruth) -> Evaluation:
    """Judge a run by a flight's own truth."""
    return evaluate_by(read_run(run_folder), truth)
