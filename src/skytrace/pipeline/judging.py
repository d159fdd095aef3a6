"""Judging an estimate by what is known, whether it was just made or read back from a RUN."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from skytrace.errors import InputError
from skytrace.evaluation.path import SampledPath
from skytrace.evaluation.summary import Evaluation
from skytrace.evaluation.summary import evaluate as judge
from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import Rigid
from skytrace.io.flight import FlightTruth
from skytrace.io.run_folder import RunFolder, supporting_cameras
from skytrace.io.truth import read_true_orientations, read_true_positions, read_true_synchronisation, true_path
from skytrace.model.camera import Clock
from skytrace.model.reconstruction import Reconstruction


def evaluate(
    estimate: Reconstruction | RunFolder,
    *,
    truth: FloatArray | None = None,
    rate_hz: float | None = None,
    known_centres: Mapping[str, FloatArray] | None = None,
    known_rotations: Mapping[str, FloatArray] | None = None,
    known_synchronisation: Mapping[str, tuple[float, float]] | None = None,
) -> Evaluation:
    """Judge a reconstruction, or a run read back, by whatever is known; the truth's clock and frame are fitted.

    `truth` are true positions (m, 3) in metres, `rate_hz` of them a second, NaN where unknown; `known_centres` camera
    centres (3,) in metres and `known_rotations` rotations (3, 3) from the known world into the camera, by camera id;
    `known_synchronisation` (slope, intercept) by camera id, such that frame of the
    camera = slope * frame of the reference + intercept. Errors come in the truth's unit. Raises ValueError where
    estimate and truth cannot be brought to overlap.
    """
    path, poses, clocks = _of_run(estimate) if isinstance(estimate, RunFolder) else _of_reconstruction(estimate)
    return judge(
        path,
        truth=truth,
        rate_hz=rate_hz,
        centres={camera_id: pose.centre for camera_id, pose in poses.items()},
        known_centres=known_centres,
        rotations={camera_id: pose.rotation for camera_id, pose in poses.items()},
        known_rotations=known_rotations,
        clocks=clocks,
        known_synchronisation=known_synchronisation,
    )


def evaluate_files(
    run: RunFolder,
    trajectory: Path | None,
    rate_hz: float | None = None,
    positions: Path | None = None,
    synchronisation: Path | None = None,
    orientations: Path | None = None,
) -> Evaluation:
    """Judge a run by files of a truth. Raises InputError where they cannot be read, or compared with the run."""
    truth = None
    if trajectory is not None:
        truth, rate_hz = true_path(trajectory, rate_hz)
    try:
        return evaluate(
            run,
            truth=truth,
            rate_hz=rate_hz,
            known_centres=None if positions is None else read_true_positions(positions),
            known_rotations=None if orientations is None else read_true_orientations(orientations),
            known_synchronisation=None if synchronisation is None else read_true_synchronisation(synchronisation),
        )
    except ValueError as error:
        raise InputError(trajectory or run.path, str(error)) from error


def evaluate_by(run: RunFolder, truth: FlightTruth) -> Evaluation:
    """Judge a run by a flight's own truth."""
    return evaluate_files(
        run, truth.trajectory, truth.rate_hz, truth.positions, truth.synchronisation, truth.orientations
    )


_CLOCK = ("offset_s", "period_s", "readout_s")
_Judged = tuple[SampledPath, dict[str, Rigid], dict[str, Clock]]


def _of_reconstruction(reconstruction: Reconstruction) -> _Judged:
    path = SampledPath.from_trajectory(reconstruction.trajectory)
    path = replace(path, n_cameras=supporting_cameras(reconstruction, path.time_s))
    cameras = reconstruction.cameras.items()
    return path, {c: e.camera_from_world for c, e in cameras}, {c: e.clock for c, e in cameras}


def _of_run(run: RunFolder) -> _Judged:
    cameras = {c: row for c, row in run.cameras.items() if row["registered"]}
    clocks = {c: Clock(*(row["clock"][k] for k in _CLOCK)) for c, row in cameras.items()}
    path = SampledPath(run.time_s, run.position, run.velocity, run.segment, run.n_cameras, run.sigma)
    poses = {
        c: Rigid.from_centre(np.array(row["rotation_camera_from_world"]), np.array(row["centre"]))
        for c, row in cameras.items()
    }
    return path, poses, clocks
