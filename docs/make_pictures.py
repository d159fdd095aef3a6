"""Draw the README's pictures of dataset1 and dataset3: `SKYTRACE_DATA=... python docs/make_pictures.py`."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

NAMES = ("dataset1", "dataset3")
TARGET = Path(__file__).with_name("images")


def skytrace(*arguments: object) -> None:
    """Run a command to its end, in a process of its own."""
    subprocess.run([sys.executable, "-m", "skytrace", *map(str, arguments)], check=True)


def main() -> None:
    """Reconstruct blind, add the truth, and keep the picture in 3D."""
    if "SKYTRACE_DATA" not in os.environ:
        sys.exit("set SKYTRACE_DATA to the folder that holds drone-tracking/")
    TARGET.mkdir(exist_ok=True)
    with TemporaryDirectory() as folder:
        skytrace("datasets", *NAMES, "-o", folder, "--labels", "auto")
        for name in NAMES:
            flight, run, png = (Path(folder) / f"{name}_{part}" for part in ("auto", "run", "png"))
            skytrace("reconstruct", flight, "-o", run)
            skytrace("report", run, "--flight", flight, "--png", png)
            shutil.copyfile(png / "overview.png", TARGET / f"{name}.png")
            print(TARGET / f"{name}.png")


if __name__ == "__main__":
    main()
