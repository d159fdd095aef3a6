"""What the calibration minimises over: corners of one board, a pose and a motion per view, one lens, the board's shape.

A corner at b on its board, seen on row y of a picture h rows high, lies in the camera frame at
exp(s w) (R b + t) with s = y / h - 1/2: the camera turns by w while the rows of one picture are read out. What a shift
of the camera does to a board, which has hardly any depth, a turn does as well; measured, shifts on top bring nothing.

A board on foam or paper is bent by a part of a millimetre: b = ((1 + e) x, y, xx x^2 + xy x y + yy y^2). A quadratic
surface looks the same half a turn round and from any other corner, but for a rigid motion; so it is enough to know
which side of the board is the long one.

Stabilised lenses move an element sidewise from picture to picture; what that does beyond shifting the picture is to
change the tangential distortion, so each view has its own change of p1 and p2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from skytrace.geometry.arrays import BoolArray, FloatArray, IntArray
from skytrace.geometry.projection import COEFFICIENTS, LensModel
from skytrace.geometry.rigid import so3_exp
from skytrace.model.camera import Intrinsics

# Columns of a view's block. A rotation is updated by R <- exp(omega) R.
ROTATION, TRANSLATION, TURN = slice(0, 3), slice(3, 6), slice(6, 9)
DECENTRING = slice(9, 11)
N_VIEW = 11
# Columns of the block all views share: the logarithms of fx and of fy / fx, the principal point in image widths, the
# board's shape (xx, xy, yy, e), the lens's coefficients.
FOCAL, ASPECT = 0, 1
PRINCIPAL = slice(2, 4)
SHAPE = slice(4, 8)
BENDING = slice(8, None)


def n_shared(model: LensModel) -> int:
    """Number of parameters that all views share."""
    return BENDING.start + len(COEFFICIENTS[model])


@dataclass(frozen=True, eq=False, slots=True)
class View:
    """The corners of one board in one picture."""

    name: str
    lattice: IntArray  # (n, 2) column and row on the board, from an arbitrary corner
    xy_px: FloatArray  # (n, 2)
    long_first: bool | None = None  # whether columns run along the board's longer side; None where that is not known

    def __len__(self) -> int:
        return len(self.lattice)


@dataclass(frozen=True, eq=False, slots=True)
class Corners:
    """All corners of some views, one view after another."""

    view: IntArray  # (n,) index of the view, ascending
    start: IntArray  # (v,) first corner of each view
    board: FloatArray  # (n, 2) on the flat board, in squares from the view's middle corner
    xy_px: FloatArray  # (n, 2)
    row: FloatArray  # (n,) y / h - 1/2
    shaped: BoolArray  # (v,) whether the first axis is the board's longer side, so that its shape applies
    size_px: tuple[int, int]

    @property
    def n_views(self) -> int:
        return len(self.start)

    def __len__(self) -> int:
        return len(self.view)

    @property
    def counts(self) -> IntArray:
        """Corners (v,) of each view."""
        return np.diff(self.start, append=len(self))

    def take(self, chosen: BoolArray) -> Corners:
        """Some of the corners (n,); views that keep none are left out, the others numbered anew."""
        kept, first, view = np.unique(self.view[chosen], return_index=True, return_inverse=True)
        return Corners(
            view,
            first,
            self.board[chosen],
            self.xy_px[chosen],
            self.row[chosen],
            self.shaped[kept],
            self.size_px,
        )

    def of_views(self, views: IntArray) -> Corners:
        """The corners of some views, given by ascending index."""
        return self.take(np.isin(self.view, views))

    def per_view(self, values: FloatArray) -> FloatArray:
        """Sums (v, ...) over each view's corners of values (n, ...)."""
        return np.add.reduceat(values, self.start, axis=0)


def collect(views: Sequence[View], size_px: tuple[int, int]) -> Corners:
    """The corners of views, none of which may be empty."""
    counts = np.array([len(v) for v in views])
    xy_px = np.concatenate([v.xy_px for v in views])
    return Corners(
        np.repeat(np.arange(len(views)), counts),
        np.concatenate([[0], np.cumsum(counts)[:-1]]),
        np.concatenate([_centred(v) for v in views]).astype(float),
        xy_px,
        xy_px[:, 1] / size_px[1] - 0.5,
        np.array([v.long_first is not None for v in views]),
        size_px,
    )


def _centred(view: View) -> FloatArray:
    """A view's lattice (n, 2) from its middle corner, turned so that the first axis is the longer one."""
    lattice = view.lattice - np.round(view.lattice.mean(axis=0))
    # A quarter turn, not an exchange of the axes: the board is seen from its front, always.
    return np.column_stack([lattice[:, 1], -lattice[:, 0]]) if view.long_first is False else lattice


@dataclass(frozen=True, eq=False, slots=True)
class State:
    """All unknowns."""

    lens: Intrinsics
    shape: FloatArray  # (4,) xx, xy, yy per square, and e
    rotation: FloatArray  # (v, 3, 3) camera from board at the middle row
    translation: FloatArray  # (v, 3) in squares
    turn_rad: FloatArray  # (v, 3) w, over one readout of the whole picture
    decentring: FloatArray  # (v, 2) changes of p1 and p2

    def moved(self, view_step: FloatArray, shared_step: FloatArray) -> State:
        """The state after a step (v, 11) of the views and (s,) of what they share."""
        lens = self.lens
        scale = np.exp(shared_step[FOCAL] + np.array([0.0, shared_step[ASPECT]]))
        return State(
            replace(
                lens,
                focal_px=lens.focal_px * scale,
                principal_px=lens.principal_px + shared_step[PRINCIPAL] * lens.size_px[0],
                distortion=lens.distortion + shared_step[BENDING],
            ),
            self.shape + shared_step[SHAPE],
            so3_exp(view_step[:, ROTATION]) @ self.rotation,
            self.translation + view_step[:, TRANSLATION],
            self.turn_rad + view_step[:, TURN],
            self.decentring + view_step[:, DECENTRING],
        )

    def of_views(self, views: IntArray) -> State:
        """The state of some views."""
        return replace(
            self,
            rotation=self.rotation[views],
            translation=self.translation[views],
            turn_rad=self.turn_rad[views],
            decentring=self.decentring[views],
        )

    @property
    def tilt_rad(self) -> FloatArray:
        """Angles (v,) between the boards' normals and the optical axis."""
        return np.arccos(np.clip(np.abs(self.rotation[:, 2, 2]), 0, 1))


@dataclass(frozen=True, eq=False, slots=True)
class Beliefs:
    """Noise and priors. A deviation of 0 holds a parameter at its start."""

    noise_px: FloatArray  # (v,) deviation per axis of a view's corners
    # Corners that tell as much of the lens as one whose error were noise alone: what no model says, such as focus that
    # follows the board, makes halves of real sets disagree by several times what their noise would.
    inflation: float = 25.0
    turn_sigma_rad: float = 0.0
    decentring_sigma: float = 0.0
    lens_free: bool = True  # and the board's shape; otherwise views are fitted to them as they are
    aspect_free: bool = False
    shape_free: bool = False
    coefficients_free: int = 5  # how many of the lens's coefficients may differ from zero
    loss_scale: float = 3.0  # of the Cauchy loss, in deviations of the noise

    def of_views(self, views: IntArray) -> Beliefs:
        """What is believed of some views."""
        return replace(self, noise_px=self.noise_px[views])
