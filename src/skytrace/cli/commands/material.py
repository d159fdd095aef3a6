"""Where flights come from: simulation, the public recordings, other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from skytrace.cli.apps import app, import_app
from skytrace.cli.choices import DetectionLabels


@app.command()
def simulate(
    output: Annotated[Path, typer.Option("--output", "-o", help="FLIGHT folder to write, truth included.")],
    preset: Annotated[str, typer.Option(help="Kind of flight; an unknown name lists them all.")] = "demo",
    cameras: Annotated[int | None, typer.Option(min=2, max=12, help="Number of cameras.")] = None,
    duration: Annotated[float | None, typer.Option(min=1, help="Length of the flight in seconds.")] = None,
    noise: Annotated[float | None, typer.Option(min=0, help="Noise of the detections in pixels.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulation.")] = 0,
    video: Annotated[bool, typer.Option("--video", help="Write videos of the flight instead of detections.")] = False,
    video_size: Annotated[
        str | None, typer.Option(metavar="WxH", help="Size of every video, such as 1920x1080.")
    ] = None,
    video_fps: Annotated[float | None, typer.Option(min=1, max=1000, help="Nominal frame rate of every video.")] = None,
    distractors: Annotated[
        bool, typer.Option("--distractors", help="Birds, insects and blinking lamps in the videos.")
    ] = False,
) -> None:
    """Write a simulated flight with known truth, as detections or as videos."""
    from skytrace.cli.simulate import VideoOptions, simulate_command

    options = VideoOptions(video_size, video_fps, distractors)
    simulate_command(output, preset, cameras, duration, noise, seed, video, options)


@app.command()
def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the flight and its run.")] = Path(
        "skytrace-demo"
    ),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated flight.")] = 0,
) -> None:
    """Simulate a four-camera flight, reconstruct it blind, and print the errors against the truth."""
    from skytrace.cli.demo import demo_command

    demo_command(output, seed)


@app.command()
def datasets(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the FLIGHT folders.")],
    names: Annotated[
        list[str] | None, typer.Argument(metavar="NAME", help="Recordings, such as dataset3; default: all.")
    ] = None,
    labels: Annotated[
        DetectionLabels | None, typer.Option(help="Detections by the paper's detector or by hand; default: both.")
    ] = None,
    data: Annotated[
        Path | None,
        typer.Option(envvar="SKYTRACE_DATA", help="Folder that holds drone-tracking/; nothing is fetched then."),
    ] = None,
    cache: Annotated[
        Path | None, typer.Option(help="Where fetched files are kept; default: the user's cache folder.")
    ] = None,
) -> None:
    """Write FLIGHT folders of the public recordings, with their truth; files not at hand are fetched."""
    from skytrace.cli.datasets import datasets_command

    datasets_command(output, names or [], None if labels is None else labels.value, data, cache)


@import_app.command("mvus")
def import_mvus(
    config: Annotated[Path, typer.Argument(metavar="CONFIG.json", help="Configuration of the paper's code.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="FLIGHT folder to write.")],
) -> None:
    """Turn a configuration of the paper's code into a FLIGHT folder."""
    from skytrace.io.mvus import import_mvus as convert

    print(convert(config, output))
