"""A small run made by hand: two covered stretches of an exactly cubic path, two cameras and one that was left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import Similarity, so3_exp
from skytrace.io.run_folder import RunFolder
from skytrace.model.georeference import Georeference

STRETCHES_S = ((10.013, 12.007), (13.5, 15.0))
COEFFICIENTS = np.array([[1.0, -2.0, 0.5], [0.3, 0.2, -0.1], [-0.02, 0.01, 0.03], [0.001, -0.002, 0.0005]])
ORIGIN_RAD_M = (np.radians(47.4), np.radians(8.55), 500.0)


def position(time_s: FloatArray) -> FloatArray:
    """The path (n, 3) in the run's world."""
    return np.vander(np.asarray(time_s), 4, increasing=True) @ COEFFICIENTS


def velocity(time_s: FloatArray) -> FloatArray:
    """Its derivative (n, 3)."""
    return np.vander(np.asarray(time_s), 3, increasing=True) @ (COEFFICIENTS[1:] * np.array([[1], [2], [3]]))


def camera_row(rotation_vector: tuple[float, float, float], centre: tuple[float, float, float], fisheye: bool) -> dict:
    """What cameras.json holds of a registered camera."""
    return {
        "registered": True,
        "reason": None,
        "clock": {"offset_s": 3.5, "period_s": 0.04, "readout_s": 0.02},
        "rotation_camera_from_world": so3_exp(np.array(rotation_vector)).tolist(),
        "centre": list(centre),
        "focal_px_refined": [1500.0, 1510.0],
        "principal_px": [960.0, 540.0],
        "distortion": [0.01, -0.02, 0.003, 0.004] if fisheye else [0.05, -0.1, 0.001, -0.002, 0.03],
        "size_px": [1920, 1080],
    }


def make_run(folder: Path, gauge: str = "arbitrary") -> RunFolder:
    """The run, as read from a folder of that name."""
    times = []
    for first, last in STRETCHES_S:
        grid = np.arange(np.ceil(first * 50 + 1e-6), np.floor(last * 50 - 1e-6) + 1) / 50
        times.append(np.concatenate([[first], grid, [last]]))
    time_s = np.concatenate(times)
    reference = camera_row((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), fisheye=False)
    reference["clock"] = {"offset_s": 0.0, "period_s": 1 / 30, "readout_s": 0.015}
    return RunFolder(
        path=folder,
        gauge=gauge,
        reference="cam0",
        time_s=time_s,
        position=position(time_s),
        velocity=velocity(time_s),
        sigma=0.01 + 0.001 * time_s,
        n_cameras=np.full(len(time_s), 2),
        segment=np.concatenate([np.full(len(t), k) for k, t in enumerate(times)]),
        cameras={
            "cam0": reference,
            "my cam": camera_row((0.2, -2.5, 0.4), (5.0, 1.0, -2.0), fisheye=True),
            "cam2": {"registered": False, "reason": "too little in common"},
        },
        summary={},
        manifest={},
    )


def make_georeference(vertical_datum: str = "WGS84 ellipsoid") -> Georeference:
    """A place near Zurich, where the run's unit is 20 m."""
    similarity = Similarity(20.0, so3_exp(np.array([1.2, 0.4, -0.3])), np.array([100.0, -50.0, 30.0]))
    return Georeference(*ORIGIN_RAD_M, similarity, vertical_datum)
