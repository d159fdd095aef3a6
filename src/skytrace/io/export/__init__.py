"""Runs in the formats of other programs.

To add a format, write a module beside these with one pure function from `content.ExportRun` to text, bytes or a
folder's texts, and a `FORMAT` that says what it needs; list it below. The command line, its help, the refusals and
`tests/unit/test_export_formats.py` take it from there.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from skytrace.io.export import colmap, csv, geojson, gpx, kml, mvus, parquet, trc, tum
from skytrace.io.export.content import Content, ExportCamera, ExportRun, Format

__all__ = ["FORMATS", "Content", "ExportCamera", "ExportRun", "Format"]

FORMATS: Mapping[str, Format] = MappingProxyType(
    {m.FORMAT.name: m.FORMAT for m in (csv, parquet, tum, gpx, kml, geojson, colmap, mvus, trc)}
)
