"""The command line: results on stdout, progress and messages on stderr, exit codes 0, 2, 3, 4 and 130."""

from skytrace.cli.app import run

__all__ = ["run"]
