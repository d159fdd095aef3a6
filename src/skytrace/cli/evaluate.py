"""`skytrace evaluate`: a RUN against what is known of the truth."""

from __future__ import annotations

from pathlib import Path

from skytrace.errors import InputError
from skytrace.evaluation.path import SampledPath
from skytrace.evaluation.summary import Evaluation, evaluate
from skytrace.evaluation.table import format_table
from skytrace.geometry.arrays import FloatArray
from skytrace.io.flight import FlightTruth, read_flight
from skytrace.io.run_folder import RunFolder, json_text, read_run
from skytrace.io.truth import evenly_sampled, read_true_positions, read_true_synchronisation, read_truth_trajectory
from skytrace.model.camera import Clock


def evaluate_command(
    run_folder: Path,
    truth: Path | None,
    rate_hz: float | None,
    positions: Path | None,
    synchronisation: Path | None,
    flight: Path | None,
    as_json: bool,
) -> None:
    """Read, compare, print."""
    run = read_run(run_folder)
    if flight is not None:
        known = read_flight(flight).truth
        if known is None:
            raise InputError(flight, "the flight has no [truth] section; give --truth FILE --rate HZ")
        truth, rate_hz = truth or known.trajectory, rate_hz or known.rate_hz
        positions, synchronisation = positions or known.positions, synchronisation or known.synchronisation
    if truth is None and positions is None and synchronisation is None:
        raise InputError(
            run_folder,
            "nothing to compare with: give --truth FILE --rate HZ, --positions, --synchronisation or --flight",
        )
    evaluation = evaluate_run(run, truth, rate_hz, positions, synchronisation)
    if as_json:
        print(json_text(evaluation.as_dict(), ascii_only=True))
    else:
        print(format_table(evaluation), end="")


def evaluate_truth(run_folder: Path, truth: FlightTruth) -> Evaluation:
    """Judge a run by a flight's own truth."""
    return evaluate_run(read_run(run_folder), truth.trajectory, truth.rate_hz, truth.positions, truth.synchronisation)


def evaluate_run(
    run: RunFolder,
    truth: Path | None,
    rate_hz: float | None,
    positions: Path | None,
    synchronisation: Path | None,
) -> Evaluation:
    """Judge a run by files; raises InputError where the truth cannot be compared."""
    positions_m = None
    if truth is not None:
        positions_m, rate_hz = true_path(truth, rate_hz)
    cameras = {c: row for c, row in run.cameras.items() if row["registered"]}
    clocks = {
        c: Clock(row["clock"]["offset_s"], row["clock"]["period_s"], row["clock"]["readout_s"])
        for c, row in cameras.items()
    }
    try:
        return evaluate(
            SampledPath(run.time_s, run.position, run.velocity, run.segment, run.n_cameras, run.sigma),
            truth=positions_m,
            rate_hz=rate_hz,
            centres={c: row["centre"] for c, row in cameras.items()},
            known_centres=None if positions is None else read_true_positions(positions),
            clocks=clocks,
            known_synchronisation=None if synchronisation is None else read_true_synchronisation(synchronisation),
        )
    except ValueError as error:
        raise InputError(truth or run.path, str(error)) from error


def true_path(path: Path, rate_hz: float | None) -> tuple[FloatArray, float]:
    """True positions (n, 3) and how many there are a second; a truth's own time stamps count more than a rate."""
    truth = read_truth_trajectory(path)
    if truth.time_s is not None:
        try:
            return evenly_sampled(truth)
        except ValueError as error:
            raise InputError(path, str(error)) from error
    if rate_hz is None:
        raise InputError(path, "the truth's rate is not known: give --rate HZ, or a column time_s")
    return truth.position_m, rate_hz
