"""TRC: marker trajectories of OpenSim and biomechanics, tab-separated, at a constant rate."""

from __future__ import annotations

import math

import numpy as np

from skytrace.errors import InputError
from skytrace.io.export.content import ExportRun, Format

_MARKER = "target"


def write_trc(run: ExportRun) -> str:
    """The text of a TRC file with one marker, in metres. Samples in gaps are empty cells, as OpenSim leaves them.

    Raises InputError where the run is shorter than two samples.
    """
    n = len(run.time_s)
    if n < 2:
        raise InputError(run.name, "too short for trc at this rate: give a higher --rate")
    rate = f"{(n - 1) / (run.time_s[-1] - run.time_s[0]):.6g}"
    names = ("DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", "OrigDataRate", "OrigDataStartFrame")
    values = (rate, rate, str(n), "1", "m", rate, "1")
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{' '.join(run.name.split())}.trc",
        "\t".join([*names, "OrigNumFrames"]),
        "\t".join([*values, str(n)]),
        f"Frame#\tTime\t{_MARKER}\t\t",
        "\t\tX1\tY1\tZ1",
        "",
    ]
    for k, (time_s, place) in enumerate(zip(run.time_s.tolist(), run.position.tolist(), strict=True), 1):
        cells = [f"{x:.6f}" if math.isfinite(x) else "" for x in place]
        lines.append("\t".join([str(k), f"{np.round(time_s, 6):.6f}", *cells]))
    return "\n".join(lines) + "\n"


FORMAT = Format("trc", ".trc", "one marker at a constant rate, for OpenSim", write_trc, needs="metres", gaps="always")
