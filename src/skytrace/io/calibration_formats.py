"""Where each calibration format keeps the lens: nothing is judged here, only found."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skytrace.errors import InputError
from skytrace.io.text import line_of
from skytrace.io.toml import parse_toml

_FISHEYE_MODELS = re.compile("fisheye|equidistant|kannala", re.IGNORECASE)
_FISHEYE_KEYS = ("fisheye_model", "fisheye")
_MODEL_KEYS = ("distortion_model", "camera_model", "model")


@dataclass(frozen=True, slots=True)
class Entry:
    """A value as the file has it, None where it has none, with its key and line."""

    value: Any
    key: str
    line: int | None = None


@dataclass(frozen=True, slots=True)
class RawCalibration:
    """The parts of a calibration, unchecked."""

    matrix: Entry
    distortion: Entry
    size: Entry
    frame_rate: Entry
    model: Entry  # its name in words, or whether it is a fisheye
    deviation: Entry = Entry(None, "deviation")


def is_fisheye(model: Any) -> bool:
    """Whether the name of a lens model, or a flag, means Kannala and Brandt's."""
    return bool(_FISHEYE_MODELS.search(model)) if isinstance(model, str) else bool(model)


def read_mvus_json(path: Path, text: str, name: str | None, camera_id: str | None) -> RawCalibration:
    """mvus: an object with `K-matrix`, `distCoeff`, `resolution` and `fps`; one camera a file."""
    _refuse_name(path, name)
    try:
        values = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(path, f"not valid JSON: {error.msg}", line=error.lineno) from None
    if not isinstance(values, dict):
        raise InputError(path, f"expected a JSON object with K-matrix, distCoeff and resolution, got {values!r:.60}")

    def entry(key: str) -> Entry:
        return Entry(values.get(key), key, line_of(text, rf'"{re.escape(key)}"\s*:'))

    keys = ("K-matrix", "distCoeff", "resolution", "fps", "model", "deviation")
    return RawCalibration(*(entry(key) for key in keys))


def read_opencv_yaml(path: Path, text: str, name: str | None, camera_id: str | None) -> RawCalibration:
    """OpenCV's FileStorage (and ROS camera_info, which has the same keys); one camera a file."""
    _refuse_name(path, name)
    values = _load_opencv_yaml(path, text)

    def entry(keys: Iterable[str], shown: str) -> Entry:
        key = next((k for k in keys if k in values), None)
        if key is None:
            return Entry(None, shown)
        line = line_of(text, rf"^\s*[\"']?{re.escape(key)}[\"']?\s*:")
        return Entry(_matrix(path, values[key], key, line), key, line)

    size = entry(("image_size", "size", "resolution"), "image_width and image_height")
    if "image_width" in values and "image_height" in values:
        line = line_of(text, r"^\s*[\"']?image_width[\"']?\s*:")
        size = Entry([values["image_width"], values["image_height"]], "image_width, image_height", line)
    distortion_keys = ("distortion_coefficients", "distortion", "dist_coeffs", "dist_coeff", "distCoeffs", "distCoeff")
    return RawCalibration(
        matrix=entry(("camera_matrix", "K", "CameraMatrix", "cameraMatrix", "Camera_Matrix"), "camera_matrix"),
        distortion=entry(
            (*distortion_keys, "DistCoeffs", "Distortion_Coefficients", "dist", "D"), "distortion_coefficients"
        ),
        size=size,
        frame_rate=entry(("fps", "FPS", "frame_rate_hz", "frame_rate"), "fps"),
        model=entry(_FISHEYE_KEYS, "") if any(map(values.get, _FISHEYE_KEYS)) else entry(_MODEL_KEYS, "model"),
    )


def read_aniposelib_toml(path: Path, text: str, name: str | None, camera_id: str | None) -> RawCalibration:
    """aniposelib, Caliscope, Pose2Sim: a table per camera with name, size, matrix and distortions."""
    toml = parse_toml(path, text)
    tables = {key: table for key, table in toml.values.items() if isinstance(table, dict) and "matrix" in table}
    if not tables:
        raise InputError(path, "no camera: expected tables such as [cam_0] with name, size, matrix and distortions")
    key = _chosen_table(path, tables, name, camera_id)
    table = tables[key]

    def entry(field: str, *others: str) -> Entry:
        found = next((f for f in (field, *others) if f in table), field)
        return Entry(table.get(found), f"[{key}] {found}", toml.line(key, 0, found))

    rate, model = entry("fps", "frame_rate_hz"), entry("fisheye")
    return RawCalibration(entry("matrix"), entry("distortions"), entry("size"), rate, model)


def _chosen_table(path: Path, tables: Mapping[str, Mapping], name: str | None, camera_id: str | None) -> str:
    def answers_to(key: str, wanted: str) -> bool:
        table = tables[key]
        return wanted in (key, *(str(table[field]) for field in ("name", "cam_id", "port") if field in table))

    known = ", ".join(f"{key} ({table['name']})" if "name" in table else key for key, table in tables.items())
    wanted = name if name is not None else camera_id
    # The name a camera was given may be another's table key; what the user wrote as its name goes first.
    matches = [k for k in tables if str(tables[k].get("name")) == wanted] or [
        k for k in tables if wanted is not None and answers_to(k, wanted)
    ]
    if len(matches) == 1:
        return matches[0]
    if len(matches) > 1:
        raise InputError(path, f"{len(matches)} cameras are named {wanted!r}; known: {known}")
    if name is None and len(tables) == 1:
        return next(iter(tables))
    asked = f"no camera named {wanted!r}" if wanted is not None else "several cameras"
    raise InputError(path, f"{asked}; choose one with calibration = {f'{path.name}#NAME'!r}; known: {known}")


def _refuse_name(path: Path, name: str | None) -> None:
    if name is not None:
        raise InputError(path, f"'#{name}' chooses among the cameras of a TOML file; this file holds one camera")


def _load_opencv_yaml(path: Path, text: str) -> dict[str, Any]:
    import yaml

    class Loader(yaml.SafeLoader):
        """Plain YAML, with OpenCV's own tags read as the mappings and lists they mark."""

    def construct(loader: yaml.SafeLoader, _suffix: str, node: yaml.Node) -> Any:
        if isinstance(node, yaml.MappingNode):
            return loader.construct_mapping(node, deep=True)
        if isinstance(node, yaml.SequenceNode):
            return loader.construct_sequence(node, deep=True)
        return loader.construct_scalar(node) if isinstance(node, yaml.ScalarNode) else None

    Loader.add_multi_constructor("tag:yaml.org,2002:opencv-", construct)
    # OpenCV's first line, `%YAML:1.0`, is no directive YAML knows; blanked, the other lines keep their numbers.
    text = re.sub(r"\A%YAML[^\n]*", "", text)
    try:
        values = yaml.load(text, Loader)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else None
        raise InputError(path, f"not valid YAML: {error.problem or error.context}", line=line) from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise InputError(path, f"not valid YAML: {str(error).splitlines()[0]}") from None
    if not isinstance(values, dict):
        raise InputError(path, "expected a YAML mapping with camera_matrix, distortion_coefficients and image_width")
    return values


def _matrix(path: Path, value: Any, key: str, line: int | None) -> Any:
    """The nested lists of a matrix written as rows, columns and data; any other value as it is."""
    if not isinstance(value, dict):
        return value
    if {"width", "height"} <= set(value):
        return [value["width"], value["height"]]
    rows, columns, data = (value.get(field) for field in ("rows", "cols", "data"))
    if not (isinstance(rows, int) and isinstance(columns, int) and isinstance(data, list)):
        raise InputError(path, f"{key}: expected a matrix with rows, cols and data", line=line)
    if rows * columns != len(data):
        message = f"{key}: {rows} x {columns} matrix, expected {rows * columns} numbers, got {len(data)}"
        raise InputError(path, message, line=line)
    return [data[k * columns : (k + 1) * columns] for k in range(rows)]
