"""Clocks that do not run evenly: where a camera's frame times leave the straight line, found from the residuals.

Phones drop and delay frames when they are warm or dark. Without time stamps such a camera disagrees with the trajectory
along its direction of motion, now ahead and now behind; a slowly varying time correction takes that up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from skytrace.estimation.adjust.driver import Adjusted, mean_camera_time_s
from skytrace.estimation.adjust.reference import image_velocity
from skytrace.geometry.arrays import FloatArray
from skytrace.model.track import Recording, Track


@dataclass(frozen=True, slots=True)
class WanderSettings:
    node_spacing_s: float = 1.0
    walk_s_per_root_s: float = 0.02  # an uneven clock is expected to stray by this in a second
    min_wander_s: float = 0.004  # smaller ones are left to noise
    min_gain: float = 0.5  # share of the squared residuals that the correction must explain
    iterations: int = 3


@dataclass(frozen=True, eq=False, slots=True)
class Wander:
    """A camera's time correction: seconds (m,) to add to the camera time at nodes (m,), linear in between."""

    node_s: FloatArray
    correction_s: FloatArray
    rms_s: float  # over the detections, its linear part removed
    gain: float  # share of the squared residuals that it explains

    def at(self, camera_time_s: FloatArray) -> FloatArray:
        return np.interp(camera_time_s, self.node_s, self.correction_s)


def find_wander(adjusted: Adjusted, settings: WanderSettings) -> dict[str, Wander]:
    """The cameras whose clocks wander, with their corrections; cameras that run evenly are absent."""
    o = adjusted.problem.observations
    velocity_px_s = image_velocity(adjusted.problem, adjusted.state)
    found = {}
    for i, camera_id in enumerate(adjusted.camera_ids):
        own = (o.camera == i) & np.isfinite(adjusted.residual_px[:, 0])
        if i == adjusted.problem.reference or own.sum() < 20:
            continue
        velocity, residual = velocity_px_s[own], adjusted.residual_px[own]
        wander = estimate_wander(o.tau_s[own], residual, velocity, float(adjusted.weights.sigma_px[i]), settings)
        if wander.rms_s > settings.min_wander_s and wander.gain > settings.min_gain:
            found[camera_id] = wander
    return found


def estimate_wander(
    tau_s: FloatArray, residual_px: FloatArray, velocity_px_s: FloatArray, sigma_px: float, settings: WanderSettings
) -> Wander:
    """The random walk of the clock that explains residuals (n, 2) along image velocities (n, 2), robustly.

    Minimises the Cauchy loss of residual + velocity * correction plus the squared steps between nodes over their
    expected variance; the straight line is taken out, being the clock's offset and rate.
    """
    from scipy.linalg import solveh_banded

    h = settings.node_spacing_s
    nodes = np.arange(np.floor(tau_s.min() / h), np.ceil(tau_s.max() / h) + 2) * h
    k = np.clip(((tau_s - nodes[0]) / h).astype(np.int64), 0, len(nodes) - 2)
    u = (tau_s - nodes[k]) / h
    step_precision = 1 / (settings.walk_s_per_root_s**2 * h)
    correction = np.zeros(len(nodes))
    for _ in range(settings.iterations):
        error = residual_px + velocity_px_s * ((1 - u) * correction[k] + u * correction[k + 1])[:, None]
        weight = 1 / sigma_px**2 / (1 + (error**2).sum(axis=1) / (2 * sigma_px) ** 2)
        information = weight * (velocity_px_s**2).sum(axis=1)
        pull = -weight * (velocity_px_s * residual_px).sum(axis=1)
        band = np.zeros((2, len(nodes)))
        band[1] = np.bincount(k, information * (1 - u) ** 2, len(nodes))
        band[1] += np.bincount(k + 1, information * u**2, len(nodes))
        band[0, 1:] = np.bincount(k, information * u * (1 - u), len(nodes))[:-1] - step_precision
        band[1, :-1] += step_precision
        band[1, 1:] += step_precision
        band[1] += 1e-9 * step_precision
        rhs = np.bincount(k, pull * (1 - u), len(nodes)) + np.bincount(k + 1, pull * u, len(nodes))
        correction = solveh_banded(band, rhs)
    # Time stamps must go on increasing, however wild the correction where nothing was seen.
    correction = correction[0] + np.r_[0.0, np.cumsum(np.clip(np.diff(correction), -0.5 * h, 0.5 * h))]
    applied = (1 - u) * correction[k] + u * correction[k + 1]
    line = np.polyfit(tau_s, applied, 1)
    error = residual_px + velocity_px_s * applied[:, None]
    before, after = ((np.minimum((r / sigma_px) ** 2, 9.0)).sum() for r in (residual_px, error))
    return Wander(
        nodes,
        correction - np.polyval(line, nodes),
        float(np.std(applied - np.polyval(line, tau_s))),
        float(1 - after / max(before, 1e-300)),
    )


def retimed(recording: Recording, wander: Wander, rate: float) -> Recording:
    """The recording with time stamps that take the wander out of its clock of the given rate."""
    mean = mean_camera_time_s(recording)

    def stamp(track: Track) -> Track:
        time = recording.camera_time_s(track)
        return replace(track, time_s=time + wander.at(time - mean) / rate)

    return replace(recording, tracks=tuple(stamp(track) for track in recording.tracks))
