"""`skytrace georeference`: where on the earth a RUN lies."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from skytrace.errors import InputError
from skytrace.geometry.rigid import Similarity
from skytrace.io.georeference import write_georeference
from skytrace.io.places import read_places
from skytrace.io.run_folder import json_text, read_run
from skytrace.model.georeference import ELLIPSOID, Georeference
from skytrace.pipeline.georeference import Georeferenced, from_cameras, from_gnss_log, from_track_points


def georeference_command(
    run_folder: Path,
    cameras: Path | None,
    points: Path | None,
    log: Path | None,
    origin: str | None,
    vertical_datum: str | None,
    as_json: bool,
) -> None:
    """Read, fit, write georeference.json into the run, print."""
    run = read_run(run_folder)
    if sum(path is not None for path in (cameras, points, log)) != 1:
        raise InputError(run_folder, "give one of --cameras, --points and --log")
    datum = ELLIPSOID if vertical_datum is None else vertical_datum
    if not datum.strip():
        raise InputError("--vertical-datum", "expected a name, such as EGM96")
    here = None if origin is None else parse_origin(origin, datum)
    if cameras is not None:
        found = from_cameras(run, read_places(cameras, "camera"), here)
    elif points is not None:
        found = from_track_points(run, read_places(points, "time_s"), here)
    else:
        assert log is not None  # one of the three
        found = from_gnss_log(run, read_places(log, "time_s"), here)
    similarity = found.georeference
    georeference = Georeference(
        similarity.latitude_rad, similarity.longitude_rad, similarity.height_m, similarity.enu_from_world, datum
    )
    details = {**found.details, "warnings": list(found.warnings)}
    path = write_georeference(run_folder, georeference, details)
    if as_json:
        scale = georeference.enu_from_world.scale
        print(json_text({"scale": scale, "frame": georeference.in_words, **details}, ascii_only=True))
    else:
        print(describe(Georeferenced(georeference, found.details, found.warnings), path))


def parse_origin(text: str, datum: str) -> Georeference:
    """The origin LAT,LON,HEIGHT in degrees and metres. Raises InputError."""
    try:
        latitude_deg, longitude_deg, height_m = (float(part) for part in text.split(","))
        unmoved = Similarity(1.0, np.eye(3), np.zeros(3))
        return Georeference(math.radians(latitude_deg), math.radians(longitude_deg), height_m, unmoved, datum)
    except ValueError:
        message = (
            f"expected latitude and longitude in degrees and a height in metres, such as 47.1,8.5,412; got {text!r}"
        )
        raise InputError("--origin", message) from None


def describe(found: Georeferenced, path: Path) -> str:
    """The georeference in a few lines for people."""
    details, similarity = found.details, found.georeference.enu_from_world
    lines = [
        f"frame        {found.georeference.in_words}",
        f"scale        {similarity.scale:.9g} +- {100 * details['scale_sd']:.2g} %"
        if details["scale_sd"]
        else f"scale        {similarity.scale:.9g}, that of the run",
        f"orientation  +- {details['rotation_sd_deg']:.3g} deg",
        f"place        +- {details['translation_sd_m']:.3g} m",
        *_residual_lines(details),
        *(f"warning      {text}" for text in found.warnings),
        f"written to   {path} (skytrace export reads it: --to csv, kml, gpx, geojson)",
    ]
    return "\n".join(lines)


def _residual_lines(details: Mapping[str, Any]) -> list[str]:
    if "clock" in details:
        clock = details["clock"]
        east, north, up = details["residual_rms_enu_m"]
        return [
            f"residual     {details['residual_rms_m']:.3f} m rms (east {east:.3f}, north {north:.3f}, up {up:.3f}) "
            f"over {details['samples']} samples, {details['samples_left_out']} left out",
            f"clock        time_s of the log = {clock['offset_s']:.4f} + {clock['rate']:.8f} * time_s of the run",
        ]
    return [
        f"residual     {name}: {row['metres']:.3f} m, {row['deviations']:.1f} deviations"
        + ("" if row["used"] else ", not used")
        for name, row in details["residuals"].items()
    ]
