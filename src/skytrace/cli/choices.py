"""Choices and options that commands share."""

from __future__ import annotations

import enum
from pathlib import Path
from typing import Annotated

import typer

JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]

# What is known of a flight, to judge a run by.
TruthOption = Annotated[Path | None, typer.Option(help="True positions, x y z in metres a row.")]
RateOption = Annotated[
    float | None, typer.Option(min=0.001, help="Rows of the truth a second, where it has no column time_s.")
]
PositionsOption = Annotated[Path | None, typer.Option(help="Known camera centres: CSV camera,x,y,z.")]
SynchronisationOption = Annotated[Path | None, typer.Option(help="Known synchronisation: CSV camera,slope,intercept.")]
OrientationsOption = Annotated[
    Path | None, typer.Option(help="Known camera orientations: JSON as a run's cameras.json.")
]
TruthFlightOption = Annotated[Path | None, typer.Option(help="FLIGHT whose [truth] to use.")]


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
