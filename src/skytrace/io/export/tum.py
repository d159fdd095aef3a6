"""TUM: `time x y z qx qy qz qw` a row, as evo and SLAM benchmarks read it."""

from __future__ import annotations

from skytrace.io.export.columns import remarks
from skytrace.io.export.content import ExportRun, Format

_NO_TURN = "0 0 0 1"


def write_tum(run: ExportRun) -> str:
    """The text of a TUM trajectory; times are seconds since 1970 where the instants are known.

    The target's attitude is not estimated: every orientation is the identity.
    """
    zero_s = 0.0 if run.time_zero is None else run.time_zero.timestamp()
    notes = {**remarks(run), "orientation": "not estimated, always the identity"}
    if run.time_zero is not None:
        notes["time_s"] = "seconds since 1970-01-01 UTC"
    lines = [f"# {key}: {' '.join(text.split())}" for key, text in notes.items() if key != "sigma"]
    lines.append("# time_s x y z qx qy qz qw")
    for time_s, (x, y, z) in zip(run.time_s.tolist(), run.position.tolist(), strict=True):
        lines.append(f"{zero_s + time_s:.6f} {x:.9g} {y:.9g} {z:.9g} {_NO_TURN}")
    return "\n".join(lines) + "\n"


FORMAT = Format("tum", ".tum", "time x y z qx qy qz qw, for evo", write_tum)
