"""FLIGHT folders of the public recordings, written from the files under SKYTRACE_DATA."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

Labels = Literal["auto", "manual"]

DEVICES = {
    "dataset1": ("iphone6", "p20pro", "sonyG_1", "sony5n_1920x1080"),
    "dataset3": ("gopro3", "mate7", "mate10_1", "sony5n_1440x1080", "sony5100", "sonyG_2"),
    "dataset4": ("gopro3", "p20pro", "mate7", "mate10_2", "sony5100", "sonyG_2", "sony5n_1440x1080"),
}
COLUMNS = {"auto": "x y frame", "manual": "frame x y"}
RTK_RATE_HZ = 5.0

# Frame of each camera = slope * frame of the reference + intercept, as published (README of the recordings).
SYNCHRONISATION = {
    "dataset1": {
        "cam0": (1.0, 0.0),
        "cam1": (29.838692 / 29.97003, -15.134),
        "cam2": (50.0 / 29.97003, -960.9),
        "cam3": (25.0 / 29.97003, -66.733),
    },
    "dataset3": {
        "cam2": (1.0, 0.0),
        "cam5": (1.6819, -782.45),
        "cam4": (1.0081, 409.59),
        "cam1": (1.0091, 461.99),
        "cam0": (2.0163, -1102.90),
        "cam3": (0.8409, -208.81),
    },
}
POSITION_ROWS = ("cam0", "cam3", "cam2", "cam4", "cam1", "cam5")  # order of dataset3's surveyed centres


def write_real_flight(
    data_dir: Path, dataset: str, labels: Labels, folder: Path, cameras: tuple[int, ...] | None = None
) -> Path:
    """Write the flight.toml of a recording, of all its cameras or of some in a given order; returns its path."""
    root = data_dir / "drone-tracking"
    devices = DEVICES[dataset]
    lines = [f'name = "{dataset} {labels}"']
    for k in cameras if cameras is not None else range(len(devices)):
        lines += [
            "",
            "[[camera]]",
            f'id = "cam{k}"',
            f'calibration = "{root}/calibration/{devices[k]}.json"',
            f'detections = "{root}/{dataset}/detections_{labels}/cam{k}.txt"',
            f'detections_columns = "{COLUMNS[labels]}"',
        ]
    folder.mkdir(parents=True, exist_ok=True)
    truth = root / dataset / "trajectory" / "rtk.txt"
    if truth.is_file():
        lines += ["", "[truth]", f'trajectory = "{truth}"', f"rate_hz = {RTK_RATE_HZ}"]
        lines.append('synchronisation = "synchronisation.csv"')
        rows = [f"{c},{slope},{intercept}" for c, (slope, intercept) in SYNCHRONISATION[dataset].items()]
        (folder / "synchronisation.csv").write_text("\n".join(["camera,slope,intercept", *rows]) + "\n")
    surveyed = root / dataset / "camera-locations" / "campos.txt"
    if surveyed.is_file():
        lines.append('positions = "positions.csv"')
        centres = [row.split() for row in surveyed.read_text().splitlines()]
        rows = [",".join([c, *xyz]) for c, xyz in zip(POSITION_ROWS, centres, strict=True)]
        (folder / "positions.csv").write_text("\n".join(["camera,x,y,z", *rows]) + "\n")
    path = folder / "flight.toml"
    path.write_text("\n".join(lines) + "\n")
    return path
