"""What is done with a finished run: judging, showing, placing on the earth, handing on."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from skytrace.cli.apps import app
from skytrace.cli.choices import (
    Frame,
    JsonOption,
    OrientationsOption,
    PositionsOption,
    RateOption,
    SynchronisationOption,
    TruthFlightOption,
    TruthOption,
)


@app.command()
def evaluate(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="Folder written by reconstruct.")],
    truth: TruthOption = None,
    rate: RateOption = None,
    positions: PositionsOption = None,
    synchronisation: SynchronisationOption = None,
    orientations: OrientationsOption = None,
    flight: TruthFlightOption = None,
    as_json: JsonOption = False,
) -> None:
    """Compare a run with the truth: fits the truth's clock and a similarity, and prints the errors."""
    from skytrace.cli.evaluate import TruthFiles, evaluate_command

    evaluate_command(run_folder, TruthFiles(truth, rate, positions, orientations, synchronisation, flight), as_json)


@app.command()
def report(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="Folder written by reconstruct.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="PAGE.html", help="Page to write; default: the RUN's own.")
    ] = None,
    png: Annotated[
        Path | None, typer.Option("--png", metavar="DIR", help="Folder for pictures (PNG); needs skytrace[png].")
    ] = None,
    truth: TruthOption = None,
    rate: RateOption = None,
    positions: PositionsOption = None,
    synchronisation: SynchronisationOption = None,
    orientations: OrientationsOption = None,
    flight: TruthFlightOption = None,
) -> None:
    """Add the truth to a run's report, and draw pictures for papers."""
    from skytrace.cli.evaluate import TruthFiles
    from skytrace.cli.report import report_command

    files = TruthFiles(truth, rate, positions, orientations, synchronisation, flight)
    report_command(run_folder, output, png, files)


@app.command()
def georeference(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="Folder written by reconstruct.")],
    cameras: Annotated[
        Path | None, typer.Option(metavar="CSV", help="Places of cameras: camera,latitude_deg,longitude_deg,height_m.")
    ] = None,
    points: Annotated[
        Path | None, typer.Option(metavar="CSV", help="Places of the target on the run's clock: time_s and as above.")
    ] = None,
    log: Annotated[
        Path | None, typer.Option(metavar="CSV", help="The target's own GNSS log, on any clock: time_s and as above.")
    ] = None,
    origin: Annotated[
        str | None,
        typer.Option(metavar="LAT,LON,HEIGHT", help="Origin of places given in metres (x,y,z: east, north, up)."),
    ] = None,
    vertical_datum: Annotated[
        str | None, typer.Option(help="What the given heights count from; default: the WGS84 ellipsoid.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Find where on the earth a run lies, from known places; export then writes east, north, up and WGS84."""
    from skytrace.cli.georeference import georeference_command

    georeference_command(run_folder, cameras, points, log, origin, vertical_datum, as_json)


@app.command()
def export(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="Folder written by reconstruct.")],
    to: Annotated[
        str, typer.Option("--to", metavar="FORMAT", help="csv, parquet, tum, gpx, kml, geojson, colmap, mvus or trc.")
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File to write (colmap: folder); default: stdout.")
    ] = None,
    rate: Annotated[
        float | None, typer.Option(min=0.001, help="Samples a second; default: the format's own, or as stored.")
    ] = None,
    frame: Annotated[
        Frame | None, typer.Option(help="Frame of x, y, z; default: east, north, up where the run is georeferenced.")
    ] = None,
    time_zero: Annotated[
        str | None,
        typer.Option(
            metavar="start|INSTANT",
            help="Count time from the first sample, or say when the reference camera's clock was 0, such as "
            "2024-05-03T10:15:00Z.",
        ),
    ] = None,
    with_gaps: Annotated[
        bool, typer.Option("--with-gaps", help="Rows between covered stretches too, without values (csv, parquet).")
    ] = False,
    no_deviations: Annotated[bool, typer.Option("--no-deviations", help="Leave the posterior deviations out.")] = False,
) -> None:
    """Write a run's trajectory and cameras in the format of another program."""
    from skytrace.cli.export import export_command

    export_command(
        run_folder, to, output, rate, None if frame is None else frame.value, time_zero, with_gaps, not no_deviations
    )
