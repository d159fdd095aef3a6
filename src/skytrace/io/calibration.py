"""Calibration of a camera's lens: read from the files of the field, mvus JSON, OpenCV YAML and aniposelib TOML."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skytrace.errors import InputError
from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.projection import COEFFICIENTS, LensModel
from skytrace.io import calibration_formats as formats
from skytrace.io.calibration_formats import Entry, RawCalibration, is_fisheye
from skytrace.io.text import read_text
from skytrace.model.camera import Intrinsics, LensDeviation

_READERS: dict[str, Callable[[Path, str, str | None, str | None], RawCalibration]] = {
    ".json": formats.read_mvus_json,
    ".yml": formats.read_opencv_yaml,
    ".yaml": formats.read_opencv_yaml,
    ".toml": formats.read_aniposelib_toml,
}
_DISTORTION_LENGTHS = (4, 5, 8, 12, 14)  # what OpenCV writes; beyond the fifth: rational, thin-prism and tilt terms
_FOCAL_IN_WIDTHS = (0.1, 20.0)
_LARGEST_RATE_HZ = 1e5
_UNKNOWN_MODELS = re.compile("omni|mei|ucm|unified|double.?sphere", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class _Checker:
    path: Path

    def fail(self, entry: Entry, message: str) -> InputError:
        return InputError(self.path, f"{entry.key}: {message}" if entry.key else message, line=entry.line)

    def numbers(self, entry: Entry, what: str) -> FloatArray:
        if entry.value is None:
            raise self.fail(entry, f"missing; expected {what}")
        try:
            values = np.asarray(entry.value, float)
        except (TypeError, ValueError):
            raise self.fail(entry, f"expected {what}, got {entry.value!r:.80}") from None
        if not np.isfinite(values).all():
            raise self.fail(entry, f"expected {what}, got values that are not finite")
        return values


def split_camera_name(path: Path | str) -> tuple[Path, str | None]:
    """A reference `file.toml#name` as file and name; a file whose own name holds a `#` is taken as it is."""
    path = Path(path)
    if "#" not in path.name or path.exists():
        return path, None
    file, _, name = str(path).rpartition("#")
    return Path(file), name


def read_calibration(path: Path | str, camera_id: str | None = None) -> tuple[Intrinsics, float | None]:
    """The lens and, where the file gives it, the nominal frame rate in Hz.

    A TOML file may hold several cameras: `path` ending in `#name` chooses one, else the one named `camera_id`.
    Raises InputError for a lens that is missing, malformed, absurd, or of a model not known here (skew, rational
    terms, omnidirectional).
    """
    file, name = split_camera_name(path)
    reader = _READERS.get(file.suffix.lower())
    text = read_text(file, "calibration")
    if reader is None:
        message = (
            f"unknown kind of calibration {file.suffix!r}: expected mvus .json, OpenCV .yml/.yaml or aniposelib .toml"
        )
        raise InputError(file, message)
    raw = reader(file, text, name, camera_id)
    check = _Checker(file)
    size_px = _size(check, raw.size)
    focal_px, principal_px = _pinhole(check, raw.matrix, size_px)
    model = _model(check, raw.model)
    distortion = _distortion(check, raw.distortion, model)
    lens = Intrinsics(focal_px, principal_px, distortion, size_px, model, _deviation(check, raw.deviation, model))
    return lens, _frame_rate(check, raw.frame_rate)


def _size(check: _Checker, entry: Entry) -> tuple[int, int]:
    values = check.numbers(entry, "the image's width and height in pixels").ravel()
    if values.shape != (2,) or (values != np.round(values)).any() or (values < 1).any():
        raise check.fail(entry, f"expected width and height as two positive whole numbers, got {values.tolist()}")
    return int(values[0]), int(values[1])


def _pinhole(check: _Checker, entry: Entry, size_px: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
    K = check.numbers(entry, "the 3x3 camera matrix")
    if K.shape != (3, 3):
        raise check.fail(entry, f"expected a 3x3 matrix, got shape {K.shape}")
    if (K[2] != [0, 0, 1]).any():
        raise check.fail(entry, f"expected the last row 0 0 1, got {K[2].tolist()}; is the matrix transposed?")
    if K[1, 0] != 0 or abs(K[0, 1]) > 1e-9 * abs(K[0, 0]):
        raise check.fail(entry, f"skew is not supported: expected 0 off the diagonal, got {K[0, 1]:g} and {K[1, 0]:g}")
    focal_px, principal_px, size = K[[0, 1], [0, 1]], K[:2, 2], np.array(size_px)
    if (focal_px <= 0).any():
        raise check.fail(entry, f"expected positive focal lengths, got {focal_px.tolist()}")
    low, high = (bound * size[0] for bound in _FOCAL_IN_WIDTHS)
    if (focal_px < low).any() or (focal_px > high).any():
        raise check.fail(
            entry,
            f"focal lengths {focal_px.tolist()} px do not fit an image {size_px[0]} px wide "
            f"(expected {low:g} to {high:g}); are they in pixels, and is the size that of the calibrated images?",
        )
    if (principal_px < -0.5 * size).any() or (principal_px > 1.5 * size).any():
        raise check.fail(
            entry,
            f"principal point {principal_px.tolist()} lies far outside the image of {size_px[0]} x {size_px[1]} px; "
            "is the size that of the calibrated images?",
        )
    return focal_px, principal_px


def _model(check: _Checker, entry: Entry) -> LensModel:
    if isinstance(entry.value, str) and _UNKNOWN_MODELS.search(entry.value):
        raise check.fail(entry, f"{entry.value!r} is not supported; calibrate as pinhole or fisheye (Kannala-Brandt)")
    return "fisheye" if is_fisheye(entry.value) else "pinhole"


def _distortion(check: _Checker, entry: Entry, model: LensModel) -> FloatArray:
    if model == "fisheye":
        values = check.numbers(entry, "distortion coefficients k1 k2 k3 k4 of a fisheye").ravel()
        if len(values) != 4:
            raise check.fail(entry, f"expected the 4 coefficients k1 k2 k3 k4 of a fisheye, got {len(values)}")
        return values
    values = check.numbers(entry, "distortion coefficients k1 k2 p1 p2 [k3]").ravel()
    if len(values) not in _DISTORTION_LENGTHS:
        raise check.fail(entry, f"expected 4 or 5 coefficients k1 k2 p1 p2 [k3], got {len(values)}")
    if values[5:].any():
        message = "rational, thin-prism and tilt terms are not supported; calibrate with k1 k2 p1 p2 k3 only"
        raise check.fail(entry, message)
    return np.pad(values, (0, 1))[:5]


def _deviation(check: _Checker, entry: Entry, model: LensModel) -> LensDeviation | None:
    """Deviations as `calibration_writer` puts them."""
    if entry.value is None:
        return None
    expected = f"an object with focal, aspect, principal_px (2) and distortion ({len(COEFFICIENTS[model])})"
    parts = {}
    for key, n in (("focal", 1), ("aspect", 1), ("principal_px", 2), ("distortion", len(COEFFICIENTS[model]))):
        value = entry.value.get(key) if isinstance(entry.value, dict) else None
        values = check.numbers(Entry(value, f"{entry.key} {key}", entry.line), expected).ravel()
        if len(values) != n or (values < 0).any():
            raise check.fail(entry, f"{key}: expected {expected}, all from 0, got {value!r:.80}")
        parts[key] = values
    return LensDeviation(
        float(parts["focal"][0]), float(parts["aspect"][0]), parts["principal_px"], parts["distortion"]
    )


def _frame_rate(check: _Checker, entry: Entry) -> float | None:
    if entry.value is None:
        return None
    rate = check.numbers(entry, "the frame rate in Hz")
    if rate.shape != () or not 0 < rate < _LARGEST_RATE_HZ:
        raise check.fail(entry, f"expected a positive frame rate in Hz, got {entry.value!r}")
    return float(rate)
