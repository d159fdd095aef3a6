"""`skytrace datasets`: the public recordings as FLIGHT folders."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

from skytrace.datasets import (
    DATASETS,
    FOLDER,
    LICENCE,
    SOURCE,
    Labels,
    fetch_datasets,
    find_dataset,
    is_at_hand,
    write_dataset,
)
from skytrace.errors import InputError


def datasets_command(
    output: Path, names: Sequence[str], labels: Labels | None, data: Path | None, cache: Path | None
) -> None:
    """Write the recordings asked for, or all, with the labels asked for, or either; print where."""
    for name in names:
        find_dataset(name)
    kinds = get_args(Labels) if labels is None else (labels,)
    _say(f"recordings of Li et al. 2020, {SOURCE}, licensed {LICENCE}: for use, not for bundling")
    if data is None:
        chosen = list(names or DATASETS)
        data = fetch_datasets(chosen, kinds, cache, lambda path, k, n: _say(f"{k + 1:>3}/{n} {path}"))
        _say(f"files and licence in {data / FOLDER}")
    else:
        chosen = list(names) or _at_hand(data)
    for name in chosen:
        for kind in kinds:
            print(write_dataset(name, kind, data, output / f"{name}_{kind}"))


def _at_hand(data: Path) -> list[str]:
    found = [name for name in DATASETS if is_at_hand(name, data)]
    if not found:
        raise InputError(
            data / FOLDER,
            "no recording is there: expected folders dataset1, dataset3, ...; leave --data and SKYTRACE_DATA away to "
            "fetch them",
        )
    if absent := [name for name in DATASETS if name not in found]:
        _say(f"not in {data / FOLDER}: {', '.join(absent)}")
    return found


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
