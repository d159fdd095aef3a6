"""Several RUN folders in one: what flights that were reconstructed together are written to."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from skytrace.io.atomic import FLIGHTS_FORMAT, MANIFEST, atomic_folder
from skytrace.io.run_folder import SUMMARY, json_text


def folder_name(flight: str) -> str:
    """The name of a flight as that of a folder: letters, digits, spaces and `.+-_` stay."""
    return re.sub(r"[^\w .+-]", "_", flight).strip(" .") or "_"


def write_flights(
    destination: Path | str,
    runs: Mapping[str, Callable[[Path], None]],
    summary: Mapping[str, Any],
    manifest: Mapping[str, Any],
) -> None:
    """Write a folder with the runs of several flights and what they have in common, whole or not at all.

    `runs` write a RUN folder each, by its name. Raises InputError where the destination is something other than an
    earlier run or an empty folder.
    """
    with atomic_folder(destination) as folder:
        for name, write in runs.items():
            write(folder / name)
        (folder / SUMMARY).write_text(json_text(summary) + "\n", encoding="utf-8", newline="\n")
        text = json_text({**manifest, "format": FLIGHTS_FORMAT}) + "\n"
        (folder / MANIFEST).write_text(text, encoding="utf-8", newline="\n")
