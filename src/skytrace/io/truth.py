"""What is known of a flight from elsewhere, to judge a result by: path, camera positions, synchronisation."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skytrace.errors import InputError
from skytrace.geometry.arrays import FloatArray, frozen_array
from skytrace.io.table import TextTable, read_table
from skytrace.io.text import read_text

_MOST_EMPTY = 1000  # grid steps a time stamp, beyond which the stamps are surely in another unit


@dataclass(frozen=True, eq=False, slots=True)
class TruthTrajectory:
    """Positions in metres; without time stamps the samples are evenly spaced at a rate known from elsewhere."""

    position_m: FloatArray  # (n, 3), NaN where the file says so
    time_s: FloatArray | None  # (n,) strictly increasing, on the truth's own clock

    def __post_init__(self) -> None:
        object.__setattr__(self, "position_m", frozen_array(self.position_m, (None, 3), "position_m", finite=False))
        if self.time_s is not None:
            object.__setattr__(self, "time_s", frozen_array(self.time_s, (len(self.position_m),), "time_s"))


def read_truth_trajectory(path: Path | str) -> TruthTrajectory:
    """Read rows `x y z`, or a table whose header names x, y, z and, if it has them, time stamps (time_s).

    Raises InputError with the line.
    """
    path = Path(path)
    table = read_table(path, "true trajectory")
    if not table.rows:
        raise InputError(path, "true trajectory: a header and no rows")
    columns = _trajectory_columns(table)
    values = table.numbers(tuple(columns.values()), tuple(columns))
    time_s = values[:, 3] if "time_s" in columns else None
    if time_s is not None:
        wrong = ~np.isfinite(time_s)
        wrong[1:] |= np.diff(time_s) <= 0
        if wrong.any():
            row = int(np.argmax(wrong))
            message = f"expected time_s to rise from row to row, got {time_s[row]:.9g}"
            raise InputError(path, message, line=int(table.line[row]))
    return TruthTrajectory(values[:, :3], time_s)


def true_path(path: Path, rate_hz: float | None) -> tuple[FloatArray, float]:
    """True positions (n, 3) and how many there are a second; a truth's own time stamps count more than a rate."""
    truth = read_truth_trajectory(path)
    if truth.time_s is not None:
        try:
            return evenly_sampled(truth)
        except ValueError as error:
            raise InputError(path, str(error)) from error
    if rate_hz is None:
        raise InputError(path, "the truth's rate is not known: give --rate HZ, or a column time_s")
    return truth.position_m, rate_hz


def evenly_sampled(truth: TruthTrajectory) -> tuple[FloatArray, float]:
    """Positions (n, 3) at a constant rate, and that rate in Hz: the median one of the truth's own time stamps.

    Between neighbouring stamps a cubic spline is followed; inside gaps of more than 1.5 steps, and where the truth
    has none, positions are NaN. Raises ValueError where there are no time stamps to go by, or far more gap than truth.
    """
    from scipy.interpolate import make_interp_spline

    if truth.time_s is None or len(truth.time_s) < 2:
        raise ValueError("expected a truth with at least two time stamps")
    known = np.isfinite(truth.position_m).all(axis=1)
    if not known.any():
        raise ValueError("expected a truth with positions, got none that is finite")
    time_s, position = truth.time_s[known], truth.position_m[known]
    step_s = float(np.median(np.diff(truth.time_s)))
    n = np.floor((truth.time_s[-1] - truth.time_s[0]) / step_s + 1e-6) + 1
    if n > _MOST_EMPTY * len(truth.time_s):
        raise ValueError(f"{len(truth.time_s)} time stamps, mostly {step_s:g} s apart, spread over {n * step_s:g} s")
    grid_s = truth.time_s[0] + step_s * np.arange(int(n))
    even = np.full((len(grid_s), 3), np.nan)
    begins = np.flatnonzero(np.diff(time_s, prepend=-np.inf) > 1.5 * step_s)
    for stretch_s, place in zip(np.split(time_s, begins[1:]), np.split(position, begins[1:]), strict=True):
        slack_s = 1e-6 * step_s
        inside = (grid_s >= stretch_s[0] - slack_s) & (grid_s <= stretch_s[-1] + slack_s)
        if len(stretch_s) > 1:
            even[inside] = make_interp_spline(stretch_s, place, min(3, len(stretch_s) - 1))(grid_s[inside])
        else:
            even[inside] = place
    return even, 1.0 / step_s


def _trajectory_columns(table: TextTable) -> dict[str, int]:
    if table.header is None:
        n = len(table.cells(0))
        if n != 3:
            message = f"expected three columns x y z, got {n}; name them in a header (time_s,x,y,z)"
            raise InputError(table.path, message, line=int(table.line[0]))
        return {"x": 0, "y": 1, "z": 2}
    names = [name.removesuffix("_m") for name in table.header]
    missing = [name for name in "xyz" if name not in names]
    if missing:
        message = f"header {' '.join(table.header)!r}: expected columns x, y, z and optionally time_s"
        raise InputError(table.path, message, line=table.header_line)
    return {name: names.index(name) for name in ("x", "y", "z", "time_s") if name in names}


def read_true_positions(path: Path | str) -> dict[str, FloatArray]:
    """Camera centres (3,) in metres by camera id, from a CSV `camera,x,y,z`."""
    return dict(_read_by_camera(Path(path), ("x", "y", "z"), "camera positions"))


def read_true_synchronisation(path: Path | str) -> dict[str, tuple[float, float]]:
    """Slope and intercept by camera id, from a CSV `camera,slope,intercept`.

    frame = slope * reference_frame + intercept; the reference camera's row has 1,0. Raises InputError where the
    reference is missing.
    """
    path = Path(path)
    clocks = {
        camera: (float(values[0]), float(values[1]))
        for camera, values in _read_by_camera(path, ("slope", "intercept"), "synchronisation")
    }
    if not any(np.allclose(clock, (1.0, 0.0), rtol=0.0, atol=1e-9) for clock in clocks.values()):
        raise InputError(path, "no reference camera: expected one row with slope 1 and intercept 0")
    return clocks


def read_true_orientations(path: Path | str) -> dict[str, FloatArray]:
    """Rotations camera_from_world (3, 3) by camera id, from JSON as in a run's cameras.json.

    The object `cameras` holds `rotation_camera_from_world` of each camera; what else it holds is passed over.
    """
    path = Path(path)
    text = read_text(path, "camera orientations")
    try:
        cameras = json.loads(text)["cameras"]
        known = {c: np.array(row["rotation_camera_from_world"], float) for c, row in cameras.items()}
    except json.JSONDecodeError as error:
        raise InputError(path, f"not valid JSON: {error.msg}", line=error.lineno) from None
    except (KeyError, TypeError, ValueError, AttributeError):
        message = "expected an object cameras with rotation_camera_from_world, 3 by 3 numbers, of each camera"
        raise InputError(path, message) from None
    for camera, rotation in known.items():
        right_handed = rotation.shape == (3, 3) and np.linalg.det(rotation) > 0
        if not (right_handed and np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3)):
            raise InputError(path, f"camera {camera!r}: rotation_camera_from_world is not a rotation of 3 by 3 numbers")
    return known


def _read_by_camera(path: Path, columns: tuple[str, ...], what: str) -> list[tuple[str, FloatArray]]:
    expected = ("camera", *columns)
    rows, header = [], False
    for number, line in enumerate(read_text(path, what).split("\n"), 1):
        cells = [cell.strip() for cell in line.split("#")[0].split(",")]
        if cells == [""]:
            continue
        if not header:
            header = True
            if tuple(cell.lower() for cell in cells) != expected:
                raise InputError(path, f"expected the header {','.join(expected)}, got {line.strip()!r}", line=number)
            continue
        try:
            values = np.array([float(cell) for cell in cells[1:]])
        except ValueError:
            values = np.zeros(0)
        if values.shape != (len(columns),) or not np.isfinite(values).all() or not cells[0]:
            raise InputError(path, f"expected {','.join(expected)}, got {line.strip()!r}", line=number)
        if cells[0] in (camera for camera, _ in rows):
            raise InputError(path, f"camera {cells[0]!r} appears twice", line=number)
        rows.append((cells[0], values))
    if not rows:
        raise InputError(path, f"{what}: no rows; expected {','.join(expected)}")
    return rows
