"""What the adjustment minimises over: the state, the observations, and the layout of a camera's parameters.

Reprojection (Li et al. 2020, eq. 7-9): a detection in frame j on image row y of h was exposed at
t = beta + alpha j + gamma y / h, and the trajectory at t must project onto it in raw, distorted pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from skytrace.estimation.adjust.losses import LossKind
from skytrace.geometry.arrays import BoolArray, FloatArray, IntArray
from skytrace.geometry.projection import six_coefficients
from skytrace.geometry.rigid import so3_exp
from skytrace.model.camera import Intrinsics
from skytrace.solvers import bspline

# Columns of one camera's parameter block. A rotation is updated by R <- exp(omega) R; lens parameters are changes of
# the calibration: logarithms of focal scale and aspect, the principal point in focal lengths, radial coefficients.
ROTATION = slice(0, 3)
CENTRE = slice(3, 6)
OFFSET, RATE, READOUT = 6, 7, 8
FOCAL, ASPECT = 9, 10
PRINCIPAL = slice(11, 13)
RADIAL = slice(13, 16)
CLOCK = slice(6, 9)
LENS = slice(9, 16)
N_PARAMETERS = 16


def columns_of(free: BoolArray) -> IntArray:
    """The unknown (c, 16) that each free camera parameter is, counted camera by camera; -1 where it is held fixed.

    The solver asks for no more than this map: parameters given the same unknown move together.
    """
    return np.where(free, np.cumsum(free.ravel()).reshape(free.shape) - 1, -1)


def calibration_row(lens: Intrinsics) -> FloatArray:
    """A camera's calibration (11,): fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, and 1 for a fisheye, else 0."""
    coefficients = six_coefficients(lens.distortion, lens.model)
    return np.concatenate([lens.focal_px, lens.principal_px, coefficients, [float(lens.model == "fisheye")]])


@dataclass(frozen=True, eq=False, slots=True)
class Observations:
    """Detections of all cameras; ordered by camera and time they are worked on fastest."""

    camera: IntArray  # (n,) index of the camera
    tau_s: FloatArray  # (n,) camera time less the camera's mean, so that offset and rate are uncorrelated
    row: FloatArray  # (n,) row / image height
    xy_px: FloatArray  # (n, 2) raw pixels

    def __len__(self) -> int:
        return len(self.camera)


@dataclass(frozen=True, eq=False, slots=True)
class KnotGrid:
    """Where the trajectory lives: runs of knot intervals at integer multiples of the spacing on the reference clock.

    Interval k spans [k, k + 1) * spacing_s. Each run of intervals a .. b - 1 owns b - a + 3 control points of its own.
    """

    spacing_s: float
    runs: tuple[tuple[int, int], ...]  # (a, b) of each run, ascending, at least one interval apart

    @property
    def n_control(self) -> int:
        return sum(b - a + 3 for a, b in self.runs)

    @property
    def first_interval(self) -> int:
        return self.runs[0][0]

    def knots_s(self) -> FloatArray:
        """Times (k,) of the knots that bound the intervals of each run, runs one after another."""
        return np.concatenate([self.spacing_s * np.arange(a, b + 1) for a, b in self.runs]).astype(np.float64)

    def control_of_interval(self) -> IntArray:
        """First of the four control points of each interval from `first_interval` on; -1 between runs."""
        table = np.full(self.runs[-1][1] - self.first_interval, -1, np.int64)
        start = 0
        for a, b in self.runs:
            table[a - self.first_interval : b - self.first_interval] = start + np.arange(b - a)
            start += b - a + 3
        return table

    def locate(self, time_s: FloatArray) -> tuple[IntArray, FloatArray]:
        """First control point (n,), -1 outside all runs, and position inside the interval (n,) of times (n,)."""
        position = np.asarray(time_s, float) / self.spacing_s
        interval = np.floor(position).astype(np.int64)
        table = self.control_of_interval()
        k = interval - self.first_interval
        inside = (k >= 0) & (k < len(table))
        return np.where(inside, table[np.clip(k, 0, len(table) - 1)], -1), position - interval

    def evaluate(self, control: FloatArray, time_s: FloatArray, derivative: int = 0) -> FloatArray:
        """Position (n, 3) at times (n,), or a derivative in time; NaN outside all runs."""
        first, u = self.locate(time_s)
        value = bspline.evaluate(control, np.maximum(first, 0), u, self.spacing_s, derivative)
        value[first < 0] = np.nan
        return value


@dataclass(frozen=True, eq=False, slots=True)
class State:
    """All unknowns. Cameras are indexed as in Observations."""

    rotation: FloatArray  # (c, 3, 3) camera from world
    centre: FloatArray  # (c, 3) in the world
    clock: FloatArray  # (c, 3) time at mean camera time, rate, readout_s
    lens: FloatArray  # (c, 7) change of the calibration, see LENS
    control: FloatArray  # (m, 3) control points in the world

    def parameters(self) -> FloatArray:
        """Camera parameters (c, 16) as priors know them; rotations, which have no coordinates, are 0."""
        return np.hstack([np.zeros_like(self.centre), self.centre, self.clock, self.lens])

    @property
    def finite(self) -> bool:
        """Whether every number is one."""
        return all(np.isfinite(a).all() for a in (self.rotation, self.centre, self.clock, self.lens, self.control))

    def moved(self, camera_step: FloatArray, control_step: FloatArray) -> State:
        """The state after a step (c, 16) of the cameras and (m, 3) of the control points."""
        rotation = np.stack([so3_exp(w) @ R for w, R in zip(camera_step[:, ROTATION], self.rotation, strict=True)])
        return State(
            rotation,
            self.centre + camera_step[:, CENTRE],
            self.clock + camera_step[:, CLOCK],
            self.lens + camera_step[:, LENS],
            self.control + control_step,
        )

    def scaled(self, factor: float, about: FloatArray) -> State:
        """The same scene in another unit, `about` (3,) kept in place."""
        return replace(
            self,
            centre=about + factor * (self.centre - about),
            control=about + factor * (self.control - about),
        )


@dataclass(frozen=True, eq=False, slots=True)
class Weights:
    """How much each camera's residuals count."""

    sigma_px: FloatArray  # (c,) robust deviation of a residual per axis
    information: FloatArray  # (c,) share of independent information per residual, at most 1 for the best camera
    loss_scale: float = 2.0  # in deviations
    loss: LossKind = "cauchy"


@dataclass(frozen=True, eq=False, slots=True)
class Problem:
    """Everything that stays fixed while the state moves."""

    observations: Observations
    calibration: FloatArray  # (c, 11) of each camera as `calibration_row` has it
    grid: KnotGrid
    reference: int  # camera that fixes the gauge
    unit_held: bool = True  # keep the spread of the camera centres, which nothing else determines

    @property
    def n_cameras(self) -> int:
        return len(self.calibration)
