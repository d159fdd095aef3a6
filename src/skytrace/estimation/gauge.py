"""The frame, unit and clock that a reconstruction is delivered in: its reference camera's, but for what is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skytrace.estimation.known import Known
from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import Rigid, Similarity
from skytrace.model.camera import Clock
from skytrace.model.reconstruction import CameraEstimate, Frame, Reconstruction
from skytrace.model.trajectory import Segment, Trajectory


def in_reference_gauge(
    reconstruction: Reconstruction, nominal_period_s: float, first_frame_s: float = 0.0
) -> Reconstruction:
    """The same reconstruction with the reference camera at the origin, looking along z, its clock the world's.

    The unit of length is the root mean square distance of the camera centres from their mean. The world's time is the
    reference camera's own: `first_frame_s` + frame * `nominal_period_s` at the top image row.
    """
    return in_gauge(reconstruction, _of_reference(reconstruction), nominal_period_s, first_frame_s)


def in_known_gauge(
    reconstruction: Reconstruction, known: Known | None, nominal_period_s: float, first_frame_s: float = 0.0
) -> Reconstruction:
    """The same reconstruction in the frame that is known of it, its time as that of `in_reference_gauge`.

    Where positions are known it is their frame; else the reference camera's centre is the origin, and where the
    vertical is known z points up and y horizontally to where that camera looks. Lengths are metres where anything
    tells them.
    """
    if known is None or not known.placed:
        return in_reference_gauge(reconstruction, nominal_period_s, first_frame_s)
    frame: Frame = "camera"
    if known.unit_known and known.positions:
        frame, world_from_old = "given", Similarity(1.0, np.eye(3), known.origin_m)
    else:
        scale = 1.0 if known.unit_known else 1 / _spread(reconstruction)
        pose = reconstruction.cameras[reconstruction.reference].camera_from_world
        frame, rotation = ("level", _levelled(pose)) if known.ups else ("camera", pose.rotation)
        world_from_old = Similarity(scale, rotation, -scale * rotation @ pose.centre)
    found = in_gauge(reconstruction, world_from_old, nominal_period_s, first_frame_s)
    found = replace(found, gauge="metric" if known.unit_known else "arbitrary", frame=frame)
    if frame != "given" or known.earth is None or not known.complete:
        return found
    return replace(found, frame="enu", georeference=known.earth)


def in_gauge(
    reconstruction: Reconstruction, world_from_old: Similarity, nominal_period_s: float, first_frame_s: float = 0.0
) -> Reconstruction:
    """The same reconstruction moved to another world, its time that of the reference camera."""
    reference = reconstruction.cameras[reconstruction.reference]
    rate = reference.clock.period_s / nominal_period_s
    offset = reference.clock.offset_s - rate * first_frame_s
    return replace(
        reconstruction,
        cameras={c: _camera(e, world_from_old, offset, rate) for c, e in reconstruction.cameras.items()},
        trajectory=_trajectory(reconstruction.trajectory, world_from_old, offset, rate),
    )


def _of_reference(reconstruction: Reconstruction) -> Similarity:
    pose = reconstruction.cameras[reconstruction.reference].camera_from_world
    spread = _spread(reconstruction)
    return Similarity(1 / spread, pose.rotation, pose.translation / spread)


def _spread(reconstruction: Reconstruction) -> float:
    centres = np.stack([c.camera_from_world.centre for c in reconstruction.cameras.values()])
    return float(np.sqrt(((centres - centres.mean(axis=0)) ** 2).sum(axis=1).mean()))


def _levelled(pose: Rigid) -> FloatArray:
    """The rotation (3, 3) about z that turns a level world's y to where a camera looks, or to its upper edge."""
    ahead = pose.rotation[2] if abs(pose.rotation[2, 2]) < 0.99 else -pose.rotation[1] * np.sign(pose.rotation[2, 2])
    x, y = ahead[:2] / np.linalg.norm(ahead[:2])
    return np.array([[y, -x, 0.0], [x, y, 0.0], [0.0, 0.0, 1.0]])


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
