"""georeference.json of a RUN: where on the earth it lies. Its angles are degrees, those of the type radians."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from skytrace.errors import InputError
from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import Similarity
from skytrace.io.atomic import atomic_file
from skytrace.io.run_folder import json_text
from skytrace.io.text import read_text
from skytrace.model.georeference import Georeference

GEOREFERENCE = "georeference.json"
GEOREFERENCE_FORMAT = "skytrace georeference 1"


def write_georeference(run: Path | str, georeference: Georeference, details: Mapping[str, Any] | None = None) -> Path:
    """Write georeference.json into a RUN folder, in place of an earlier one; returns its path.

    `details` say how it was found (residuals, deviations): they are kept in the file for people and not read back.
    """
    path = Path(run) / GEOREFERENCE
    with atomic_file(path) as partial:
        partial.write_text(georeference_text(georeference, details), encoding="utf-8")
    return path


def georeference_text(georeference: Georeference, details: Mapping[str, Any] | None = None) -> str:
    """The content of georeference.json."""
    similarity = georeference.enu_from_world
    document = {
        "format": GEOREFERENCE_FORMAT,
        "origin": {
            "latitude_deg": math.degrees(georeference.latitude_rad),
            "longitude_deg": math.degrees(georeference.longitude_rad),
            "height_m": georeference.height_m,
            "vertical_datum": georeference.vertical_datum,
        },
        "enu_from_world": {
            "scale": similarity.scale,
            "rotation": similarity.rotation,
            "translation_m": similarity.translation,
        },
        "details": dict(details or {}),
    }
    return json_text(document) + "\n"


def read_georeference(run: Path | str) -> Georeference | None:
    """The georeference of a RUN folder, None where it has none. Raises InputError where the file is malformed."""
    path = Path(run) / GEOREFERENCE
    if not path.exists():
        return None
    try:
        document = json.loads(read_text(path, "georeference"))
    except json.JSONDecodeError as error:
        raise InputError(path, f"not valid JSON: {error.msg}", line=error.lineno) from None
    if not isinstance(document, dict) or document.get("format") != GEOREFERENCE_FORMAT:
        raise InputError(path, f"expected a JSON object whose format is {GEOREFERENCE_FORMAT!r}")
    origin, similarity = (_Section(path, document, name) for name in ("origin", "enu_from_world"))
    try:
        return Georeference(
            math.radians(origin.number("latitude_deg")),
            math.radians(origin.number("longitude_deg")),
            origin.number("height_m"),
            Similarity(
                similarity.number("scale"),
                similarity.array("rotation", (3, 3)),
                similarity.array("translation_m", (3,)),
            ),
            origin.text("vertical_datum"),
        )
    except ValueError as error:
        raise InputError(path, str(error)) from None


class _Section:
    """One object of the file, whose values are checked as they are taken."""

    def __init__(self, path: Path, document: Mapping[str, Any], name: str) -> None:
        self._path, self._name, self._values = path, name, document.get(name)
        if not isinstance(self._values, dict):
            raise InputError(path, f"{name}: expected an object")

    def _get(self, key: str, kind: type | tuple[type, ...], expected: str) -> Any:
        value = self._values.get(key)  # type: ignore[union-attr]
        if not isinstance(value, kind) or isinstance(value, bool):
            raise InputError(self._path, f"{self._name}.{key}: expected {expected}, got {value!r:.60}")
        return value

    def number(self, key: str) -> float:
        return float(self._get(key, (int, float), "a number"))

    def text(self, key: str) -> str:
        return self._get(key, str, "text")

    def array(self, key: str, shape: tuple[int, ...]) -> FloatArray:
        value = self._get(key, list, "a list of numbers")
        try:
            array = np.array(value, float)
        except (TypeError, ValueError):
            array = np.zeros(0)
        if array.shape != shape:
            raise InputError(self._path, f"{self._name}.{key}: expected numbers of shape {shape}, got {value!r:.60}")
        return array
