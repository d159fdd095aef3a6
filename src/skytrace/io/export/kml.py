"""KML 2.2 with time: gx:Track for each covered stretch, to be played in Google Earth; the cameras as points."""

from __future__ import annotations

from datetime import UTC, datetime

from skytrace.io.export.content import ExportRun, Format, lon_lat_height
from skytrace.io.export.xml import xml_text

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def write_kml(run: ExportRun) -> str:
    """The text of a KML file. A gx:Track needs dates: where none are known, they count from 1970-01-01T00:00:00Z."""
    places, times = run.longitude_latitude_deg(), run.instants(default=EPOCH)
    notes = [f"Heights in metres above {run.vertical_datum}; KML readers take them above mean sea level (EGM96)."]
    if run.time_zero is None:
        notes.append(f"Dates are not known: 1970-01-01T00:00:00Z stands for 0 s. Time: {run.clock}.")
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2">',
        "<Document>",
        f"<name>{xml_text(run.name)}</name>",
        f"<description>{xml_text(' '.join(notes))}</description>",
        '<Style id="track"><LineStyle><color>ff00a5ff</color><width>3</width></LineStyle></Style>',
    ]
    if run.sigma is not None:
        lines.append(
            '<Schema id="sample"><gx:SimpleArrayField name="sigma_m" type="float">'
            "<displayName>Deviation (m)</displayName></gx:SimpleArrayField></Schema>"
        )
    for camera_id, camera in run.cameras.items():
        if camera.geodetic is not None:
            coordinates = _place(lon_lat_height(camera.geodetic).tolist(), ",")
            lines.append(
                f"<Placemark><name>{xml_text(camera_id)}</name><Point><altitudeMode>absolute</altitudeMode>"
                f"<coordinates>{coordinates}</coordinates></Point></Placemark>"
            )
    lines.append("<Placemark><name>target</name><styleUrl>#track</styleUrl><gx:MultiTrack>")
    lines.append("<altitudeMode>absolute</altitudeMode><gx:interpolate>0</gx:interpolate>")
    for stretch in run.stretches():
        lines.append("<gx:Track><altitudeMode>absolute</altitudeMode>")
        lines += [f"<when>{time}</when>" for time in times[stretch]]
        lines += [f"<gx:coord>{_place(place, ' ')}</gx:coord>" for place in places[stretch].tolist()]
        lines += _deviations(run, stretch)
        lines.append("</gx:Track>")
    return "\n".join([*lines, "</gx:MultiTrack></Placemark>", "</Document>", "</kml>"]) + "\n"


def _deviations(run: ExportRun, stretch: slice) -> list[str]:
    if run.sigma is None:
        return []
    values = [f"<gx:value>{sigma:.4f}</gx:value>" for sigma in run.sigma[stretch].tolist()]
    begin = '<ExtendedData><SchemaData schemaUrl="#sample"><gx:SimpleArrayData name="sigma_m">'
    return [begin, *values, "</gx:SimpleArrayData></SchemaData></ExtendedData>"]


def _place(place: list[float], separator: str) -> str:
    longitude_deg, latitude_deg, height_m = place
    return separator.join([f"{longitude_deg:.9f}", f"{latitude_deg:.9f}", f"{height_m:.3f}"])


FORMAT = Format("kml", ".kml", "gx:Track with time, for Google Earth", write_kml, needs="georeference", rate_hz=5.0)
