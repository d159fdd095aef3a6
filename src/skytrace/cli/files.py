"""Single files that commands write."""

from __future__ import annotations

from pathlib import Path

from skytrace.io.atomic import atomic_file


def write_text(path: Path, text: str) -> None:
    """Write a file in one step, so that an interruption leaves none or the old one."""
    with atomic_file(path) as partial:
        partial.write_text(text, encoding="utf-8")
