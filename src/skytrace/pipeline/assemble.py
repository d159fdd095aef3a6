"""From the adjusted numbers to the Reconstruction that users see."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from skytrace.estimation.adjust.driver import Adjusted, mean_camera_time_s
from skytrace.estimation.coverage import CoverageSettings, Cuts, covered_trajectory, inliers, support
from skytrace.estimation.gauge import in_known_gauge
from skytrace.estimation.posterior import Posterior, posterior
from skytrace.geometry.arrays import BoolArray, FloatArray
from skytrace.model.reconstruction import CameraEstimate, ClockDeviation, Reconstruction, Residuals
from skytrace.model.track import Recording
from skytrace.pipeline.canonical import Origin


def assemble(
    adjusted: Adjusted,
    recordings: Mapping[str, Recording],
    unregistered: Mapping[str, str],
    coverage: CoverageSettings,
    order: Sequence[str],
    origins: Mapping[str, Origin],
) -> tuple[Reconstruction, Posterior, Cuts]:
    """The reconstruction of an adjusted scene, on the clock of its first camera in `order`.

    Its frame is that camera's but for what is known of another (`estimation.gauge.in_known_gauge`).
    `recordings` are those adjusted, their frames and times counted from `origins`.
    """
    listed = [c for c in order if c in adjusted.camera_ids]
    deviations = _deviations(adjusted, recordings, coverage, listed[0], origins)
    cameras = {c: _estimate(adjusted, deviations, c, recordings[c], coverage) for c in listed}
    inlier_times_s = [np.sort(c.residuals.time_s[c.residuals.inlier]) for c in cameras.values()]
    trajectory, cuts = covered_trajectory(
        adjusted.problem.grid,
        adjusted.state.control,
        deviations.knot_sigma,
        inlier_times_s,
        coverage,
        deviations.shape_sigma,
        _seen_s(adjusted),
    )
    own = Reconstruction(listed[0], cameras, trajectory, "arbitrary", unregistered)
    first_s, period_s = recordings[listed[0]].frame_line()
    found = in_known_gauge(own, adjusted.known, period_s, first_s + origins[listed[0]].time_s)
    return replace(found, cameras={c: origins[c].restored(e) for c, e in found.cameras.items()}), deviations, cuts


def _deviations(
    adjusted: Adjusted,
    recordings: Mapping[str, Recording],
    coverage: CoverageSettings,
    reference: str,
    origins: Mapping[str, Origin],
) -> Posterior:
    means = np.array([_since_frame_0_s(recordings[c], origins[c]) for c in adjusted.camera_ids])
    supported = supported_knots(adjusted, coverage)
    return posterior(adjusted, means, supported, adjusted.camera_ids.index(reference))


def supported_knots(adjusted: Adjusted, coverage: CoverageSettings) -> BoolArray:
    """The knots (k,) that enough cameras with agreeing detections support."""
    times = []
    for index in range(len(adjusted.camera_ids)):
        own = adjusted.problem.observations.camera == index
        residuals = _residuals(adjusted, own, index, float(adjusted.weights.sigma_px[index]), coverage)
        times.append(np.sort(residuals.time_s[residuals.inlier]))
    return support(adjusted.problem.grid.knots_s(), times, coverage.window_s) >= coverage.min_cameras


def _seen_s(adjusted: Adjusted) -> list[FloatArray]:
    """Ascending times of every camera's detections, on the trajectory or not."""
    times_s = _times_s(adjusted)
    camera = adjusted.problem.observations.camera
    return [np.sort(times_s[camera == index]) for index in range(len(adjusted.camera_ids))]


def _times_s(adjusted: Adjusted) -> FloatArray:
    """Times (n,) at which the detections were exposed."""
    seen, clock = adjusted.problem.observations, adjusted.state.clock[adjusted.problem.observations.camera]
    return clock[:, 0] + clock[:, 1] * seen.tau_s + clock[:, 2] * seen.row


def _since_frame_0_s(recording: Recording, origin: Origin) -> float:
    """Mean camera time of the detections since the frame that was numbered 0."""
    first_s, period_s = recording.frame_line()
    return mean_camera_time_s(recording) - first_s + origin.frame * period_s


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
        deviations.centre_covariance[index],
    )


def _residuals(
    adjusted: Adjusted, own: FloatArray, index: int, sigma_px: float, coverage: CoverageSettings
) -> Residuals:
    """Residuals of a camera's detections that fall on the trajectory."""
    observations = adjusted.problem.observations
    rows = np.flatnonzero(own & np.isfinite(adjusted.residual_px[:, 0]))
    error = adjusted.residual_px[rows]
    return Residuals(
        adjusted.frames[rows],
        _times_s(adjusted)[rows],
        observations.xy_px[rows],
        error,
        inliers(error, sigma_px, coverage.inlier_sigmas),
    )
