"""Which clock is right where ours and the LED flashes of dataset3 disagree? Each camera alone is asked.

    SKYTRACE_DATA=... python -m benchmarks.camera_clocks

dataset3 is reconstructed blind. Then the flight measured by RTK-GNSS, brought into the reconstruction's frame and clock
by one similarity and one time shift, replaces the estimated trajectory, and every camera's pose, focal length and clock
are fitted to its own detections, without the other cameras. Where a camera's clock stays, its detections agree with
ours; what the flashes say differently then lies in the flashes: they were read in the videos, to a frame, at a row that
is not known, and the detections of two phones were resampled to a constant rate.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from skytrace.cli.reconstruct import reconstruct_flight
from skytrace.datasets import write_dataset
from skytrace.estimation.clean import CleanSettings
from skytrace.evaluation.path import SampledPath
from skytrace.evaluation.trajectory import evaluate_trajectory
from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.projection import distort
from skytrace.geometry.rigid import so3_exp
from skytrace.io.flight import read_flight
from skytrace.io.run_folder import RunFolder, read_run
from skytrace.io.truth import read_true_synchronisation, true_path
from skytrace.model.track import Recording
from skytrace.pipeline.config import Config
from skytrace.pipeline.prepare import prepare_flight

VIDEO_RATE_HZ = 30.0
SAMPLES = 3000
SIGMA_PX = 2.0


def main() -> None:
    if "SKYTRACE_DATA" not in os.environ:
        sys.exit("set SKYTRACE_DATA to the folder that holds drone-tracking/")
    with tempfile.TemporaryDirectory() as folder:
        path = write_dataset("dataset3", "auto", Path(os.environ["SKYTRACE_DATA"]), Path(folder) / "flight")
        reconstruct_flight(path, Path(folder) / "run", Config())
        run, flight = read_run(Path(folder) / "run"), read_flight(path)
        assert flight.truth is not None
        assert flight.truth.synchronisation is not None
        positions_m, rate_hz = true_path(flight.truth.trajectory, flight.truth.rate_hz)
        flashes = read_true_synchronisation(flight.truth.synchronisation)
        recordings = prepare_flight(flight, CleanSettings()).recordings
    truth = true_trajectory(run, positions_m, rate_hz)
    shift_s = {r.camera_id: own_clock(run, r, *truth) for r in recordings}
    base = next(c for c, relation in flashes.items() if relation == (1.0, 0.0))
    print(f"frames of {VIDEO_RATE_HZ:g} Hz, relative to {base}")
    print(f"{'camera':<8}{'flashes less ours':>18}{'RTK less ours':>15}{'rows of the image':>19}")
    for camera in flashes:
        if camera != base:
            ours = VIDEO_RATE_HZ * flash_difference_s(run, flashes[camera], camera, base)
            own = VIDEO_RATE_HZ * (shift_s[camera] - shift_s[base])
            rows = VIDEO_RATE_HZ * 0.5 * sum(run.cameras[c]["clock"]["readout_s"] for c in (camera, base))
            print(f"{camera:<8}{ours:>18.2f}{own:>15.2f}{f'+- {rows:.2f}':>19}")


def true_trajectory(run: RunFolder, positions_m: FloatArray, rate_hz: float) -> tuple[CubicSpline, FloatArray]:
    """The true flight as a spline in the world and time of a run, and the times (n,) of its samples."""
    estimate = SampledPath(run.time_s, run.position, run.velocity, run.segment, run.n_cameras, run.sigma)
    errors = evaluate_trajectory(estimate, positions_m, rate_hz).without_large
    known = np.isfinite(positions_m).all(axis=1)
    time_s = errors.clock.time_s(np.arange(len(positions_m)) / rate_hz)[known]
    return CubicSpline(time_s, errors.truth_from_world.inverse().apply(positions_m[known])), time_s


def own_clock(run: RunFolder, recording: Recording, truth: CubicSpline, known_s: FloatArray) -> float:
    """Seconds by which a camera's detections of the true flight are later than its clock says."""
    camera, lens = run.cameras[recording.camera_id], recording.intrinsics
    clock = camera["clock"]
    frame = np.concatenate([t.frame for t in recording.tracks])
    xy_px = np.concatenate([t.xy_px for t in recording.tracks])
    time_s = clock["offset_s"] + clock["period_s"] * frame + clock["readout_s"] * xy_px[:, 1] / lens.height_px
    after = np.clip(np.searchsorted(known_s, time_s), 1, len(known_s) - 1)
    step_s = np.median(np.diff(known_s))
    inside = (time_s > known_s[0]) & (time_s < known_s[-1]) & (known_s[after] - known_s[after - 1] < 1.5 * step_s)
    rows = np.flatnonzero(inside)
    rows = rows[np.linspace(0, len(rows) - 1, min(SAMPLES, len(rows))).astype(int)]
    time_s, xy_px = time_s[rows], xy_px[rows]
    rotation, centre = np.array(camera["rotation_camera_from_world"]), np.array(camera["centre"])
    focal_px, distortion = np.array(camera["focal_px_refined"]), np.array(camera["distortion"])

    def residual(p: FloatArray) -> FloatArray:
        """Pose (6), clock shift and rate, focal scale, aspect, principal point (2) -> residuals over their noise."""
        moment_s = time_s + p[6] + p[7] * (time_s - time_s.mean())
        point = (truth(moment_s) - centre - p[3:6]) @ (so3_exp(p[:3]) @ rotation).T
        xy = distort(point[:, :2] / point[:, 2:], distortion)
        projected = xy * focal_px * np.exp(p[8] + np.array([0.0, p[9]])) + lens.principal_px + focal_px * p[10:12]
        return ((projected - xy_px) / SIGMA_PX).ravel()

    scale = np.r_[np.full(3, 1e-3), np.full(3, 1e-2), 1e-3, 1e-6, np.full(4, 1e-3)]
    return float(least_squares(residual, np.zeros(12), loss="cauchy", x_scale=scale).x[6])


def flash_difference_s(run: RunFolder, relation: tuple[float, float], camera: str, base: str) -> float:
    """Mean seconds by which the flashes have a camera's frames later than its clock, at the middle row of both."""
    slope, intercept = relation
    clocks = [run.cameras[c]["clock"] for c in (camera, base)]
    frame, base_frame = ((run.time_s - c["offset_s"] - 0.5 * c["readout_s"]) / c["period_s"] for c in clocks)
    return float(np.mean(frame - (slope * base_frame + intercept)) * clocks[0]["period_s"])


if __name__ == "__main__":
    main()
