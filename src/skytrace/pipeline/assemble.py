"""From the adjusted numbers to the Reconstruction that users see."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from skytrace.estimation.adjust.driver import Adjusted, mean_camera_time_s
from skytrace.estimation.coverage import CoverageSettings, covered_trajectory, inliers, support
from skytrace.estimation.gauge import in_reference_gauge
from skytrace.estimation.posterior import Posterior, posterior
from skytrace.geometry.arrays import FloatArray
from skytrace.model.reconstruction import CameraEstimate, ClockDeviation, Reconstruction, Residuals
from skytrace.model.track import Recording


def assemble(
    adjusted: Adjusted,
    recordings: Mapping[str, Recording],
    unregistered: Mapping[str, str],
    coverage: CoverageSettings,
) -> tuple[Reconstruction, Posterior]:
    """The reconstruction of an adjusted scene; `recordings` are in the order in which cameras are listed."""
    deviations = _deviations(adjusted, recordings, coverage)
    cameras = {}
    for camera_id in sorted(adjusted.camera_ids, key=list(recordings).index):
        cameras[camera_id] = _estimate(adjusted, deviations, camera_id, recordings[camera_id], coverage)
    inlier_times_s = [np.sort(c.residuals.time_s[c.residuals.inlier]) for c in cameras.values()]
    trajectory = covered_trajectory(
        adjusted.problem.grid, adjusted.state.control, deviations.knot_sigma, inlier_times_s, coverage
    )
    reference = adjusted.scene.reference
    own = Reconstruction(reference, cameras, trajectory, "arbitrary", unregistered)
    first_s, period_s = recordings[reference].frame_line()
    return in_reference_gauge(own, period_s, first_s), deviations


def _deviations(adjusted: Adjusted, recordings: Mapping[str, Recording], coverage: CoverageSettings) -> Posterior:
    times = []
    for index in range(len(adjusted.camera_ids)):
        own = adjusted.problem.observations.camera == index
        residuals = _residuals(adjusted, own, index, float(adjusted.weights.sigma_px[index]), coverage)
        times.append(np.sort(residuals.time_s[residuals.inlier]))
    count = support(adjusted.problem.grid.knots_s(), times, coverage.window_s)
    means = np.array([mean_camera_time_s(recordings[c]) - recordings[c].frame_line()[0] for c in adjusted.camera_ids])
    return posterior(adjusted, means, count >= coverage.min_cameras)


def _estimate(
    adjusted: Adjusted, deviations: Posterior, camera_id: str, recording: Recording, coverage: CoverageSettings
) -> CameraEstimate:
    index = adjusted.camera_ids.index(camera_id)
    camera = adjusted.scene.cameras[camera_id]
    own = adjusted.problem.observations.camera == index
    sigma_px = float(adjusted.weights.sigma_px[index])
    clock = deviations.clock[index]
    return CameraEstimate(
        camera.camera_from_world,
        camera.clock(recording),
        recording.intrinsics,
        camera.intrinsics(recording.intrinsics),
        _residuals(adjusted, own, index, sigma_px, coverage),
        sigma_px,
        ClockDeviation(
            float(deviations.clock_offset[index]), float(clock[1] * recording.frame_line()[1]), float(clock[2])
        ),
        deviations.centre[index],
    )


def _residuals(
    adjusted: Adjusted, own: FloatArray, index: int, sigma_px: float, coverage: CoverageSettings
) -> Residuals:
    """Residuals of a camera's detections that fall on the trajectory."""
    observations = adjusted.problem.observations
    rows = np.flatnonzero(own & np.isfinite(adjusted.residual_px[:, 0]))
    at_mean, rate, readout = adjusted.state.clock[index]
    error = adjusted.residual_px[rows]
    return Residuals(
        adjusted.frames[rows],
        at_mean + rate * observations.tau_s[rows] + readout * observations.row[rows],
        observations.xy_px[rows],
        error,
        inliers(error, sigma_px, coverage.inlier_sigmas),
    )
