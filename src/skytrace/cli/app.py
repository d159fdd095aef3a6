"""The commands and their options; each imports what it needs when it runs, so that --help answers at once."""

from __future__ import annotations

import contextlib
import enum
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from skytrace.errors import InputError, SkytraceError

app = typer.Typer(
    name="skytrace",
    help="3D flight trajectories, camera poses and clocks from unsynchronised cameras that see only the flying target.",
    add_completion=False,
    pretty_exceptions_enable=False,
)
import_app = typer.Typer(help="Turn recordings of other programs into FLIGHT folders.")
app.add_typer(import_app, name="import")
benchmark_app = typer.Typer(help="Measure the program on the public recordings as the paper did.")
app.add_typer(benchmark_app, name="benchmark")

USAGE, INTERRUPTED = 2, 130
JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]


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


class Offsets(enum.StrEnum):
    """Choices of --sync."""

    exhaustive = "exhaustive"
    paper = "paper"
    given = "given"


def run(arguments: Sequence[str]) -> int:
    """Run a command line; every foreseen error becomes one message on stderr and an exit code."""
    if not arguments:
        with contextlib.redirect_stdout(sys.stderr):
            _invoke(["--help"])
        return USAGE
    try:
        result = _invoke(arguments)
    except SkytraceError as error:
        print(f"skytrace: {error}", file=sys.stderr)
        return error.exit_code
    except (KeyboardInterrupt, typer.Abort):
        result = INTERRUPTED
    except typer.Exit as stop:
        result = stop.exit_code
    except SystemError as error:
        # How Python reports an interrupt that reached it inside an extension module.
        if not isinstance(error.__cause__, KeyboardInterrupt):
            raise
        result = INTERRUPTED
    except OSError as error:
        # A folder that may not be searched, a disk that is full: nothing a traceback would help with.
        if error.filename is None:
            raise
        print(f"skytrace: {error.filename}: {error.strerror}", file=sys.stderr)
        return InputError.exit_code
    except Exception as error:
        # Click's usage errors know how to show themselves; anything else is a bug and keeps its traceback.
        show = getattr(error, "show", None)
        if show is None:
            raise
        show(file=sys.stderr)
        return int(getattr(error, "exit_code", USAGE))
    # Some versions of typer turn Ctrl-C into Abort, others return its exit code.
    if result == INTERRUPTED:
        print("skytrace: interrupted; nothing half-written is left behind", file=sys.stderr)
    return int(result) if isinstance(result, int) else 0


def _invoke(arguments: Sequence[str]) -> object:
    return app(list(arguments), prog_name="skytrace", standalone_mode=False)


def _version(value: bool) -> None:
    if value:
        from skytrace import __version__

        print(__version__)
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """3D flight trajectories, camera poses and clocks from unsynchronised cameras that see only the flying target."""


@app.command()
def reconstruct(
    flight: Annotated[Path, typer.Argument(metavar="FLIGHT", help="Folder with flight.toml, or that file.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="RUN folder to write.")],
    motion_prior: Annotated[MotionPrior, typer.Option(help="What the trajectory is held to.")] = MotionPrior.jerk,
    no_rolling_shutter: Annotated[
        bool, typer.Option("--no-rolling-shutter", help="Keep the readout times at their assumed values.")
    ] = False,
    fix_focal: Annotated[
        bool, typer.Option("--fix-focal", help="Keep focal lengths and lenses as calibrated.")
    ] = False,
    sync: Annotated[
        Offsets,
        typer.Option(help="Offsets searched everywhere, near the offset_s given as the paper does it, or as given."),
    ] = Offsets.exhaustive,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random sampling.")] = 0,
    as_json: JsonOption = False,
) -> None:
    """Turn 2D tracks and calibrations into a trajectory, camera poses and clocks."""
    from skytrace.cli.reconstruct import reconstruct_command

    reconstruct_command(
        flight, output, motion_prior.value, not no_rolling_shutter, not fix_focal, seed, as_json, sync.value
    )


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
def evaluate(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="Folder written by reconstruct.")],
    truth: Annotated[Path | None, typer.Option(help="True positions, x y z in metres a row.")] = None,
    rate: Annotated[
        float | None, typer.Option(min=0.001, help="Rows of the truth a second, where it has no column time_s.")
    ] = None,
    positions: Annotated[Path | None, typer.Option(help="Known camera centres: CSV camera,x,y,z.")] = None,
    synchronisation: Annotated[
        Path | None, typer.Option(help="Known synchronisation: CSV camera,slope,intercept.")
    ] = None,
    flight: Annotated[Path | None, typer.Option(help="FLIGHT whose [truth] to use.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Compare a run with the truth: fits the truth's clock and a similarity, and prints the errors."""
    from skytrace.cli.evaluate import evaluate_command

    evaluate_command(run_folder, truth, rate, positions, synchronisation, flight, as_json)


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
    data: Annotated[
        Path | None, typer.Option(envvar="SKYTRACE_DATA", help="Folder that holds drone-tracking/.")
    ] = None,
) -> None:
    """Write FLIGHT folders of the public recordings from a local copy of their files."""
    from skytrace.cli.datasets import datasets_command

    datasets_command(output, data)


@import_app.command("mvus")
def import_mvus(
    config: Annotated[Path, typer.Argument(metavar="CONFIG.json", help="Configuration of the paper's code.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="FLIGHT folder to write.")],
) -> None:
    """Turn a configuration of the paper's code into a FLIGHT folder."""
    from skytrace.io.mvus import import_mvus as convert

    print(convert(config, output))


@benchmark_app.command("sync")
def benchmark_sync(
    data: Annotated[
        Path | None, typer.Option(envvar="SKYTRACE_DATA", help="Folder that holds drone-tracking/.")
    ] = None,
    shifts: Annotated[
        str | None, typer.Option(metavar="FRAMES", help="Errors of the rough offsets, such as 5,50,500.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random sampling.")] = 0,
    json_file: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Also write all figures.")] = None,
    markdown: Annotated[Path | None, typer.Option(metavar="FILE", help="Also write the table as Markdown.")] = None,
) -> None:
    """The paper's experiment on the importance of pairwise synchronisation, on dataset3."""
    from skytrace.cli.benchmark import sync_benchmark_command

    sync_benchmark_command(data, shifts, seed, json_file, markdown)
