"""The command groups that commands register with."""

from __future__ import annotations

import typer

app = typer.Typer(
    name="skytrace",
    help="3D flight trajectories, camera poses and clocks from unsynchronised cameras that see only the flying target.",
    add_completion=False,
    pretty_exceptions_enable=False,
)
import_app = typer.Typer(help="Turn recordings of other programs into FLIGHT folders.")
app.add_typer(import_app, name="import")
benchmark_app = typer.Typer(
    help="Measure the program on the public recordings as the paper did; without a command: `recordings`.",
    invoke_without_command=True,
)
app.add_typer(benchmark_app, name="benchmark")
