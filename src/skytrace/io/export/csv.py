"""CSV: one row a sample; `#` lines say unit, frame and clock."""

from __future__ import annotations

import math

from skytrace.io.export.columns import columns, remarks
from skytrace.io.export.content import ExportRun, Format

_DIGITS = {"latitude_deg": "%.10f", "longitude_deg": "%.10f", "height_m": "%.5f"}


def write_csv(run: ExportRun) -> str:
    """The text of a CSV; what is not known is left empty."""
    table = columns(run)
    texts = [_cells(name, values) for name, values in table.items()]
    lines = [f"# {key}: {' '.join(text.split())}" for key, text in remarks(run).items()]
    rows = (",".join(row) for row in zip(*texts, strict=True))
    return "\n".join([*lines, ",".join(table), *rows]) + "\n"


def _cells(name: str, values) -> list[str]:
    if name == "time_utc":
        return list(values)
    if values.dtype.kind == "i":
        return [str(v) for v in values.tolist()]
    digits = _DIGITS.get(name, "%.12g")
    return [digits % v if math.isfinite(v) else "" for v in values.tolist()]


FORMAT = Format("csv", ".csv", "one row a sample, columns named with their units", write_csv, gaps="allowed")
