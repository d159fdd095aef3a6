"""The files of the public recordings, fetched from their repository at pinned commits and checked by SHA-256.

registry.csv names each file, the commit that holds it (the automatic detections live only in the repository's history),
its size and checksum. In the cache they lie as in a local copy named by SKYTRACE_DATA.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache as remembered
from importlib.resources import files
from pathlib import Path, PurePosixPath

from skytrace.datasets.flights import find_dataset
from skytrace.datasets.recordings import FOLDER, SOURCE, Labels
from skytrace.errors import InputError

BASE_URL = "https://raw.githubusercontent.com/CenekAlbl/drone-tracking-datasets"
_TIMEOUT_S = 30
_RETRIES = 1

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True)
class RemoteFile:
    """One file of the repository."""

    path: str  # in the repository
    commit: str
    role: str  # detections_auto, detections_manual, truth, calibration, ...
    sha256: str

    @property
    def local(self) -> str:
        """Its place below the folder `drone-tracking`, where both kinds of detections lie side by side."""
        path = PurePosixPath(self.path)
        if self.role.startswith("detections_"):
            path = path.parent.with_name(self.role) / path.name
        elif self.role == "calibration":
            path = PurePosixPath("calibration") / path.name
        return str(path)


@remembered
def registry() -> tuple[RemoteFile, ...]:
    """Every file there is."""
    text = (files("skytrace.datasets") / "registry.csv").read_text("utf-8")
    return tuple(RemoteFile(r["path"], r["commit"], r["role"], r["sha256"]) for r in csv.DictReader(text.splitlines()))


def needed_files(name: str, labels: Sequence[Labels]) -> list[RemoteFile]:
    """What a recording with these labels consists of, the licence first."""
    devices = {f"{device}.json" for device in find_dataset(name).devices}
    roles = {"truth", "camera_positions", *(f"detections_{kind}" for kind in labels)}

    def needed(file: RemoteFile) -> bool:
        path = PurePosixPath(file.path)
        if file.role == "calibration":
            return path.name in devices
        return file.role == "licence" or (file.role in roles and path.parts[0] == name)

    return sorted(filter(needed, registry()), key=lambda file: file.role != "licence")


def fetch_datasets(
    names: Sequence[str],
    labels: Sequence[Labels],
    cache: Path | None = None,
    progress: Progress = lambda path, done, total: None,
) -> Path:
    """Fetch what the cache lacks of some recordings; returns the folder to give as `data` to `write_dataset`.

    `cache` is the user's cache folder where none is given. `progress` hears of each file before it is looked for. A
    file whose checksum is wrong, in the cache or as fetched, is never used. Raises InputError where one cannot be had.
    """
    import pooch

    root = Path(pooch.os_cache("skytrace")) if cache is None else cache.expanduser().resolve()
    wanted = list(dict.fromkeys(file for name in names for file in needed_files(name, labels)))
    store = pooch.create(
        path=root / FOLDER,
        base_url=BASE_URL,
        registry={file.local: f"sha256:{file.sha256}" for file in wanted},
        urls={file.local: f"{BASE_URL}/{file.commit}/{file.path}" for file in wanted},
        retry_if_failed=_RETRIES,
    )
    # What pooch would say of every file is said by `progress`.
    pooch.get_logger().setLevel("ERROR")
    for k, file in enumerate(wanted):
        progress(file.local, k, len(wanted))
        _fetch(store, file, root)
    return root


def _fetch(store, file: RemoteFile, root: Path) -> None:
    import pooch
    import requests

    url = store.get_url(file.local)
    try:
        store.fetch(file.local, downloader=pooch.HTTPDownloader(timeout=_TIMEOUT_S))
    except requests.exceptions.HTTPError as error:
        code = "no answer" if error.response is None else f"{error.response.status_code} {error.response.reason}"
        raise InputError(url, f"the server says {code}; {_elsewhere()}") from None
    except requests.exceptions.RequestException:
        raise InputError(url, f"cannot be fetched: is there a network? {_elsewhere()}") from None
    except ValueError:
        raise InputError(
            url, f"is not the file that was published: its SHA-256 is not {file.sha256}; try again, or {_elsewhere()}"
        ) from None
    except OSError as error:
        raise InputError(root / FOLDER / file.local, f"cannot be written: {error.strerror or error}") from None


def _elsewhere() -> str:
    return (
        f"run this command with --cache FOLDER on a machine that reaches {SOURCE}, copy FOLDER here, and name it by "
        "--data or SKYTRACE_DATA"
    )
