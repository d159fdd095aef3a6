"""A made-up reconstruction for the tests of the report: cameras on an arc around a smooth flight."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import Rigid
from skytrace.model.camera import Clock, Intrinsics
from skytrace.model.reconstruction import CameraEstimate, ClockDeviation, Gauge, Reconstruction, Residuals
from skytrace.model.trajectory import Segment, Trajectory

DOWN = np.array([0.0, 1.0, 0.0])
KNOT_S = 0.2


def look_at(centre: FloatArray, target: FloatArray, down: FloatArray = DOWN) -> Rigid:
    """camera_from_world of an unrolled camera (x axis horizontal) at a centre (3,), looking at a target (3,)."""
    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(down, forward)
    right /= np.linalg.norm(right)
    return Rigid.from_centre(np.array([right, np.cross(forward, right), forward]), centre)


def make_reconstruction(
    ids: Sequence[str] = ("cam0", "cam1", "cam2", "cam3"),
    *,
    duration_s: float = 30.0,
    frame_rate_hz: float = 30.0,
    n_segments: int = 2,
    gap_s: float = 1.0,
    gauge: Gauge = "arbitrary",
    unregistered: dict[str, str] | None = None,
    with_sigma: bool = True,
    seed: int = 7,
) -> Reconstruction:
    """A flight of `duration_s`, each segment followed by a gap, seen by every camera nine tenths of the time."""
    rng = np.random.default_rng(seed)
    cameras = {}
    for index, camera_id in enumerate(ids):
        angle = 2.5 * index / len(ids)
        centre = np.array([np.sin(angle), 0.3, 1 - np.cos(angle)]) if index else np.zeros(3)
        pose = look_at(centre, np.array([0.0, -0.3, 1.0]))
        cameras[camera_id] = _camera(pose, index, duration_s, frame_rate_hz, rng)
    trajectory = Trajectory(tuple(_segments(duration_s, n_segments, gap_s, with_sigma, rng)))
    return Reconstruction(ids[0], cameras, trajectory, gauge, unregistered or {})


def _segments(duration_s: float, n: int, gap_s: float, with_sigma: bool, rng: np.random.Generator) -> list[Segment]:
    bounds = np.linspace(0.0, duration_s, n + 1)
    segments = []
    for begin_s, end_s in zip(bounds[:-1], bounds[1:] - gap_s, strict=True):
        n_control = int(np.ceil((end_s - begin_s) / KNOT_S)) + 4
        smooth = np.cumsum(np.cumsum(rng.normal(size=(n_control, 3)), axis=0), axis=0)
        control = np.array([0, -0.3, 1.0]) + 0.3 * smooth / np.abs(smooth).max()
        sigma = 1e-3 * (1 + rng.random(n_control - 2)) if with_sigma else None
        segments.append(Segment(begin_s, KNOT_S, control, begin_s, end_s, sigma))
    return segments


def _camera(
    pose: Rigid, index: int, duration_s: float, frame_rate_hz: float, rng: np.random.Generator
) -> CameraEstimate:
    lens = Intrinsics([1500.0, 1500.0], [960.0, 540.0], np.zeros(5), (1920, 1080))
    refined = Intrinsics([1510.0, 1512.0], [960.0, 540.0], np.zeros(5), (1920, 1080))
    time_s = np.arange(0.0, duration_s, 1 / frame_rate_hz)
    away_s = duration_s * (0.1 + 0.8 * rng.random())
    time_s = time_s[np.abs(time_s - away_s) > 0.05 * duration_s]
    n = len(time_s)
    phase = 0.3 * time_s[:, None] + rng.uniform(0, 6, 2)
    error_px = rng.normal(0, 0.5, (n, 2))
    inlier = rng.random(n) > 0.02
    error_px[~inlier] *= 60
    measured_px = np.array([960.0, 540.0]) + np.array([800.0, 400.0]) * np.sin(phase)
    residuals = Residuals(np.round(time_s * frame_rate_hz), time_s, measured_px, error_px, inlier)
    clock = Clock(-12.5 * index, 1 / frame_rate_hz, 0.6 / frame_rate_hz, 1080)
    fixed = index == 0
    deviation = ClockDeviation(0.0 if fixed else 0.0012, 0.0 if fixed else 2.5e-7, 0.0016)
    return CameraEstimate(pose, clock, lens, refined, residuals, 0.5, deviation, np.diag([0.003, 0.002, 0.001]) ** 2)


def make_summary(reconstruction: Reconstruction) -> dict[str, object]:
    """A summary with every key that the report knows."""
    cameras: dict[str, object] = {
        camera_id: {
            "registered": True,
            "n_detections": len(camera.residuals.frame) + 40,
            "dropped": {"outside_image": 0, "isolated_jump": 31, "frozen": 9},
            "frame_rate_given_hz": 29.97,
        }
        for camera_id, camera in reconstruction.cameras.items()
    }
    for camera_id, reason in reconstruction.unregistered.items():
        cameras[camera_id] = {"registered": False, "reason": reason, "n_detections": 12, "dropped": {"frozen": 12}}
    first, second = list(reconstruction.cameras)[:2]
    return {
        "covered_s": reconstruction.trajectory.covered_s,
        "segments": len(reconstruction.trajectory.segments),
        "cameras": cameras,
        "timings_s": {"synchronise": 1.25, "adjust": 2.5},
        "warnings": ["The focal length of cam1 moved by 2.4 %"],
        "observability": {
            first: {
                "rate": {"value": 0.0, "prior_sd": 0.0, "posterior_sd": 0.0, "determined": "fixed"},
                "focal_scale": {
                    "value": 0.0067,
                    "prior_sd": 0.02,
                    "posterior_sd": 0.0021,
                    "determined": "determined by the data",
                },
            },
            second: {
                "readout_s": {"value": 0.02, "prior_sd": 0.003, "posterior_sd": 0.0029, "determined": "by its prior"},
            },
        },
        "adjustment": {"iterations": 48, "converged": True},
        "synchronisation": {
            "reference": first,
            "cameras": {
                camera_id: {
                    "tied": True,
                    "group": 0,
                    "offset_s": -12.5 * index,
                    "rate": 1.0,
                    "offset_sd_s": 0.002 * (index > 0),
                    "rate_sd": 1e-5 * (index > 0),
                    "confidence": 0.9974,
                }
                for index, camera_id in enumerate(reconstruction.cameras)
            },
            "groups": [{"reference": first, "cameras": list(reconstruction.cameras)}],
            "pairs": [
                {
                    "camera0": first,
                    "camera1": second,
                    "accepted": True,
                    "confidence": 0.9974,
                    "offset_s": -12.5,
                    "rate": 1.0,
                    "offset_sd_s": 0.002,
                    "overlap_s": 21.0,
                    "support_s": 20.5,
                    "score": 151.0,
                    "rivals": [{"offset_s": -70.2, "score": 80.0}],
                }
            ],
            "disagreement_s": [0.0021],
        },
    }
