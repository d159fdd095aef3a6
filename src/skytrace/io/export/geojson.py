"""GeoJSON (RFC 7946): a LineString for each covered stretch, the cameras as points."""

from __future__ import annotations

import json
import math
from typing import Any

from skytrace.io.export.content import ExportRun, Format, lon_lat_height


def write_geojson(run: ExportRun) -> str:
    """The text of a FeatureCollection.

    Positions have three numbers only, as the standard asks; times, deviations and numbers of cameras stand beside them
    in the properties, one for each position.
    """
    places = run.longitude_latitude_deg()
    instants = run.instants() if run.time_zero is not None else None
    features = []
    for stretch in run.stretches():
        properties: dict[str, Any] = {
            "kind": "track",
            "segment": int(run.segment[stretch.start]),
            "time_s": [round(t, 6) for t in run.time_s[stretch].tolist()],
        }
        if instants is not None:
            properties["time_utc"] = instants[stretch]
        if run.sigma is not None:
            properties["sigma_m"] = [round(s, 4) if math.isfinite(s) else None for s in run.sigma[stretch].tolist()]
        properties["n_cameras"] = run.n_cameras[stretch].tolist()
        coordinates = [_place(place) for place in places[stretch].tolist()]
        features.append(_feature(coordinates, properties))
    for camera_id, camera in run.cameras.items():
        if camera.geodetic is not None:
            place = _place(lon_lat_height(camera.geodetic).tolist())
            features.append(_feature([place], {"kind": "camera", "id": camera_id}))
    document = {
        "type": "FeatureCollection",
        "name": run.name,
        "heights_above": run.vertical_datum,
        "clock": run.clock,
        "features": features,
    }
    return json.dumps(document, ensure_ascii=False, allow_nan=False) + "\n"


def _feature(coordinates: list[list[float]], properties: dict[str, Any]) -> dict[str, Any]:
    # A line of one point is not valid.
    if len(coordinates) == 1:
        geometry: dict[str, Any] = {"type": "Point", "coordinates": coordinates[0]}
    else:
        geometry = {"type": "LineString", "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _place(place: list[float]) -> list[float]:
    return [round(place[0], 9), round(place[1], 9), round(place[2], 3)]


FORMAT = Format(
    "geojson", ".geojson", "a line for each covered stretch", write_geojson, needs="georeference", rate_hz=5.0
)
