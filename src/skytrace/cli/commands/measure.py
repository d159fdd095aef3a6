"""`skytrace benchmark`: the program measured on the public recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from skytrace.cli.apps import benchmark_app
from skytrace.cli.choices import DetectionLabels


@benchmark_app.callback()
def benchmark(context: typer.Context) -> None:
    """Measure the program on the public recordings as the paper did; without a command: `recordings`."""
    if context.invoked_subcommand is None:
        import os

        from skytrace.cli.benchmark import recordings_benchmark_command

        data = os.environ.get("SKYTRACE_DATA")
        recordings_benchmark_command(Path(data) if data else None, None, None, None, None, None, False)


@benchmark_app.command("recordings")
def benchmark_recordings(
    data: Annotated[
        Path | None, typer.Option(envvar="SKYTRACE_DATA", help="Folder that holds drone-tracking/.")
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Also write all figures.")] = None,
    csv_file: Annotated[Path | None, typer.Option("--csv", metavar="FILE", help="Also write them as CSV.")] = None,
    markdown: Annotated[Path | None, typer.Option(metavar="FILE", help="Also write the table as Markdown.")] = None,
    baseline: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Figures to compare with; default: the committed ones.")
    ] = None,
    save_baseline: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the figures for a later --baseline.")
    ] = None,
    strict: Annotated[bool, typer.Option("--strict", help="Exit with 1 where anything got worse or failed.")] = False,
) -> None:
    """Reconstruct every recording: accuracy, coverage and cost beside the paper's, and what got worse."""
    from skytrace.cli.benchmark import recordings_benchmark_command

    recordings_benchmark_command(data, json_file, csv_file, markdown, baseline, save_baseline, strict)


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


@benchmark_app.command("calibration")
def benchmark_calibration(
    data: Annotated[
        Path | None, typer.Option(envvar="SKYTRACE_DATA", help="Folder that holds drone-tracking/.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random sampling.")] = 0,
    json_file: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Also write all figures.")] = None,
    markdown: Annotated[Path | None, typer.Option(metavar="FILE", help="Also write the tables as Markdown.")] = None,
) -> None:
    """Calibrate the six lenses of dataset3 from their photographs, and reconstruct the flight with them."""
    from skytrace.cli.benchmark import calibration_benchmark_command

    calibration_benchmark_command(data, seed, json_file, markdown)


@benchmark_app.command("ablation")
def benchmark_ablation(
    flights: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="FLIGHT...", help="FLIGHT folders with truth; default: the public recordings with truth."
        ),
    ] = None,
    data: Annotated[
        Path | None, typer.Option(envvar="SKYTRACE_DATA", help="Folder that holds drone-tracking/.")
    ] = None,
    labels: Annotated[
        DetectionLabels, typer.Option(help="Of the recordings: detections by the paper's detector or by hand.")
    ] = DetectionLabels.auto,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random sampling.")] = 0,
    json_file: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Also write all figures.")] = None,
    markdown: Annotated[Path | None, typer.Option(metavar="FILE", help="Also write the table as Markdown.")] = None,
) -> None:
    """The paper's table of motion priors with and without rolling shutter, lenses calibrated and refined."""
    from skytrace.cli.benchmark import ablation_benchmark_command

    ablation_benchmark_command(flights or [], data, labels.value, seed, json_file, markdown)
