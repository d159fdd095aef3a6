"""The public recordings, blind and with one configuration: accuracy, coverage and cost beside the paper's figures.

    SKYTRACE_DATA=... python -m benchmarks.recordings [--json FILE]

Each row is one `skytrace reconstruct` in a process of its own; CPU time and memory are those of the whole process.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from skytrace.cli.evaluate import evaluate_truth
from skytrace.datasets import DATASETS, write_dataset
from skytrace.io.flight import read_flight
from skytrace.io.run_folder import read_run

# Mean error in cm of the best of the paper's six variants, and truth samples covered (Li et al. 2020, table II).
PAPER = {"dataset1": (7.3, 519), "dataset3": (16.1, 2285), "dataset4": (35.9, 1550)}
HEADER = (
    "recording",
    "cameras",
    "covered s",
    "N",
    "mean cm",
    "mean cm, > 10 x mean dropped",
    "median cm",
    "camera centres cm",
    "worst median px",
    "CPU s",
    "peak MiB",
    "paper: mean cm (N)",
)


def measure(name: str, labels: str, data: Path, folder: Path) -> dict[str, object]:
    """Reconstruct and judge one recording."""
    flight = write_dataset(name, labels, data, folder / f"{name}_{labels}")  # type: ignore[arg-type]
    output = folder / f"{name}_{labels}_run"
    command = [sys.executable, "-m", "skytrace", "reconstruct", str(flight), "-o", str(output)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"{' '.join(command)} ended with {process.returncode}")
    run = read_run(output)
    registered = [c for c in run.cameras.values() if c["registered"]]
    paper = PAPER[name]
    row: dict[str, object] = {
        "recording": f"{name} {labels}",
        "cameras": f"{len(registered)} of {len(run.cameras)}",
        "covered s": round(sum(s["end_s"] - s["begin_s"] for s in run.summary["segments"])),
        "worst median px": round(max(c["reprojection_median_px"] for c in registered), 2),
        "CPU s": round(usage.ru_utime + usage.ru_stime, 1),
        "peak MiB": round(usage.ru_maxrss / 1024),
        "paper: mean cm (N)": f"{paper[0]} ({paper[1]})" if labels == "auto" else "",
    }
    truth = read_flight(flight).truth
    if truth is not None:
        evaluation = evaluate_truth(output, truth)
        assert evaluation.trajectory is not None
        complete, without = evaluation.trajectory.complete.statistics, evaluation.trajectory.without_large.statistics
        row |= {
            "N": complete.n,
            "mean cm": round(100 * complete.mean, 1),
            "mean cm, > 10 x mean dropped": round(100 * without.mean, 1),
            "median cm": round(100 * complete.median, 1),
        }
        if evaluation.centres_aligned is not None:
            row["camera centres cm"] = round(100 * evaluation.centres_aligned.mean, 1)
    return row


def main() -> None:
    """Measure all recordings and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, help="also write the rows here")
    arguments = parser.parse_args()
    if "SKYTRACE_DATA" not in os.environ:
        sys.exit("set SKYTRACE_DATA to the folder that holds drone-tracking/")
    rows = []
    print("| " + " | ".join(HEADER) + " |\n" + "| --- " * len(HEADER) + "|")
    with tempfile.TemporaryDirectory() as folder:
        for name in DATASETS:
            for labels in ("auto", "manual"):
                rows.append(measure(name, labels, Path(os.environ["SKYTRACE_DATA"]), Path(folder)))
                print("| " + " | ".join(str(rows[-1].get(key, "")) for key in HEADER) + " |", flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
