"""Fit the confidence of a synchronised pair on simulated pairs, and see on others whether it can be trusted.

    python benchmarks/sync_pairs.py --pairs 800 --seed 101 --shortest 15 --json fit.json
    python benchmarks/sync_pairs.py --pairs 800 --seed 102 --shortest 15 --json judge.json
    python benchmarks/sync_confidence.py fit.json judge.json

Prints the coefficients of the logistic regression of "right to a frame" on `confidence_features`, fitted to the first
file with a slight ridge, beside those in use, and for the second file how often pairs of each confidence are right.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from skytrace.estimation.confidence import COEFFICIENTS, confidence_features

RIDGE = 0.05
EDGES = (0.0, 0.05, 0.5, 0.8, 0.95, 0.99, 0.999, 1.0000001)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("fit", type=Path)
    parser.add_argument("judge", type=Path)
    options = parser.parse_args()
    rows = read_rows(options.fit)
    found = fit_logistic(*regression(rows))
    print(f"fitted to {len(rows)} pairs:", np.array2string(found, precision=2), "in use:", COEFFICIENTS)
    print(f"\n{'confidence':>18}{'pairs':>8}{'expected right':>16}{'right':>8}{'wrong':>8}")
    for low, high, number, expected, right in reliability(read_rows(options.judge)):
        print(f"{low:>8.3f} to {min(high, 1):>6.3f}{number:>8}{expected:>16.1f}{right:>8}{number - right:>8}")


def read_rows(path: Path) -> list[dict[str, Any]]:
    """The pairs of a table of sync_pairs.py in which an offset was found."""
    return [row for row in json.loads(path.read_text())["rows"] if "evidence" in row]


def regression(rows: Sequence[Mapping[str, Any]]) -> tuple[np.ndarray, np.ndarray]:
    """Features (n, k) and outcomes (n,) of overlaps long enough for the regression to speak about."""
    features = [confidence_features(r["evidence"], r["rival_evidence"], r["support"]) for r in rows]
    return np.array(features), np.array([float(r["right"]) for r in rows])


def fit_logistic(X: np.ndarray, y: np.ndarray, iterations: int = 100) -> np.ndarray:
    """Coefficients (k,) of a logistic regression with a ridge, by Newton's method."""
    beta = np.zeros(X.shape[1])
    penalty = RIDGE * np.diag(np.r_[0.0, np.ones(X.shape[1] - 1)])
    for _ in range(iterations):
        p = 1 / (1 + np.exp(-np.clip(X @ beta, -30, 30)))
        step = np.linalg.solve((X * (p * (1 - p))[:, None]).T @ X + penalty, X.T @ (y - p) - penalty @ beta)
        beta += step / max(1.0, float(np.abs(step).max()) / 5)
    return beta


def reliability(rows: Sequence[Mapping[str, Any]]) -> list[tuple[float, float, int, float, int]]:
    """For each range of confidence: its ends, how many pairs, how many should be right, how many are."""
    table = []
    for low, high in pairwise(EDGES):
        inside = [r for r in rows if low <= r["confidence"] < high]
        expected = float(sum(r["confidence"] for r in inside))
        table.append((low, high, len(inside), expected, sum(bool(r["right"]) for r in inside)))
    return table


if __name__ == "__main__":
    main()
