"""The frame, unit and clock that a reconstruction is delivered in: those of its reference camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skytrace.geometry.rigid import Rigid, Similarity
from skytrace.model.camera import Clock
from skytrace.model.reconstruction import CameraEstimate, Reconstruction
from skytrace.model.trajectory import Segment, Trajectory


def in_reference_gauge(
    reconstruction: Reconstruction, nominal_period_s: float, first_frame_s: float = 0.0
) -> Reconstruction:
    """The same reconstruction with the reference camera at the origin, looking along z, its clock the world's.

    The unit of length is the root mean square distance of the camera centres from their mean. The world's time is the
    reference camera's own: `first_frame_s` + frame * `nominal_period_s` at the top image row.
    """
    reference = reconstruction.cameras[reconstruction.reference]
    rate = reference.clock.period_s / nominal_period_s
    offset = reference.clock.offset_s - rate * first_frame_s
    world_from_old = _frame(reconstruction)
    return replace(
        reconstruction,
        cameras={c: _camera(e, world_from_old, offset, rate) for c, e in reconstruction.cameras.items()},
        trajectory=_trajectory(reconstruction.trajectory, world_from_old, offset, rate),
    )


def _frame(reconstruction: Reconstruction) -> Similarity:
    pose = reconstruction.cameras[reconstruction.reference].camera_from_world
    centres = np.stack([c.camera_from_world.centre for c in reconstruction.cameras.values()])
    spread = float(np.sqrt(((centres - centres.mean(axis=0)) ** 2).sum(axis=1).mean()))
    return Similarity(1 / spread, pose.rotation, pose.translation / spread)


def _camera(camera: CameraEstimate, world_from_old: Similarity, offset: float, rate: float) -> CameraEstimate:
    clock, deviation = camera.clock, camera.clock_deviation
    turn = world_from_old.scale * world_from_old.rotation
    return replace(
        camera,
        camera_from_world=_cleaned(world_from_old.apply_to_pose(camera.camera_from_world)),
        clock=Clock((clock.offset_s - offset) / rate, clock.period_s / rate, clock.readout_s / rate, clock.height_px),
        residuals=replace(camera.residuals, time_s=(camera.residuals.time_s - offset) / rate),
        clock_deviation=replace(
            deviation,
            offset_s=deviation.offset_s / rate,
            period_s=deviation.period_s / rate,
            readout_s=deviation.readout_s / rate,
        ),
        centre_covariance=turn @ camera.centre_covariance @ turn.T,
    )


def _cleaned(pose: Rigid) -> Rigid:
    """The pose with rounding noise of the reference camera's zeros removed."""
    return Rigid(np.where(np.abs(pose.rotation) < 1e-14, 0.0, pose.rotation), pose.translation + 0.0)


def _trajectory(trajectory: Trajectory, world_from_old: Similarity, offset: float, rate: float) -> Trajectory:
    def moved(s: Segment) -> Segment:
        return replace(
            s,
            knot_start_s=(s.knot_start_s - offset) / rate,
            knot_spacing_s=s.knot_spacing_s / rate,
            begin_s=(s.begin_s - offset) / rate,
            end_s=(s.end_s - offset) / rate,
        )

    return Trajectory(tuple(moved(s) for s in trajectory.transformed(world_from_old).segments))
