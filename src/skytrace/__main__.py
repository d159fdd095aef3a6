"""The program's entry: light until a command needs more."""

from __future__ import annotations

import os
import sys


def main() -> int:
    """Run the command line; returns the exit code."""
    # The matrices here are small: threads in BLAS would burn CPU time and gain nothing.
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    from skytrace.cli import run

    return run(sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
