"""A RUN: the folder a reconstruction is written to, and read back from."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

from skytrace.errors import InputError
from skytrace.geometry.arrays import FloatArray, IntArray, frozen_array
from skytrace.io.atomic import MANIFEST, RUN_FORMAT, atomic_folder, is_flights_folder, is_run_folder
from skytrace.io.table import read_table
from skytrace.io.text import read_text
from skytrace.model.reconstruction import CameraEstimate, Gauge, Reconstruction
from skytrace.model.trajectory import Segment, Trajectory

TRAJECTORY, CAMERAS, SUMMARY = "trajectory.csv", "cameras.json", "summary.json"
CONFIG, REPORT = "config.toml", "report.html"
SAMPLE_RATE_HZ = 50.0
SUPPORT_S = 0.25  # a camera supports a moment when it saw the target this close to it
COLUMNS = ("time_s", "x", "y", "z", "vx", "vy", "vz", "sigma", "n_cameras", "segment")
_ROW = ",".join(["%.12g"] * 8 + ["%d"] * 2) + "\n"


@dataclass(frozen=True, eq=False, slots=True)
class RunFolder:
    """A run as its files tell it. Lengths are in metres where the gauge is metric, else in an arbitrary unit."""

    path: Path
    gauge: str  # "arbitrary" or "metric"
    reference: str  # the camera whose clock times are on
    time_s: FloatArray  # (n,)
    position: FloatArray  # (n, 3) in the world
    velocity: FloatArray  # (n, 3) per second
    sigma: FloatArray  # (n,) posterior deviation of the position, NaN where none was computed
    n_cameras: IntArray  # (n,)
    segment: IntArray  # (n,)
    cameras: Mapping[str, Mapping[str, Any]]  # as in cameras.json
    summary: Mapping[str, Any]
    manifest: Mapping[str, Any]
    frame: str = "camera"  # of the world, as `Reconstruction.frame`

    def __post_init__(self) -> None:
        object.__setattr__(self, "time_s", frozen_array(self.time_s, (None,), "time_s"))
        n = len(self.time_s)
        for name in ("position", "velocity"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), (n, 3), name))
        object.__setattr__(self, "sigma", frozen_array(self.sigma, (n,), "sigma", finite=False))
        for name in ("n_cameras", "segment"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), (n,), name, np.int64))


def write_run(
    destination: Path | str,
    reconstruction: Reconstruction,
    summary: Mapping[str, Any],
    config_toml: str,
    manifest: Mapping[str, Any],
    report_html: str | None = None,
    more: Mapping[str, str] | None = None,
) -> None:
    """Write a RUN folder, whole or not at all; an earlier run at the destination is replaced.

    `more` are further texts by file name. Values in `summary` and `manifest` may be numpy's; numbers that are not
    finite become null. Raises InputError when the destination is something other than an earlier run or an empty
    folder.
    """
    with atomic_folder(destination) as folder:
        _write(folder / TRAJECTORY, trajectory_csv(reconstruction))
        _write(folder / CAMERAS, json_text(cameras_table(reconstruction)) + "\n")
        _write(folder / SUMMARY, json_text(summary) + "\n")
        _write(folder / CONFIG, config_toml)
        if report_html is not None:
            _write(folder / REPORT, report_html)
        for name, text in (more or {}).items():
            _write(folder / name, text)
        _write(folder / MANIFEST, json_text({**manifest, "format": RUN_FORMAT}) + "\n")


def input_hashes(paths: Iterable[Path | str]) -> dict[str, str]:
    """SHA-256 (hexadecimal) of each file by its path as given."""
    hashes = {}
    for path in paths:
        with open(path, "rb") as file:
            hashes[str(path)] = hashlib.file_digest(file, "sha256").hexdigest()
    return hashes


def supporting_cameras(reconstruction: Reconstruction, time_s: FloatArray) -> IntArray:
    """How many cameras (n,) have an inlying detection within SUPPORT_S of each time (n,)."""
    count = np.zeros(len(time_s), np.int64)
    for camera in reconstruction.cameras.values():
        seen_s = np.sort(camera.residuals.time_s[camera.residuals.inlier])
        first = np.searchsorted(seen_s, time_s - SUPPORT_S, side="left")
        count += np.searchsorted(seen_s, time_s + SUPPORT_S, side="right") > first
    return count


def trajectory_csv(reconstruction: Reconstruction) -> str:
    """The text of trajectory.csv: sampled at SAMPLE_RATE_HZ inside the covered segments, their ends included."""
    metric = reconstruction.gauge == "metric"
    plain = not metric and reconstruction.frame == "camera"
    open_ = "scale, orientation and origin are not determined" if plain else "scale is not determined"
    unit = "metre" if metric else f"arbitrary ({open_})"
    lines = [
        f"# gauge: {reconstruction.gauge}\n",
        f"# unit of length: {unit}\n",
        f"# frame: right-handed world, {'chosen by the reconstruction' if plain else reconstruction.frame_in_words}\n",
        f"# time_s: seconds on the clock of camera {reconstruction.reference}\n",
        "# sigma: posterior standard deviation of the position, all three axes together\n",
        f"# n_cameras: cameras with an agreeing detection within {SUPPORT_S} s\n",
        ",".join(COLUMNS) + "\n",
    ]
    for k, segment in enumerate(reconstruction.trajectory.segments):
        rows = _samples(reconstruction, segment, k)
        lines.append((_ROW * len(rows)) % tuple(rows.ravel().tolist()))
    return "".join(lines)


def _samples(reconstruction: Reconstruction, segment: Segment, index: int) -> FloatArray:
    time_s = Trajectory((segment,)).sample_times(SAMPLE_RATE_HZ)
    return np.column_stack(
        [
            time_s,
            segment.evaluate(time_s),
            segment.evaluate(time_s, 1),
            segment.sigma(time_s),
            supporting_cameras(reconstruction, time_s),
            np.full(len(time_s), index),
        ]
    )


def cameras_table(reconstruction: Reconstruction) -> dict[str, Any]:
    """What cameras.json holds, cameras in the order of their ids."""
    cameras: dict[str, Any] = {id_: _camera(camera) for id_, camera in reconstruction.cameras.items()}
    for id_, reason in reconstruction.unregistered.items():
        cameras[id_] = {"registered": False, "reason": reason}
    plain = reconstruction.gauge == "arbitrary" and reconstruction.frame == "camera"
    return {
        "reference": reconstruction.reference,
        "gauge": reconstruction.gauge,
        **({} if plain else {"frame": reconstruction.frame}),
        "cameras": {id_: cameras[id_] for id_ in sorted(cameras)},
    }


def _camera(camera: CameraEstimate) -> dict[str, Any]:
    clock, deviation = camera.clock, camera.clock_deviation
    return {
        "registered": True,
        "reason": None,
        "clock": {"offset_s": clock.offset_s, "period_s": clock.period_s, "readout_s": clock.readout_s},
        "clock_sd": {
            "offset_s": deviation.offset_s,
            "period_s": deviation.period_s,
            "readout_s": deviation.readout_s,
        },
        "rotation_camera_from_world": camera.camera_from_world.rotation,
        "centre": camera.camera_from_world.centre,
        "centre_sd": camera.centre_deviation,
        "focal_px_calibrated": camera.calibrated.focal_px,
        "focal_px_refined": camera.refined.focal_px,
        "principal_px": camera.refined.principal_px,
        "distortion": camera.refined.distortion,
        "lens_model": camera.refined.model,
        "size_px": camera.refined.size_px,
        "reprojection_median_px": camera.residuals.median_px,
        "sigma_px": camera.sigma_px,
        "n_used": len(camera.residuals.frame),
        "n_inliers": int(camera.residuals.inlier.sum()),
    }


def read_run(path: Path | str) -> RunFolder:
    """Read a RUN folder back. Raises InputError when it is not a finished run or a file in it is malformed."""
    path = Path(path)
    if not path.is_dir():
        raise InputError(path, "no such run: expected a folder written by skytrace reconstruct")
    if is_flights_folder(path):
        runs = ", ".join(str(run) for run in sorted(path.iterdir()) if is_run_folder(run))
        raise InputError(path, f"holds the runs of several flights: give one of them, {runs}")
    if not is_run_folder(path):
        raise InputError(path, f"not a finished run: expected a {MANIFEST} of the format {RUN_FORMAT!r}")
    cameras = _read_json(path / CAMERAS)
    gauge, reference, table = (cameras.get(key, "") for key in ("gauge", "reference", "cameras"))
    if gauge not in get_args(Gauge) or not isinstance(table, dict) or reference not in table:
        raise InputError(path / CAMERAS, "expected the keys reference, gauge and cameras as skytrace writes them")
    values = _read_trajectory(path / TRAJECTORY)
    return RunFolder(
        path=path,
        gauge=gauge,
        reference=reference,
        time_s=values[:, 0],
        position=values[:, 1:4],
        velocity=values[:, 4:7],
        sigma=values[:, 7],
        n_cameras=values[:, 8].astype(np.int64),
        segment=values[:, 9].astype(np.int64),
        cameras=table,
        summary=_read_json(path / SUMMARY),
        manifest=_read_json(path / MANIFEST),
        frame=cameras.get("frame", "camera"),
    )


def _read_trajectory(path: Path) -> FloatArray:
    table = read_table(path, "trajectory")
    if table.header != COLUMNS:
        raise InputError(path, f"expected the header {','.join(COLUMNS)}", line=table.header_line)
    values = table.numbers(range(len(COLUMNS)), COLUMNS)
    bad = ~np.isfinite(np.delete(values, COLUMNS.index("sigma"), axis=1)).all(axis=1)
    if bad.any():
        raise InputError(path, "expected finite numbers in every column", line=int(table.line[np.argmax(bad)]))
    return values


def _read_json(path: Path) -> dict[str, Any]:
    try:
        values = json.loads(read_text(path, "part of a run"))
    except json.JSONDecodeError as error:
        raise InputError(path, f"not valid JSON: {error.msg}", line=error.lineno) from None
    if not isinstance(values, dict):
        raise InputError(path, "expected a JSON object")
    return values


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")


def json_text(value: Any, *, ascii_only: bool = False) -> str:
    """A value as JSON. Numpy's types are allowed; numbers that are not finite, which JSON lacks, become null."""
    return json.dumps(_plain(value), indent=2, ensure_ascii=ascii_only, allow_nan=False)


def _plain(value: Any) -> Any:
    """The value in JSON's own types; NaN and infinity, which JSON lacks, become null."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path):
        return str(value)
    return value
