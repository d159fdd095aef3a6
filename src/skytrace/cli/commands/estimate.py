"""From measurements to estimates: the commands that calibrate, detect, synchronise and reconstruct."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from skytrace.cli.apps import app
from skytrace.cli.choices import DetectMethod, JsonOption, Lens, MotionPrior, Offsets, Synchroniser


@app.command()
def reconstruct(
    flights: Annotated[
        list[Path],
        typer.Argument(
            metavar="FLIGHT...",
            help="Folders with flight.toml, or these files. Several are reconstructed together: they share what "
            "belongs to the devices that filmed more than one of them.",
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="RUN folder to write; of several flights a folder of them.")
    ],
    motion_prior: Annotated[MotionPrior, typer.Option(help="What the trajectory is held to.")] = MotionPrior.jerk,
    motion_prior_weight: Annotated[
        float | None,
        typer.Option(
            metavar="W",
            help="How strongly, with lengths in sizes of the flight (see summary.json for the automatic weight); "
            "default: automatic.",
        ),
    ] = None,
    no_rolling_shutter: Annotated[
        bool, typer.Option("--no-rolling-shutter", help="Keep the readout times at their assumed values.")
    ] = False,
    fix_focal: Annotated[
        bool, typer.Option("--fix-focal", help="Keep focal lengths as calibrated; the rest of a lens may change.")
    ] = False,
    fix_lens: Annotated[
        bool, typer.Option("--fix-lens", help="Keep lenses as calibrated, focal lengths included, as the paper does.")
    ] = False,
    min_cameras: Annotated[
        int | None, typer.Option(min=2, help="Cameras that must agree where the trajectory is claimed; default: 2.")
    ] = None,
    max_sigma_ratio: Annotated[
        float | None,
        typer.Option(
            metavar="RATIO",
            help="Claim nothing whose posterior deviation is more than so many times the median; default: 5.",
        ),
    ] = None,
    sync: Annotated[
        Offsets,
        typer.Option(help="Offsets searched everywhere, near the offset_s given as the paper does it, or as given."),
    ] = Offsets.exhaustive,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random sampling.")] = 0,
    as_json: JsonOption = False,
) -> None:
    """Turn 2D tracks and calibrations into a trajectory, camera poses and clocks."""
    from skytrace.cli.reconstruct import Options, reconstruct_command

    options = Options(
        motion_prior.value,
        motion_prior_weight,
        not no_rolling_shutter,
        fix_focal,
        fix_lens,
        min_cameras,
        max_sigma_ratio,
        sync.value,
        seed,
    )
    reconstruct_command(flights, output, options, as_json)


@app.command()
def sync(
    flight: Annotated[Path, typer.Argument(metavar="FLIGHT", help="Folder with flight.toml, or that file.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="JSON file to write.")],
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random sampling.")] = 0,
    report: Annotated[
        Path | None, typer.Option(metavar="PAGE.html", help="Page to write: who is tied to whom, and the evidence.")
    ] = None,
    method: Annotated[
        Synchroniser,
        typer.Option(help="Search every offset, or as the paper does it near the offset_s of every camera."),
    ] = Synchroniser.exhaustive,
    as_json: JsonOption = False,
) -> None:
    """Find when each camera filmed, and how sure that is, without reconstructing anything."""
    from skytrace.cli.sync import sync_command

    sync_command(flight, output, seed, as_json, report, method.value)


@app.command()
def detect(
    videos: Annotated[list[Path], typer.Argument(metavar="VIDEO...", help="Videos of cameras that stand still.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="TRACKS file to write (CSV); of several videos a folder for them.")
    ],
    method: Annotated[DetectMethod, typer.Option(help="How targets are told from the background.")] = (
        DetectMethod.tophat
    ),
    mask: Annotated[
        Path | None, typer.Option(help="Picture of the video's size, black where nothing is to be found.")
    ] = None,
    preview: Annotated[
        Path | None,
        typer.Option(help="Contact sheet (.png) or video (.mp4) of what was found; of several videos a folder."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Find and track what flies in videos, several at once; those done before are not done again."""
    from skytrace.cli.detect import detect_command

    detect_command(videos, output, method.value, mask, preview, as_json)


@app.command()
def calibrate(
    pictures: Annotated[
        list[Path],
        typer.Argument(metavar="PICTURES...", help="Pictures or videos of a board; folders or patterns of pictures."),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Calibration to write (JSON).")],
    board: Annotated[
        str | None, typer.Option(metavar="8x7", help="Squares of the board along its sides; found out by default.")
    ] = None,
    model: Annotated[
        Lens, typer.Option(help="Lens model; by default the one that explains the pictures better.")
    ] = Lens.auto,
    report: Annotated[
        Path | None, typer.Option(metavar="PAGE.html", help="Page to write: coverage, residuals, every picture.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random halves.")] = 0,
    as_json: JsonOption = False,
) -> None:
    """Calibrate a lens from pictures of a chessboard or ChArUco board."""
    from skytrace.cli.calibrate import calibrate_command

    calibrate_command(pictures, output, board, None if model is Lens.auto else model.value, report, seed, as_json)
