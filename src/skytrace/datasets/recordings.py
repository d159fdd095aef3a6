"""The public recordings of Li et al. (IROS 2020): who filmed, and what is known of the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

Labels = Literal["auto", "manual"]  # by the paper's detector, or by hand
SOURCE = "github.com/CenekAlbl/drone-tracking-datasets"
LICENCE = "CC BY-NC-SA 4.0"
FOLDER = "drone-tracking"  # of the files, in SKYTRACE_DATA and in the cache
RTK_RATE_HZ = 5.0


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
        "dataset2": Dataset(("iphone6", "p20pro", "sonyG_1", "sony5n_1920x1080")),
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
