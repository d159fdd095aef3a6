"""The keys of flight.toml and their types; messages that say which line is wrong and what belongs there."""

from __future__ import annotations

import re
from collections.abc import Iterable
from datetime import datetime
from pathlib import Path

import msgspec

from skytrace.errors import InputError
from skytrace.io.text import did_you_mean, read_text
from skytrace.io.toml import TomlFile, parse_toml

Vector3 = tuple[float, float, float]


class CameraKeys(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """One `[[camera]]`."""

    id: str
    calibration: str
    device: str | None = None
    detections: str | None = None
    video: str | None = None
    detections_columns: str | None = None
    timestamps: str | None = None
    frame_rate_hz: float | None = None
    offset_s: float | None = None
    offset_sigma_s: float | None = None
    position_m: Vector3 | None = None
    position_wgs84: Vector3 | None = None
    position_sigma_m: float | Vector3 | None = None
    up_in_camera: Vector3 | None = None
    up_sigma_deg: float | None = None
    readout_s: float | None = None
    readout_sigma_s: float | None = None
    start_time: datetime | None = None


class MomentKeys(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """One `[[simultaneous]]`."""

    frames: dict[str, float]
    sigma_s: float | None = None


class DistanceKeys(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """One `[[known_distance]]`."""

    cameras: list[str]
    metres: float
    sigma_m: float | None = None


class TruthKeys(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """`[truth]`."""

    trajectory: str
    rate_hz: float | None = None
    positions: str | None = None
    synchronisation: str | None = None
    orientations: str | None = None


class FlightKeys(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """The whole file."""

    name: str | None = None
    camera: list[CameraKeys] = []
    simultaneous: list[MomentKeys] = []
    known_distance: list[DistanceKeys] = []
    vertical_datum: str | None = None
    truth: TruthKeys | None = None


_TABLES: dict[str, type[msgspec.Struct]] = {
    "": FlightKeys,
    "camera": CameraKeys,
    "simultaneous": MomentKeys,
    "known_distance": DistanceKeys,
    "truth": TruthKeys,
}
_DATE_AND_TIME = "a date and time such as 2024-05-03T10:15:00Z"
_PLAIN_TYPES = {
    "str": "a string",
    "float": "a number",
    "int": "a number",
    "bool": "true or false",
    "null": "nothing",
    "datetime": _DATE_AND_TIME,
    "date": "only a date",
    "time": "only a time of day",
    "object": "a table",
    "array": "a list",
}


def read_flight_keys(path: Path) -> tuple[FlightKeys, TomlFile]:
    """The typed values of a flight.toml and the lines of its keys. Raises InputError with the line."""
    toml = parse_toml(path, read_text(path, "flight description"))
    try:
        return msgspec.convert(toml.values, FlightKeys), toml
    except msgspec.ValidationError as error:
        raise _explained(toml, str(error)) from None


def _explained(toml: TomlFile, text: str) -> InputError:
    """msgspec's message about `$.camera[1].offset_s` in the words and with the line of the file."""
    match = re.fullmatch(r"(?P<what>.*?)(?: - at `\$\.?(?P<place>.*)`)?", text)
    what, place = (match["what"], match["place"] or "") if match else (text, "")
    parts = re.fullmatch(
        r"(?P<table>camera|simultaneous|known_distance|truth)(?:\[(?P<index>\d+)\])?(?:\.(?P<key>\w+))?.*", place
    )
    if parts is None:
        table, index, key = "", 0, re.sub(r"\W.*", "", place)
    else:
        table, index, key = parts["table"], int(parts["index"] or 0), parts["key"] or ""
    if table == "camera" and parts is not None and parts["index"] is None:
        line = toml.line("camera", 0) or toml.line("", 0, "camera")
        return InputError(toml.path, "expected one [[camera]] table (double brackets) for each camera", line=line)
    each = {"simultaneous": "moment", "known_distance": "distance"}
    if table in each and parts is not None and parts["index"] is None:
        line = toml.line(table, 0) or toml.line("", 0, table)
        return InputError(toml.path, f"expected [[{table}]] tables (double brackets), one a {each[table]}", line=line)
    where = {
        "": "",
        "camera": f"camera {index + 1}: ",
        "simultaneous": f"[[simultaneous]] {index + 1}: ",
        "known_distance": f"[[known_distance]] {index + 1}: ",
        "truth": "[truth]: ",
    }[table]
    if unknown := re.fullmatch(r"Object contains unknown field `(.*)`", what):
        known = _TABLES[table].__struct_fields__
        what, key = f"unknown key {unknown[1]!r}{did_you_mean(unknown[1], known)}; known: {_words(known)}", unknown[1]
    elif missing := re.fullmatch(r"Object missing required field `(.*)`", what):
        what = f"the key {missing[1]!r} is missing"
    elif wrong := re.fullmatch(r"Expected `(.*)`, got `(.*)`", what):
        wanted = [_PLAIN_TYPES.get(w, w) for w in wrong[1].split(" | ") if w != "null"]
        what = f"{key}: expected {' or '.join(wanted)}, got {_PLAIN_TYPES.get(wrong[2], wrong[2])}"
    elif "RFC3339" in what:
        what = f"{key}: expected {_DATE_AND_TIME}, got another text"
    else:
        what = f"{key}: {what[:1].lower()}{what[1:]}" if key else what
    # What stands at the top may be a misspelt table or, the other way round, a table given as a plain key.
    line = toml.line(table, index, key) or toml.line(key, 0) or toml.line("", 0, table)
    return InputError(toml.path, where + what, line=line)


def _words(names: Iterable[str]) -> str:
    return ", ".join(names)
