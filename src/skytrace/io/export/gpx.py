"""GPX 1.1: a track with a segment for each covered stretch, the cameras as waypoints."""

from __future__ import annotations

from skytrace.io.export.content import ExportRun, Format, lon_lat_height
from skytrace.io.export.xml import xml_text


def write_gpx(run: ExportRun) -> str:
    """The text of a GPX file. Points carry times only where the instants are known: GPX has no relative time."""
    places = run.longitude_latitude_deg()
    times = run.instants() if run.time_zero is not None else None
    name = xml_text(run.name)
    heights = xml_text(f"Heights in metres above {run.vertical_datum}, not converted to any other datum.")
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<gpx version="1.1" creator="skytrace" xmlns="http://www.topografix.com/GPX/1/1">',
        f"<metadata><name>{name}</name><desc>{heights}</desc></metadata>",
    ]
    for camera_id, camera in run.cameras.items():
        if camera.geodetic is not None:
            body = f"<name>{xml_text(camera_id)}</name><desc>camera</desc>"
            lines.append(_point("wpt", lon_lat_height(camera.geodetic).tolist(), body))
    lines.append(f"<trk><name>{name}</name><desc>{heights}</desc>")
    for stretch in run.stretches():
        lines.append("<trkseg>")
        for k in range(stretch.start, stretch.stop):
            time = "" if times is None else f"<time>{times[k]}</time>"
            lines.append(_point("trkpt", places[k].tolist(), time))
        lines.append("</trkseg>")
    return "\n".join([*lines, "</trk>", "</gpx>"]) + "\n"


def _point(tag: str, place: list[float], body: str) -> str:
    """An element; `body` is what the schema wants after the elevation."""
    longitude_deg, latitude_deg, height_m = place
    return f'<{tag} lat="{latitude_deg:.9f}" lon="{longitude_deg:.9f}"><ele>{height_m:.3f}</ele>{body}</{tag}>'


FORMAT = Format("gpx", ".gpx", "GPX 1.1 track, cameras as waypoints", write_gpx, needs="georeference", rate_hz=5.0)
