"""The public recordings of Li et al. (IROS 2020) as FLIGHT folders, from a local copy of their files or fetched.

They are licensed CC BY-NC-SA 4.0: for use, not for bundling. The package holds their names and checksums only.
"""

from skytrace.datasets.download import fetch_datasets
from skytrace.datasets.flights import find_dataset, is_at_hand, write_dataset
from skytrace.datasets.recordings import DATASETS, FOLDER, LICENCE, RTK_RATE_HZ, SOURCE, Dataset, Labels

__all__ = [
    "DATASETS",
    "FOLDER",
    "LICENCE",
    "RTK_RATE_HZ",
    "SOURCE",
    "Dataset",
    "Labels",
    "fetch_datasets",
    "find_dataset",
    "is_at_hand",
    "write_dataset",
]
