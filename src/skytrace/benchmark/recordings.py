"""The public recordings, blind and with one configuration: accuracy, coverage and cost beside the paper's figures.

Each measurement is one `skytrace reconstruct` in a process of its own, judged by the recording's truth afterwards: CPU
seconds and memory are those of the whole process, start-up included, as the operating system counts them.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import get_args

from skytrace.datasets import DATASETS, FOLDER, Labels, is_at_hand, write_dataset
from skytrace.errors import InputError
from skytrace.evaluation.summary import Evaluation
from skytrace.io.flight import read_flight
from skytrace.io.run_folder import read_run
from skytrace.pipeline.judging import evaluate_by

AT_ONCE = 2


@dataclass(frozen=True, slots=True)
class Published:
    """Errors in cm of the best of the paper's variants, lenses and synchronisation given."""

    mean_cm: float
    rmse_cm: float
    median_cm: float
    outlier_percent: float
    n: int


# Li et al. (IROS 2020), table II: automatic detections, samples that err by more than 10 x the mean left out.
PAPER = {
    "dataset1": Published(7.3, 8.5, 6.1, 0.0, 519),
    "dataset3": Published(16.1, 22.0, 11.3, 1.7, 2285),
    "dataset4": Published(35.9, 49.7, 29.6, 1.5, 1550),
}


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors in cm after a similarity; all but the last leave out what errs by more than 10 x the mean, as the paper.

    `n` are the samples of the truth that the paper's rule keeps, `n_covered` all that the run covers.
    """

    mean_cm: float
    rmse_cm: float
    median_cm: float
    outlier_percent: float
    n: int
    n_covered: int
    mean_of_all_cm: float


@dataclass(frozen=True, slots=True)
class Measurement:
    """One recording with one set of detections; what a failed or unjudged run does not have is None."""

    recording: str
    labels: Labels
    n_cameras: int
    n_registered: int = 0
    covered_s: float | None = None
    worst_median_px: float | None = None  # of the cameras' median reprojection errors
    errors: Errors | None = None
    centres_cm: float | None = None  # mean error of the camera centres, aligned by themselves
    synchronisation_ms: float | None = None  # mean error of the clocks against what is known of them
    cpu_s: float = 0.0
    wall_s: float = 0.0
    peak_mib: float = 0.0
    failure: str = ""

    @property
    def name(self) -> str:
        return f"{self.recording} {self.labels}"

    @property
    def paper(self) -> Published | None:
        """What the paper publishes of the same detections."""
        return PAPER.get(self.recording) if self.labels == "auto" else None


def recordings_at_hand(data: Path) -> list[tuple[str, Labels]]:
    """Every recording under `data` with either set of detections. Raises InputError where there is none."""
    found = [name for name in DATASETS if is_at_hand(name, data)]
    if not found:
        raise InputError(data / FOLDER, f"no recording is there: expected folders {', '.join(DATASETS)}")
    return [(name, labels) for name in found for labels in get_args(Labels)]


def measure_all(data: Path, chosen: Sequence[tuple[str, Labels]], at_once: int = AT_ONCE) -> Iterator[Measurement]:
    """Reconstruct and judge recordings, so many at once; each is told of when it is done."""
    with TemporaryDirectory(prefix="skytrace-benchmark-") as folder:
        # The longest come last in the list; begun first, none of them is left to run alone at the end.
        flights = [write_dataset(n, kind, data, Path(folder) / f"{n}_{kind}") for n, kind in reversed(chosen)]
        pool = ThreadPoolExecutor(at_once)
        try:
            waiting = [pool.submit(measure, *what, path) for what, path in zip(reversed(chosen), flights, strict=True)]
            for done in as_completed(waiting):
                yield done.result()
        finally:
            pool.shutdown(cancel_futures=True)


def measure(recording: str, labels: Labels, path: Path) -> Measurement:
    """Reconstruct the FLIGHT at `path` in a process of its own, and judge the RUN by the flight's truth."""
    flight = read_flight(path)
    output = flight.path.parent.with_name(f"{recording}_{labels}_run")
    ended = run_process([sys.executable, "-m", "skytrace", "reconstruct", str(path), "-o", str(output)])
    row = Measurement(
        recording, labels, len(flight.cameras), cpu_s=ended.cpu_s, wall_s=ended.wall_s, peak_mib=ended.peak_mib
    )
    if ended.status:
        words = ended.complaint.strip().splitlines() or [f"ended with {ended.status}"]
        return replace(row, failure=words[-1])
    run = read_run(output)
    registered = [camera for camera in run.cameras.values() if camera["registered"]]
    row = replace(
        row,
        n_registered=len(registered),
        covered_s=sum(segment["end_s"] - segment["begin_s"] for segment in run.summary["segments"]),
        worst_median_px=max(camera["reprojection_median_px"] for camera in registered),
    )
    if flight.truth is None:
        return row
    try:
        judged = evaluate_by(run, flight.truth)
    except InputError as error:
        return replace(row, failure=str(error))
    centres, clocks = judged.centres_aligned, judged.synchronisation
    return replace(
        row,
        errors=_errors(judged),
        centres_cm=None if centres is None else 100 * centres.mean,
        synchronisation_ms=None if clocks is None else 1e3 * clocks.mean_s,
    )


@dataclass(frozen=True, slots=True)
class Ended:
    """How a process ended, what it printed on stderr, and what it used."""

    status: int
    complaint: str
    cpu_s: float
    wall_s: float
    peak_mib: float


# A process begins its life as a copy of the one that starts it, whose memory Linux counts as its own peak: the command
# is started by a small process, and not by this one, which has loaded much.
_STARTER = """
import json, os, subprocess, sys, time
began = time.monotonic()
process = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL)
_, status, usage = os.wait4(process.pid, 0)
process.returncode = os.waitstatus_to_exitcode(status)
used = usage.ru_utime + usage.ru_stime, time.monotonic() - began, usage.ru_maxrss
print(json.dumps([process.returncode, *used]))
"""


def run_process(command: Sequence[str]) -> Ended:
    """Run a command to its end, its output thrown away. Raises RuntimeError where it could not be watched."""
    starter = subprocess.run([sys.executable, "-I", "-S", "-c", _STARTER, *command], capture_output=True)
    complaint = starter.stderr.decode(errors="replace")
    if starter.returncode:
        raise RuntimeError(f"{' '.join(command)}: {complaint}")
    status, cpu_s, wall_s, peak = json.loads(starter.stdout)
    return Ended(status, complaint, cpu_s, wall_s, peak / (2**20 if sys.platform == "darwin" else 2**10))


def _errors(judged: Evaluation) -> Errors | None:
    if judged.trajectory is None:
        return None
    complete, kept = judged.trajectory.complete.statistics, judged.trajectory.without_large.statistics
    return Errors(
        100 * kept.mean,
        100 * kept.rmse,
        100 * kept.median,
        kept.outlier_percent,
        kept.n,
        complete.n,
        100 * complete.mean,
    )
