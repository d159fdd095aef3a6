"""The command line: running one, its errors, and what holds for all commands."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Sequence
from typing import Annotated

import typer

from skytrace.cli.apps import app
from skytrace.cli.commands import estimate, material, measure, results
from skytrace.errors import InputError, SkytraceError

# Commands register where they are imported.
__all__ = ["app", "estimate", "material", "measure", "results", "run"]

USAGE, INTERRUPTED = 2, 130


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
