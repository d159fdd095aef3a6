"""Pictures and exact corners of boards filmed through a known lens while they move, for the calibration's tests."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from skytrace.geometry.rigid import so3_exp
from skytrace.model.camera import Intrinsics

PINHOLE = Intrinsics([880.0, 880.0], [648.0, 352.0], [-0.11, 0.13, 8e-4, -5e-4, -0.04], (1280, 720))
FISHEYE = Intrinsics([520.0, 520.0], [645.0, 355.0], [-0.035, 0.08, -0.03, 0.004], (1280, 720), "fisheye")


def half_size(lens):
    """The same lens on a sensor of half as many pixels along each side: quicker to render."""
    width, height = lens.size_px
    return replace(
        lens,
        focal_px=0.5 * lens.focal_px,
        principal_px=0.5 * (lens.principal_px + 0.5) - 0.5,
        size_px=(width // 2, height // 2),
    )


@dataclass(frozen=True)
class Board:
    """Squares along x and y; the board's plane is in squares, its first inner corner at (0, 0)."""

    columns: int = 8
    rows: int = 7
    sag: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of z = xx x^2 + xy x y + yy y^2 about the middle

    @property
    def lattice(self):
        i, j = np.meshgrid(np.arange(self.columns - 1), np.arange(self.rows - 1), indexing="ij")
        return np.column_stack([i.ravel(), j.ravel()])

    def points(self):
        """Inner corners (n, 3) about the middle of the board."""
        x, y = (self.lattice - (np.array([self.columns, self.rows]) - 2) / 2).T
        xx, xy, yy = self.sag
        return np.column_stack([x, y, xx * x * x + xy * x * y + yy * y * y])


@dataclass(frozen=True)
class Shot:
    """A board's pose at the middle row, and its motion over one readout: radians, and distances of the board."""

    rotation: np.ndarray
    translation: np.ndarray
    turn_rad: np.ndarray = field(default_factory=lambda: np.zeros(3))
    shift: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def at(self, row):
        """Rotations (n, 3, 3) and translations (n, 3) of the board when rows y / h - 1/2 (n,) are read."""
        twist = so3_exp(np.asarray(row)[:, None] * self.turn_rad)
        moved = np.asarray(row)[:, None] * self.shift * self.translation[2]
        return twist @ self.rotation, (twist @ self.translation) + moved


def shots(lens, n, rng, *, turn_rad=0.0, shift=0.0, tilt_deg=(10.0, 45.0), rolls_deg=(0.0, 90.0), reach=0.8, size=None):
    """Poses of a board some seven squares wide all over the picture, tilted every way, and its motions."""
    width, height = lens.size_px
    out = []
    for k in range(n):
        tilt, towards = np.radians(rng.uniform(*tilt_deg)), rng.uniform(0, 2 * np.pi)
        roll = np.radians(rolls_deg[k % len(rolls_deg)] + rng.uniform(-8, 8))
        lean = so3_exp(tilt * np.array([np.cos(towards), np.sin(towards), 0.0]))
        rotation = lean @ so3_exp(np.array([0.0, 0.0, roll]))
        side = reach * rng.uniform(-1, 1, 2) * [0.32 * width, 0.28 * height]
        ray = lens.rays(np.array([[width / 2 + side[0], height / 2 + side[1]]]))[0]
        squares = rng.uniform(0.07, 0.1) if size is None else size  # a square's share of the picture's width
        distance = float(lens.focal_px[0]) / (squares * width)
        motion = rng.normal(0, turn_rad, 3) if turn_rad else np.zeros(3)
        drift = rng.normal(0, shift, 3) if shift else np.zeros(3)
        out.append(Shot(rotation, ray / ray[2] * distance, motion, drift))
    return out


def exact_corners(lens, board, shot):
    """Pixels (n, 2) of the inner corners, each on the row on which it is exposed; NaN outside the picture."""
    points, row = board.points(), np.zeros(len(board.lattice))
    for _ in range(50):
        rotation, translation = shot.at(row)
        xy = lens.project((rotation @ points[:, :, None])[:, :, 0] + translation)
        row = xy[:, 1] / lens.size_px[1] - 0.5
    inside = ((xy >= 4) & (xy <= np.array(lens.size_px) - 5)).all(1)
    return np.where(inside[:, None], xy, np.nan)


def render(lens, board, shot, rng=None, *, noise=2.0, over=3, pattern=None, blur_px=0.7):
    """A grey picture (h, w) uint8 of a flat board, squares black and white on a white margin over a grey wall."""
    import cv2

    width, height = lens.size_px
    step = (np.arange(over) - (over - 1) / 2) / over
    x = (np.arange(width)[:, None] + step).ravel()
    y = (np.arange(height)[:, None] + step).ravel()
    gx, gy = np.meshgrid(x, y)
    xy_norm, _ = lens.undistort(np.column_stack([gx.ravel(), gy.ravel()]))
    rays = np.column_stack([xy_norm, np.ones(len(xy_norm))]).reshape(len(y), len(x), 3)
    rotation, translation = shot.at(y / height - 0.5)
    # A ray meets the board where R^T (s ray - t) has no third part.
    normal = rotation[:, :, 2]
    s = (normal * translation).sum(1)[:, None] / np.einsum("yxk,yk->yx", rays, normal)
    on_board = np.einsum("ykj,yxk->yxj", rotation, s[:, :, None] * rays - translation[:, None])[..., :2]
    u = on_board[..., 0] + board.columns / 2
    v = on_board[..., 1] + board.rows / 2
    picture = np.full(u.shape, 90.0)
    margin = (u > -0.6) & (v > -0.6) & (u < board.columns + 0.6) & (v < board.rows + 0.6) & (s > 0)
    picture[margin] = 225.0
    inside = (u > 0) & (v > 0) & (u < board.columns) & (v < board.rows) & (s > 0)
    if pattern is None:
        dark = inside & ((np.floor(u) + np.floor(v)) % 2 == 0)
        picture[dark] = 35.0
    else:
        h, w = pattern.shape
        column, row = (u[inside] * w / board.columns).astype(int), (v[inside] * h / board.rows).astype(int)
        picture[inside] = 35.0 + 190.0 / 255.0 * pattern[row, column]
    picture = picture.reshape(height, over, width, over).mean(axis=(1, 3))
    picture = cv2.GaussianBlur(picture, (0, 0), blur_px)
    if rng is not None:
        picture = picture + rng.normal(0, noise, picture.shape)
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)
