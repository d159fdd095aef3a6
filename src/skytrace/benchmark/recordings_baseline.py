"""What got worse against figures measured earlier: those committed with the package, or a user's own."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from skytrace.benchmark.recordings import Measurement
from skytrace.errors import InputError

COMMITTED = "recordings_baseline.json"


@dataclass(frozen=True, slots=True)
class Tolerance:
    """How far a figure may move without a word: a share of the baseline's plus an amount in the figure's unit."""

    figure: str
    words: str
    share: float
    amount: float
    more_is_worse: bool = True

    def worse_by(self, now: float, before: float) -> bool:
        """Whether a figure lies on the wrong side of the baseline's, beyond the noise."""
        change = now - before if self.more_is_worse else before - now
        return change > self.share * abs(before) + self.amount


# Accuracy moves by a few per cent with rounding and the libraries' versions; cost with the machine and its load, so
# that only a change which no load explains is told.
TOLERANCES = (
    Tolerance("n_registered", "cameras registered", 0.0, 0.5, more_is_worse=False),
    Tolerance("n_covered", "N of all", 0.02, 2.0, more_is_worse=False),
    Tolerance("covered_s", "covered s", 0.02, 1.0, more_is_worse=False),
    Tolerance("mean_of_all_cm", "mean of all, cm", 0.05, 0.2),
    Tolerance("mean_cm", "mean, cm", 0.05, 0.2),
    Tolerance("median_cm", "median, cm", 0.05, 0.2),
    Tolerance("centres_cm", "camera centres, cm", 0.1, 1.0),
    Tolerance("synchronisation_ms", "synchronisation, ms", 0.1, 0.5),
    Tolerance("worst_median_px", "worst median, px", 0.05, 0.05),
    Tolerance("cpu_s", "CPU s", 1.0, 2.0),
    Tolerance("peak_mib", "peak MiB", 0.25, 20.0),
)
Figures = Mapping[str, float]


def document(rows: Sequence[Measurement]) -> dict[str, Any]:
    """A baseline as its file holds it: the figures that are compared, by recording and detections."""
    return {row.name: {key: round(value, 4) for key, value in _figures(row).items()} for row in rows}


def read_baseline(path: Path | None) -> dict[str, Figures]:
    """The baseline in a file, or the committed one. Raises InputError where a file holds something else."""
    source = resources.files("skytrace.benchmark").joinpath(COMMITTED) if path is None else path
    try:
        found = json.loads(source.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise InputError(path, f"not a baseline: {error}") from error
    if not (isinstance(found, dict) and all(map(_are_figures, found.values()))):
        raise InputError(path, "not a baseline: expected what --save-baseline writes, figures by recording")
    return found


def _are_figures(value: Any) -> bool:
    return isinstance(value, dict) and all(
        isinstance(v, int | float) and not isinstance(v, bool) for v in value.values()
    )


def compare(rows: Sequence[Measurement], baseline: Mapping[str, Figures]) -> list[str]:
    """A sentence for everything that got worse beyond noise, and for every run that failed."""
    sentences = []
    for row in rows:
        if row.failure:
            sentences.append(f"{row.name}: fails: {row.failure}")
            continue
        before, now = baseline.get(row.name, {}), _figures(row)
        for tolerance in TOLERANCES:
            key, words = tolerance.figure, f"{row.name}: {tolerance.words}"
            if key in before and key not in now:
                sentences.append(f"{words} was {before[key]:.4g} and is not known any more")
            elif key in before and tolerance.worse_by(now[key], before[key]):
                sentences.append(f"{words} was {before[key]:.4g} and is {now[key]:.4g}")
    return sentences


def _figures(row: Measurement) -> dict[str, float]:
    values = asdict(row)
    values |= values.pop("errors") or {}
    return {t.figure: values[t.figure] for t in TOLERANCES if values.get(t.figure) is not None}
