"""The public recordings of Li et al. (IROS 2020) as FLIGHT folders, from a local copy of their files.

Recordings: github.com/CenekAlbl/drone-tracking-datasets, CC BY-NC-SA 4.0: for use, not for bundling.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Literal, get_args

from skytrace.errors import InputError
from skytrace.io.atomic import atomic_folder

Labels = Literal["auto", "manual"]
RTK_RATE_HZ = 5.0
_COLUMNS: Mapping[str, str] = MappingProxyType({"auto": "x y frame", "manual": "frame x y"})


@dataclass(frozen=True, slots=True)
class Dataset:
    """Which device filmed as cam0, cam1, ..., and what is known of the truth."""

    devices: tuple[str, ...]
    # Frame of a camera = slope * frame of the reference + intercept; used to judge results, never to make them.
    synchronisation: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    surveyed: tuple[str, ...] = ()  # cameras in the order of the rows of camera-locations/campos.txt


DATASETS: Mapping[str, Dataset] = MappingProxyType(
    {
        "dataset1": Dataset(
            ("iphone6", "p20pro", "sonyG_1", "sony5n_1920x1080"),
            # Corresponding frames of the authors' configuration, at the nominal frame rates.
            {
                "cam0": (1.0, 0.0),
                "cam1": (29.838692 / 29.97003, -15.134),
                "cam2": (50.0 / 29.97003, -960.9),
                "cam3": (25.0 / 29.97003, -66.733),
            },
        ),
        "dataset3": Dataset(
            ("gopro3", "mate7", "mate10_1", "sony5n_1440x1080", "sony5100", "sonyG_2"),
            # From synchronised LED flashes.
            {
                "cam2": (1.0, 0.0),
                "cam5": (1.6819, -782.45),
                "cam4": (1.0081, 409.59),
                "cam1": (1.0091, 461.99),
                "cam0": (2.0163, -1102.90),
                "cam3": (0.8409, -208.81),
            },
            ("cam0", "cam3", "cam2", "cam4", "cam1", "cam5"),
        ),
        "dataset4": Dataset(("gopro3", "p20pro", "mate7", "mate10_2", "sony5100", "sonyG_2", "sony5n_1440x1080")),
    }
)


def write_dataset(
    name: str, labels: Labels, data: Path, destination: Path, cameras: tuple[int, ...] | None = None
) -> Path:
    """Write the FLIGHT folder of a recording from the files under `data`/drone-tracking; returns its flight.toml.

    `cameras` are the indices of those to take, in the order wanted; None takes all. The detections and calibrations are
    named where they lie, not copied. Raises InputError for an unknown recording or files that are not there.
    """
    if name not in DATASETS:
        raise InputError(name, f"no such recording: expected one of {', '.join(DATASETS)}")
    if labels not in get_args(Labels):
        raise InputError(labels, f"no such labels: expected one of {', '.join(get_args(Labels))}")
    dataset, root = DATASETS[name], data.resolve() / "drone-tracking"
    if not (root / name).is_dir():
        raise InputError(
            root / name,
            "the recording is not there: get it from github.com/CenekAlbl/drone-tracking-datasets and point --data, or "
            "SKYTRACE_DATA, at the folder that holds drone-tracking/",
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


def _flight_toml(name: str, dataset: Dataset, labels: Labels, root: Path, cameras: tuple[int, ...]) -> str:
    lines = [f'name = "{name} {labels}"']
    for k in cameras:
        lines += [
            "",
            "[[camera]]",
            f'id = "cam{k}"',
            f'calibration = "{root}/calibration/{dataset.devices[k]}.json"',
            f'detections = "{root}/{name}/detections_{labels}/cam{k}.txt"',
            f'detections_columns = "{_COLUMNS[labels]}"',
        ]
    truth = root / name / "trajectory" / "rtk.txt"
    if truth.is_file():
        lines += ["", "[truth]", f'trajectory = "{truth}"', f"rate_hz = {RTK_RATE_HZ}"]
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
