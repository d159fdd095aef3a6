"""FLIGHT folders of the public recordings, which name the files where they lie."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import get_args

from skytrace.datasets.recordings import DATASETS, FOLDER, RTK_RATE_HZ, SOURCE, Dataset, Labels
from skytrace.errors import InputError
from skytrace.io.atomic import atomic_folder
from skytrace.io.text import did_you_mean
from skytrace.io.toml import toml_string

_COLUMNS: Mapping[str, str] = MappingProxyType({"auto": "x y frame", "manual": "frame x y"})


def write_dataset(
    name: str, labels: Labels, data: Path, destination: Path, cameras: tuple[int, ...] | None = None
) -> Path:
    """Write the FLIGHT folder of a recording from the files under `data`/drone-tracking; returns its flight.toml.

    `cameras` are the indices of those to take, in the order wanted; None takes all. The detections and calibrations are
    named where they lie, not copied. Raises InputError for an unknown recording or files that are not there.
    """
    dataset, root = find_dataset(name), data.resolve() / FOLDER
    if labels not in get_args(Labels):
        raise InputError(labels, f"no such labels: expected one of {', '.join(get_args(Labels))}")
    if not is_at_hand(name, data):
        raise InputError(
            root / name,
            f"the recording is not there: leave --data and SKYTRACE_DATA away to fetch it from {SOURCE}, or point them "
            f"at a folder that holds {FOLDER}/{name}",
        )
    chosen = range(len(dataset.devices)) if cameras is None else cameras
    with atomic_folder(destination, replace_run=False) as folder:
        (folder / "flight.toml").write_text(_flight_toml(name, dataset, labels, root, tuple(chosen)))
        if dataset.synchronisation:
            rows = [f"{c},{slope!r},{intercept!r}" for c, (slope, intercept) in dataset.synchronisation.items()]
            (folder / "synchronisation.csv").write_text("\n".join(["camera,slope,intercept", *rows]) + "\n")
        if dataset.surveyed:
            (folder / "positions.csv").write_text(_positions_csv(dataset, root / name))
    return destination / "flight.toml"


def find_dataset(name: str) -> Dataset:
    """The recording of a name. Raises InputError where there is none."""
    if name not in DATASETS:
        raise InputError(
            name, f"no such recording{did_you_mean(name, DATASETS)}: expected one of {', '.join(DATASETS)}"
        )
    return DATASETS[name]


def is_at_hand(name: str, data: Path) -> bool:
    """Whether a recording's files lie under `data`."""
    return (data / FOLDER / name).is_dir()


def _flight_toml(name: str, dataset: Dataset, labels: Labels, root: Path, cameras: tuple[int, ...]) -> str:
    lines = [f'name = "{name} {labels}"']
    for k in cameras:
        lines += [
            "",
            "[[camera]]",
            f'id = "cam{k}"',
            f"calibration = {toml_string(f'{root}/calibration/{dataset.devices[k]}.json')}",
            f"detections = {toml_string(f'{root}/{name}/detections_{labels}/cam{k}.txt')}",
            f'detections_columns = "{_COLUMNS[labels]}"',
        ]
    truth = root / name / "trajectory" / "rtk.txt"
    if truth.is_file():
        lines += ["", "[truth]", f"trajectory = {toml_string(str(truth))}", f"rate_hz = {RTK_RATE_HZ}"]
        if dataset.synchronisation:
            lines.append('synchronisation = "synchronisation.csv"')
        if dataset.surveyed:
            lines.append('positions = "positions.csv"')
    return "\n".join(lines) + "\n"


def _positions_csv(dataset: Dataset, folder: Path) -> str:
    path = folder / "camera-locations" / "campos.txt"
    rows = [line.split() for line in path.read_text().splitlines() if line.strip()]
    if len(rows) != len(dataset.surveyed):
        raise InputError(path, f"expected {len(dataset.surveyed)} rows of x y z, found {len(rows)}")
    lines = [",".join([c, *xyz]) for c, xyz in zip(dataset.surveyed, rows, strict=True)]
    return "\n".join(["camera,x,y,z", *lines]) + "\n"
