"""Still pictures: which files are meant, and their brightness as the sensor recorded it."""

from __future__ import annotations

import glob
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skytrace.errors import InputError

SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm", ".jp2"})
_LEAST_SIDE_PX = 64


def named_files(inputs: Sequence[Path]) -> list[Path]:
    """The files that paths stand for: files themselves, the pictures in folders, what matches patterns such as a/*.jpg.

    Those of a folder or a pattern are in the order of their names, numbers by value. Raises InputError for what is not
    there, or holds no picture.
    """
    files: list[Path] = []
    for path in inputs:
        if path.is_dir():
            found = [p for p in path.iterdir() if p.suffix.lower() in SUFFIXES and not p.name.startswith(".")]
            if not found:
                raise InputError(path, f"no picture in this folder: expected files such as {_kinds()}")
        elif path.is_file():
            found = [path]
        else:
            found = [Path(p) for p in glob.glob(str(path))] if glob.has_magic(str(path)) else []
            if not found:
                raise InputError(path, "no such file, folder or pattern of files")
        files += sorted(found, key=_natural)
    return list(dict.fromkeys(files))


def is_picture(path: Path) -> bool:
    """Whether a file's name says that it is a picture."""
    return path.suffix.lower() in SUFFIXES


def read_grey(path: Path) -> NDArray[np.uint8]:
    """A picture's brightness (h, w), not turned by what its EXIF data say: lenses are calibrated as sensors see.

    Raises InputError for a file that cannot be read.
    """
    import cv2

    try:
        data = np.fromfile(path, np.uint8)
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror}") from None
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        grey = cv2.imdecode(data, flags) if len(data) else None
    except cv2.error:
        grey = None
    if grey is None:
        raise InputError(path, "is no picture that can be read, or is damaged")
    if min(grey.shape) < _LEAST_SIDE_PX:
        raise InputError(path, f"is only {grey.shape[1]} x {grey.shape[0]} px: too small to show a board")
    return np.asarray(grey, np.uint8)


def _natural(path: Path) -> list[tuple[int, int, str]]:
    return [(0, int(p), "") if p.isdigit() else (1, 0, p) for p in re.split(r"(\d+)", path.name) if p]


def _kinds() -> str:
    return ", ".join(sorted(SUFFIXES)[:6])
