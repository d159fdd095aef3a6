"""`skytrace datasets`: the public recordings as FLIGHT folders."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import get_args

from skytrace.datasets import DATASETS, Labels, write_dataset
from skytrace.errors import InputError


def datasets_command(output: Path, data: Path | None) -> None:
    """Write every recording that is there, with either kind of labels, and print where."""
    if data is None:
        raise InputError(
            "--data",
            "say where the recordings lie (or set SKYTRACE_DATA): a folder with drone-tracking/ inside, as in "
            "github.com/CenekAlbl/drone-tracking-datasets",
        )
    print("These recordings are licensed CC BY-NC-SA 4.0: for use, not for bundling.", file=sys.stderr)
    for name in DATASETS:
        for labels in get_args(Labels):
            print(write_dataset(name, labels, data, output / f"{name}_{labels}"))
