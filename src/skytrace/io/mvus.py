"""Import of a configuration of mvus, the code published with Li et al., IROS 2020, as a FLIGHT folder."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skytrace.errors import InputError
from skytrace.io.atomic import atomic_folder
from skytrace.io.calibration import read_calibration
from skytrace.io.detections import read_detections
from skytrace.io.flight import FLIGHT_FILE
from skytrace.io.text import line_of, read_text
from skytrace.io.toml import toml_string
from skytrace.io.truth import read_truth_trajectory

_COLUMNS = "x y frame"  # the order mvus reads, whatever else a row holds


@dataclass(frozen=True, slots=True)
class _Camera:
    camera_id: str
    calibration: Path
    detections: Path


@dataclass(frozen=True, slots=True)
class _Truth:
    trajectory: Path
    rate_hz: float


@dataclass(frozen=True, slots=True)
class _Config:
    """The configuration's JSON, and how to name and resolve what is in it."""

    path: Path
    text: str
    values: dict[str, Any]

    def fail(self, key: str, message: str) -> InputError:
        line = line_of(self.text, rf'"{key}"\s*:')
        return InputError(self.path, f"{key}: {message}", line=line)

    def section(self, key: str) -> dict[str, Any]:
        section = self.values.get(key, {})
        if not isinstance(section, dict):
            raise self.fail(key, f"expected an object, got {section!r:.60}")
        return section

    def paths(self, section: str, key: str) -> list[Path]:
        names = self.section(section).get(key)
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names) or not names:
            raise self.fail(key, f"expected a list of paths in {section!r}, got {names!r:.60}")
        return [self.resolve(key, name) for name in names]

    def resolve(self, key: str, name: str) -> Path:
        """mvus resolves paths against the folder it is started in, usually the one above the configuration's."""
        folder = self.path.absolute().parent
        tried = list(dict.fromkeys(base / name for base in (folder, folder.parent, Path.cwd())))
        found = next((path for path in tried if path.is_file()), None)
        if found is None:
            raise self.fail(key, f"no such file: {name} (tried {', '.join(map(str, tried))})")
        return found


def import_mvus(config_json: Path | str, destination: Path | str) -> Path:
    """Write a FLIGHT folder with copies of all the files an mvus configuration names; returns its flight.toml.

    Everything is read and checked first. Raises InputError for a malformed configuration or file, and when the
    destination exists and is not an empty folder.
    """
    path = Path(config_json)
    text = read_text(path, "mvus configuration")
    try:
        values = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(path, f"not valid JSON: {error.msg}", line=error.lineno) from None
    if not isinstance(values, dict):
        raise InputError(path, "expected a JSON object with 'necessary inputs'")
    config = _Config(path, text, values)
    cameras, truth = _cameras(config), _truth(config)
    with atomic_folder(destination, replace_run=False) as folder:
        _write_flight(folder, config, cameras, truth, Path(destination).absolute().name)
    return Path(destination) / FLIGHT_FILE


def _cameras(config: _Config) -> list[_Camera]:
    calibrations = config.paths("necessary inputs", "path_cameras")
    detections = config.paths("necessary inputs", "path_detections")
    if len(calibrations) != len(detections):
        message = (
            f"{len(detections)} files, but path_cameras names {len(calibrations)}; expected one of each per camera"
        )
        raise config.fail("path_detections", message)
    if len(detections) < 2:
        raise config.fail("path_detections", "expected at least two cameras, got 1")
    stems = [path.stem for path in detections]
    ids = stems if len(set(stems)) == len(stems) else [f"cam{k}" for k in range(len(stems))]
    for calibration, track in zip(calibrations, detections, strict=True):
        _, frame_rate_hz = read_calibration(calibration)
        if frame_rate_hz is None:
            raise InputError(calibration, "fps: missing; expected the frame rate in Hz")
        read_detections(track, _COLUMNS)
    return [_Camera(*parts) for parts in zip(ids, calibrations, detections, strict=True)]


def _truth(config: _Config) -> _Truth | None:
    truth = config.section("optional inputs").get("ground_truth")
    if not truth:
        return None
    if not isinstance(truth, dict):
        raise config.fail("ground_truth", f"expected an object with filepath and frequency, got {truth!r:.60}")
    name, rate_hz = truth.get("filepath"), truth.get("frequency")
    if not name:
        return None
    if not isinstance(name, str):
        raise config.fail("filepath", f"expected a path, got {name!r:.60}")
    if isinstance(rate_hz, bool) or not isinstance(rate_hz, int | float) or not 0 < rate_hz < float("inf"):
        raise config.fail("frequency", f"expected the truth's sampling rate in Hz, got {rate_hz!r:.60}")
    path = config.resolve("filepath", name)
    read_truth_trajectory(path)
    return _Truth(path, float(rate_hz))


def _write_flight(folder: Path, config: _Config, cameras: list[_Camera], truth: _Truth | None, name: str) -> None:
    lines = [f"# Imported from the mvus configuration {_comment(config.path.name)}"]
    frames = config.section("necessary inputs").get("corresponding_frames")
    if frames is not None:
        lines += [
            "# Its corresponding frames are not used: clocks are found from the detections alone. They were:",
            f"# {_comment(json.dumps(frames))}",
        ]
    lines.append(f"name = {toml_string(name)}")
    for camera in cameras:
        calibration = _copy(camera.calibration, folder, "calibration", camera.camera_id)
        detections = _copy(camera.detections, folder, "detections", camera.camera_id)
        lines += [
            "",
            "[[camera]]",
            f"id = {toml_string(camera.camera_id)}",
            f"calibration = {toml_string(calibration)}  # {_comment(camera.calibration.name)}",
            f"detections = {toml_string(detections)}",
            f"detections_columns = {toml_string(_COLUMNS)}",
        ]
    if truth is not None:
        trajectory = _copy(truth.trajectory, folder, "truth", "trajectory")
        lines += ["", "[truth]", f"trajectory = {toml_string(trajectory)}", f"rate_hz = {truth.rate_hz!r}"]
    (folder / FLIGHT_FILE).write_text("\n".join(lines) + "\n", encoding="utf-8")


def _copy(source: Path, folder: Path, kind: str, name: str) -> str:
    """Copy a file to folder/kind/name with its own suffix; the path as flight.toml gives it."""
    (folder / kind).mkdir(exist_ok=True)
    target = f"{kind}/{name}{source.suffix}"
    shutil.copyfile(source, folder / target)
    return target


def _comment(text: str) -> str:
    """Text that stays on the comment's line."""
    return "".join(c if c.isprintable() else "?" for c in text)
