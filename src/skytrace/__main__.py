"""The program's entry: light until a command needs more."""

from __future__ import annotations

import io
import os
import sys

from skytrace import interrupt


def main() -> int:
    """Run the command line; returns the exit code."""
    interrupt.install()
    # The matrices here are small: threads in BLAS would burn CPU time and gain nothing.
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    # A camera's name that the terminal cannot spell is no reason to lose a result.
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    from skytrace.cli import run

    try:
        code = run(sys.argv[1:])
        sys.stdout.flush()
    except BrokenPipeError:
        # The reader (head, less) has seen enough; what is still buffered must not complain at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 1
    interrupt.ignore()
    return code


if __name__ == "__main__":
    sys.exit(main())
