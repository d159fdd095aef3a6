"""The columns that CSV and Parquet share."""

from __future__ import annotations

import numpy as np

from skytrace.geometry.arrays import FloatArray, IntArray
from skytrace.io.export.content import ExportRun


def columns(run: ExportRun) -> dict[str, FloatArray | IntArray | list[str]]:
    """Values (n,) by column name, units in the names; NaN in gaps, where `n_cameras` is 0 and `segment` -1."""
    metres = run.unit == "m"
    out: dict[str, FloatArray | IntArray | list[str]] = {"time_s": run.time_s}
    if run.time_zero is not None:
        out["time_utc"] = run.instants()
    for k, axis in enumerate("xyz"):
        out[f"{axis}_m" if metres else axis] = run.position[:, k]
    for k, axis in enumerate("xyz"):
        out[f"v{axis}_m_s" if metres else f"v{axis}"] = run.velocity[:, k]
    if run.sigma is not None:
        out["sigma_m" if metres else "sigma"] = run.sigma
    if run.geodetic is not None:
        out["latitude_deg"] = np.degrees(run.geodetic[:, 0])
        out["longitude_deg"] = np.degrees(run.geodetic[:, 1])
        out["height_m"] = run.geodetic[:, 2]
    return {**out, "n_cameras": run.n_cameras, "segment": run.segment}


def remarks(run: ExportRun) -> dict[str, str]:
    """What the columns do not say, in words by key."""
    out = {
        "run": run.name,
        "unit of length": "metre" if run.unit == "m" else "arbitrary (scale, orientation and origin not determined)",
        "frame": run.frame,
        "time_s": run.clock,
    }
    if run.sigma is not None:
        out["sigma"] = "posterior standard deviation of the position, all three axes together"
    if run.vertical_datum is not None:
        out["heights above"] = run.vertical_datum
    return out
