"""The reconstruction while it grows: the cameras registered so far and the spline through what they see."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from skytrace.estimation.adjust.problem import KnotGrid
from skytrace.geometry.arrays import FloatArray, frozen_array
from skytrace.geometry.projection import RADIAL
from skytrace.geometry.rigid import Rigid
from skytrace.model.camera import Clock, Intrinsics
from skytrace.model.track import Recording

N_LENS = 7


@dataclass(frozen=True, eq=False, slots=True)
class CameraState:
    """A registered camera: t = offset_s + rate * camera time + readout_s * row / height."""

    camera_from_world: Rigid
    offset_s: float
    rate: float
    readout_s: float
    lens: FloatArray  # (7,) change of the calibration, see adjust.problem.LENS

    def __post_init__(self) -> None:
        object.__setattr__(self, "lens", frozen_array(self.lens, (N_LENS,), "lens"))

    def clock(self, recording: Recording) -> Clock:
        """The clock by frames: where they have time stamps, along the straight line through these."""
        offset_s, period_s = self.offset_s, self.rate / recording.frame_rate_hz
        if recording.stamped:
            first_s, stamped_period_s = recording.frame_line()
            offset_s, period_s = offset_s + self.rate * first_s, self.rate * stamped_period_s
        return Clock(offset_s, period_s, self.readout_s, recording.intrinsics.height_px)

    def intrinsics(self, calibrated: Intrinsics) -> Intrinsics:
        """The calibration with this camera's refinement applied."""
        focal, aspect, principal_x, principal_y = self.lens[:4]
        distortion = np.array(calibrated.distortion)
        distortion[list(RADIAL[calibrated.model])] += self.lens[4:]
        return replace(
            calibrated,
            focal_px=calibrated.focal_px * np.exp([focal, focal + aspect]),
            principal_px=calibrated.principal_px + calibrated.focal_px * [principal_x, principal_y],
            distortion=distortion,
        )


@dataclass(frozen=True, eq=False, slots=True)
class Scene:
    """Registered cameras by id, the camera that fixes the gauge, and the trajectory (none before it is fitted)."""

    reference: str
    cameras: Mapping[str, CameraState]
    grid: KnotGrid | None = None
    control: FloatArray | None = None  # (m, 3)

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", MappingProxyType(dict(self.cameras)))

    def with_camera(self, camera_id: str, camera: CameraState) -> Scene:
        return replace(self, cameras={**self.cameras, camera_id: camera})

    def with_trajectory(self, grid: KnotGrid, control: FloatArray) -> Scene:
        return replace(self, grid=grid, control=control)
