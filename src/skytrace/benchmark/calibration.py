"""What calibrating with the shutter's motion is worth: the six photograph sets of dataset3, and its flight with them.

Every set is calibrated without any hint, and beside it by OpenCV's functions in the usual way (complete boards of the
known size, a pinhole with five coefficients, boards at rest). The flight is reconstructed blind with the calibrations
the recordings were published with and with these, lenses refined along the way and held.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np

from skytrace.datasets import DATASETS, write_dataset
from skytrace.errors import InputError, ReconstructionError
from skytrace.estimation.adjust.settings import Freedom
from skytrace.evaluation.path import SampledPath
from skytrace.evaluation.trajectory import evaluate_trajectory
from skytrace.io.flight import Flight, read_flight
from skytrace.io.pictures import named_files, read_grey
from skytrace.io.truth import read_truth_trajectory
from skytrace.model.camera import Intrinsics
from skytrace.pipeline.board_search import find_boards
from skytrace.pipeline.calibrate import calibrate
from skytrace.pipeline.config import Config
from skytrace.pipeline.offline import Outcome, run
from skytrace.pipeline.prepare import prepare_flight

RECORDING = "dataset3"
# The folder of photographs of each device that filmed it.
SETS: Mapping[str, str] = MappingProxyType(
    {
        "gopro3": "gopro3",
        "mate7": "mate7",
        "mate10_1": "mate10",
        "sony5n_1440x1080": "sony5n_1440x1080",
        "sony5100": "sony5100",
        "sonyG_2": "sonyG",
    }
)
_BOARD = (7, 6)  # inner corners; OpenCV is told, the program finds out

Source = Literal["published", "own"]
Lenses = Literal["refined", "focal fixed", "fixed"]


@dataclass(frozen=True, slots=True)
class PlainCalibration:
    """What OpenCV makes of a set in the usual way."""

    used: int
    rms_px: float
    focal_px: float


@dataclass(frozen=True, slots=True)
class LensMeasurement:
    """One set of photographs."""

    device: str
    width_px: int
    pictures: int
    used: int
    model: str
    rms_px: float
    focal_px: float
    published_focal_px: float
    focal_sd: float  # relative
    halves_rms: float | None  # relative difference of the focal lengths of random halves
    plain: PlainCalibration | None  # none where OpenCV finds too few boards
    cpu_s: float


@dataclass(frozen=True, slots=True)
class FlightMeasurement:
    """The flight with one kind of calibrations."""

    source: Source
    lenses: Lenses
    mean_cm: float | None  # distance from the true path after similarity, all covered samples; none where it failed
    median_cm: float | None
    n_covered: int
    cpu_s: float
    failure: str = ""


def measure_all(data: Path, seed: int = 0) -> Iterator[LensMeasurement | FlightMeasurement]:
    """The six sets, then the flights.

    Raises InputError where the recording or its photographs do not lie under `data`.
    """
    with TemporaryDirectory(prefix="skytrace-benchmark-") as folder:
        flight = read_flight(write_dataset(RECORDING, "auto", data, Path(folder) / RECORDING))
        devices = DATASETS[RECORDING].devices
        published = {d: c.intrinsics for d, c in zip(devices, flight.cameras, strict=True)}
        own: dict[str, Intrinsics] = {}
        for device in devices:
            own[device], measured = measure_set(data, device, published[device], seed)
            yield measured
        for source in get_args(Source):
            lenses = list(published.values() if source == "published" else own.values())
            for freedom in get_args(Lenses):
                yield _measure_flight(flight, lenses, source, freedom, seed)


def count() -> int:
    """How many measurements `measure_all` makes."""
    return len(SETS) + len(get_args(Source)) * len(get_args(Lenses))


def measure_set(data: Path, device: str, published: Intrinsics, seed: int) -> tuple[Intrinsics, LensMeasurement]:
    """Calibrate a device from its photographs."""
    folder = data / "drone-tracking" / "calibration" / "images" / SETS[device]
    if not folder.is_dir():
        raise InputError(folder, "the photographs of the calibration board are not there")
    files = named_files([folder])
    began_s = time.process_time()
    found = find_boards(files, None, lambda done, total: None)
    calibration = calibrate(found, None, None, np.random.default_rng(seed))
    cpu_s = time.process_time() - began_s
    lens, certainty = calibration.lens, calibration.certainty
    return lens, LensMeasurement(
        device,
        lens.size_px[0],
        len(files),
        len(calibration.fit.views),
        lens.model,
        calibration.fit.total_rms_px,
        float(lens.focal_px[0]),
        float(published.focal_px[0]),
        certainty.focal,
        certainty.halves_rms,
        plain_calibration(files),
        cpu_s,
    )


def plain_calibration(files: list[Path]) -> PlainCalibration | None:
    """OpenCV's calibration of a pinhole from complete boards at rest."""
    import cv2

    board = np.zeros((_BOARD[0] * _BOARD[1], 3), np.float32)
    board[:, :2] = np.mgrid[: _BOARD[0], : _BOARD[1]].T.reshape(-1, 2)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 30, 1e-3)
    corners: list[np.ndarray] = []
    size = (0, 0)
    for file in files:
        grey = read_grey(file)
        size = (grey.shape[1], grey.shape[0])
        complete, found = cv2.findChessboardCorners(grey, _BOARD)
        if complete:
            corners.append(np.asarray(cv2.cornerSubPix(grey, found, (11, 11), (-1, -1), criteria), np.float32))
    if len(corners) < 3:
        return None
    start, distortion = np.eye(3), np.zeros(5)
    rms, K, *_ = cv2.calibrateCamera([board] * len(corners), corners, size, start, distortion)
    return PlainCalibration(len(corners), float(rms), float(K[0, 0]))


def _measure_flight(
    flight: Flight, lenses: list[Intrinsics], source: Source, freedom: Lenses, seed: int
) -> FlightMeasurement:
    config = replace(Config(seed=seed), freedom=Freedom(focal=freedom == "refined", lens=freedom != "fixed"))
    cameras = tuple(replace(c, intrinsics=lens) for c, lens in zip(flight.cameras, lenses, strict=True))
    began_s = time.process_time()
    try:
        recordings = prepare_flight(replace(flight, cameras=cameras), config.clean).recordings
        outcome = next(s.product for s in run(recordings, config) if isinstance(s.product, Outcome))
        cpu_s = time.process_time() - began_s
        assert flight.truth is not None  # written with the recording
        assert flight.truth.rate_hz is not None
        truth = read_truth_trajectory(flight.truth.trajectory).position_m
        path = SampledPath.from_trajectory(outcome.reconstruction.trajectory)
        errors = evaluate_trajectory(path, truth, flight.truth.rate_hz).complete.statistics
    except (ReconstructionError, ValueError) as error:
        return FlightMeasurement(source, freedom, None, None, 0, time.process_time() - began_s, str(error))
    return FlightMeasurement(source, freedom, 100 * errors.mean, 100 * errors.median, errors.n, cpu_s)
