"""Choices and options that commands share."""

from __future__ import annotations

import enum
from typing import Annotated

import typer

JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]


class DetectMethod(enum.StrEnum):
    """Choices of --method of detect."""

    tophat = "tophat"
    mog2 = "mog2"


class MotionPrior(enum.StrEnum):
    """Choices of --motion-prior."""

    jerk = "jerk"
    force = "force"
    kinetic = "kinetic"
    none = "none"


class Synchroniser(enum.StrEnum):
    """Choices of --method."""

    exhaustive = "exhaustive"
    paper = "paper"


class Lens(enum.StrEnum):
    """Choices of --model."""

    auto = "auto"
    pinhole = "pinhole"
    fisheye = "fisheye"


class Offsets(enum.StrEnum):
    """Choices of --sync."""

    exhaustive = "exhaustive"
    paper = "paper"
    given = "given"


class DetectionLabels(enum.StrEnum):
    """Choices of --labels."""

    auto = "auto"
    manual = "manual"


class Frame(enum.StrEnum):
    """Choices of --frame."""

    world = "world"
    enu = "enu"
