"""What stands below the sky: fields, hills, and trees that move in the wind."""

from __future__ import annotations

import cv2
import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import Rigid
from skytrace.model.camera import Intrinsics
from skytrace.simulation.render_noise import Field, fractal_line, fractal_tile
from skytrace.simulation.render_sky import Grid

_EYE_M = 1.6
_SHIFT = 4  # fractional bits of cv2's coordinates
_FIELD_U, _FIELD_V, _TREE_U, _TREE_V = 117.0, 127.0, 121.0, 127.0
# The field of motion is drawn this much coarser than the picture.
_COARSE = 8


class Scenery:
    """A strip at the lower border of a picture, from row `top` down."""

    def __init__(self, lens: Intrinsics, pose: Rigid, grid: Grid, rng: np.random.Generator) -> None:
        ground_rng, tree_rng, wind_rng = rng.spawn(3)
        width, height = lens.size_px
        skyline = _skyline_rad(ground_rng)
        ground = _Ground(lens, grid, skyline, ground_rng)
        trees = _Trees(lens, pose, tree_rng)
        rows = np.flatnonzero((ground.cover > 0.01).any(1) | (trees.cover > 0.01).any(1))
        margin = height // 100 + 2
        self.top = max(0, int(rows[0]) - margin) if len(rows) else height
        self.shape = (height - self.top, width)
        if self.top == height:
            return
        self._ground_cover, self._ground_light = ground.cover[self.top :], ground.light[self.top :]
        self._trees = np.dstack([trees.cover, trees.light])[self.top :]
        self._sway = _Sway(trees.sway_px[self.top :], wind_rng)
        behind = np.clip(1 - trees.cover, 0, 1)
        half = (width // 2, height // 2)
        self._chroma_cover, self._blue, self._red = (
            cv2.resize(c.astype(np.float32), half, interpolation=cv2.INTER_AREA)[self.top // 2 :]
            for c in (
                1 - (1 - ground.cover) * behind,
                ground.cover * behind * _FIELD_U + trees.cover * _TREE_U,
                ground.cover * behind * _FIELD_V + trees.cover * _TREE_V,
            )
        )

    def draw(self, luma: Field, blue: Field, red: Field, time_s: float) -> None:
        """Cover the lower rows of luma (h, w) and both chroma planes (h/2, w/2), in place. Colours stand still."""
        if self.top >= len(luma):
            return
        for plane, colour in ((blue, self._blue), (red, self._red)):
            plane[self.top // 2 :] *= 1 - self._chroma_cover
            plane[self.top // 2 :] += colour
        strip = luma[self.top :]
        strip *= 1 - self._ground_cover
        strip += self._ground_light
        cover, light = cv2.split(self._sway.move(self._trees, time_s))
        strip *= 1 - cover
        strip += light


def _skyline_rad(rng: np.random.Generator) -> Field:
    """Elevation of the hills at 4096 azimuths."""
    hills = 0.012 * (1 + 0.8 * fractal_line(4096, 1.9, rng)) + 0.0008 * fractal_line(4096, 0.8, rng)
    return np.maximum(hills, 0.002).astype(np.float32)


class _Ground:
    def __init__(self, lens: Intrinsics, grid: Grid, skyline_rad: Field, rng: np.random.Generator) -> None:
        width, height = lens.size_px
        elevation = grid.enlarge(grid.elevation_rad)
        # Azimuths turn over at the back, which no lens sees together with the front.
        middle = float(grid.azimuth_rad[grid.shape[0] // 2, grid.shape[1] // 2])
        azimuth = grid.enlarge(np.mod(grid.azimuth_rad - middle + np.pi, 2 * np.pi) - np.pi)
        place = np.mod(azimuth / (2 * np.pi) * len(skyline_rad), len(skyline_rad) - 1).astype(np.float32)
        hills = cv2.remap(skyline_rad[None], place, np.zeros_like(place), cv2.INTER_LINEAR)
        pixel_rad = 1 / float(lens.focal_px[1])
        self.cover = np.clip(0.5 + (hills - elevation) / pixel_rad, 0, 1)
        field = np.clip(0.5 - elevation / pixel_rad, 0, 1)
        distance = _EYE_M / np.tan(np.maximum(-elevation, 2e-3))
        tile = fractal_tile(512, 1.1, rng)
        u, v = np.mod(distance * 40, 512), np.mod(azimuth * distance * 40, 512)
        rough = cv2.remap(tile, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        # Far away, one pixel holds many tufts.
        rough *= np.clip(4.0 / distance, 0.02, 1)
        stripe = cv2.remap(fractal_line(512, 1.2, rng)[None], np.clip(8 * np.log(distance + 1), 0, 511), 0 * u, 1)
        wood = cv2.resize(rng.standard_normal((max(2, height // 2), max(2, width // 3)), np.float32), (width, height))
        shade = field * (96 + 8 * stripe + 16 * rough) + (1 - field) * (86 + 5 * wood + 900 * elevation)
        self.light = (shade * self.cover).astype(np.float32)


class _Trees:
    """Trees painted from the farthest to the nearest, and how far the wind moves each of their pixels."""

    def __init__(self, lens: Intrinsics, pose: Rigid, rng: np.random.Generator) -> None:
        width, height = lens.size_px
        self.cover = np.zeros((height, width), np.float32)
        self.light = np.zeros_like(self.cover)
        self.sway_px = np.zeros_like(self.cover)
        ahead = pose.rotation[2]  # the optical axis in the world
        middle, half = float(np.arctan2(ahead[1], ahead[0])), np.arctan(0.6 * width / float(lens.focal_px[0]))
        stands = fractal_line(512, 1.3, rng)
        n = int(rng.integers(150, 350))
        distances = np.sort(85.0 / rng.uniform(0.12, 1.0, n))[::-1]
        for distance, place in zip(distances, rng.uniform(-1, 1, n), strict=True):
            if stands[int((place + 1) * 127)] < 0.1 - 0.6 * (distance > 250):
                continue
            azimuth = middle + half * place
            tall = rng.uniform(6.0, 15.0)
            rise = np.array([-_EYE_M, tall - _EYE_M])
            aside = distance * np.array([np.cos(azimuth), np.sin(azimuth)])
            direction = np.column_stack([np.tile(aside, (2, 1)), rise])
            foot, tip = lens.project(direction @ pose.rotation.T)
            if np.isfinite(foot).all() and np.isfinite(tip).all() and -tall < tip[1] and tip[1] < height:
                self._paint(foot, tip, distance, rng)
        self._roughen(rng)

    def _roughen(self, rng: np.random.Generator) -> None:
        """Make foliage of the discs it was painted with."""
        height, width = self.cover.shape
        y, x = np.mgrid[:height, :width].astype(np.float32)
        reach = 0.003 * width * min(1.0, width / 1600 + 0.2)
        x += reach * _spread(fractal_tile(1024, 0.85, rng), self.cover.shape)
        y += reach * _spread(fractal_tile(1024, 0.85, rng), self.cover.shape)
        layers = np.dstack([self.cover, self.light, self.sway_px])
        self.cover, self.light, self.sway_px = cv2.split(
            cv2.remap(layers, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        )
        grain = _spread(fractal_tile(1024, 0.7, rng), self.cover.shape)
        # Leaves leave holes, most of them towards the edge of a crown.
        ragged = 0.3 * min(1.0, width / 1600 + 0.2)
        self.cover = np.clip(1.6 * self.cover - 0.35 + ragged * grain * (self.cover > 0), 0, 1)
        self.light = np.clip(self.light * (1 + 0.18 * grain), 16, 235) * self.cover

    def _paint(self, foot: FloatArray, tip: FloatArray, distance: float, rng: np.random.Generator) -> None:
        up = tip - foot
        size_px = float(np.linalg.norm(up))
        if size_px < 3:
            return
        right = np.array([-up[1], up[0]])
        haze = np.clip(distance / 900.0, 0, 0.4)
        dark, slim = rng.uniform(34, 52), rng.uniform(0.17, 0.34)
        sway_px = 0.018 * size_px * rng.uniform(0.5, 1.0)
        layers = (self.cover, self.light, self.sway_px)
        trunk = max(1, round(0.022 * size_px))
        for layer, value in zip(layers, (1.0, dark * (1 - haze) + 120 * haze, 0.2 * sway_px), strict=True):
            cv2.line(layer, _fixed(foot), _fixed(foot + 0.8 * up), value, trunk, cv2.LINE_8, _SHIFT)
        n = int(np.clip(2 * size_px, 30, 320))
        level = np.sort(rng.uniform(0.22, 1.0, n))
        widest = np.sin(np.pi * np.clip((level - 0.12) / 0.95, 0, 1)) ** 0.7
        aside = slim * widest * np.clip(rng.normal(0, 0.5, n), -1, 1)
        radius = size_px * rng.uniform(0.012, 0.055, n) * (60 / n) ** 0.15
        tone = dark + 26 * level + 16 * aside / slim + rng.normal(0, 7, n)
        tone = tone * (1 - haze) + 120 * haze
        for k in range(n):
            centre = _fixed(foot + level[k] * up + aside[k] * right)
            for layer, value in zip(layers, (1.0, tone[k], sway_px * level[k] ** 1.5), strict=True):
                cv2.circle(layer, centre, round(radius[k] * 2**_SHIFT), float(value), -1, cv2.LINE_8, _SHIFT)


def _spread(tile: Field, shape: tuple[int, int]) -> Field:
    """A periodic tile over a picture (h, w), as coarse in a large one as in a small one of 1600 columns."""
    step = max(1.0, shape[1] / 1600)
    tile = cv2.resize(tile, None, fx=step, fy=step)
    return np.tile(tile, [-(-shape[0] // len(tile)), -(-shape[1] // len(tile))])[: shape[0], : shape[1]]


def _fixed(point: FloatArray) -> tuple[int, int]:
    return round(float(point[0]) * 2**_SHIFT), round(float(point[1]) * 2**_SHIFT)


class _Sway:
    """Gusts that run through the trees and twigs that flutter on their own."""

    def __init__(self, amplitude_px: Field, rng: np.random.Generator) -> None:
        rows, columns = amplitude_px.shape
        coarse = (max(2, rows // _COARSE), max(2, columns // _COARSE))
        smooth = cv2.GaussianBlur(amplitude_px, (0, 0), 3)
        self._amplitude = cv2.resize(smooth, coarse[::-1], interpolation=cv2.INTER_AREA)
        self._size = (columns, rows)
        y, x = np.mgrid[:rows, :columns].astype(np.float32)
        self._x, self._y = x, y
        across = np.linspace(0, 2 * np.pi, coarse[1], dtype=np.float32)
        self._gust = (0.25 * rng.uniform(1, 3), 2 * across * rng.uniform(0.5, 1.5), rng.uniform(0, 2 * np.pi))
        self._twigs = [
            (2 * np.pi * rng.uniform(0.5, 2.2), rng.uniform(0, 2 * np.pi, coarse).astype(np.float32)) for _ in range(4)
        ]

    def move(self, layers: Field, time_s: float) -> Field:
        """The layers (h, w, c) as the wind has moved them."""
        speed, across, begin = self._gust
        gust = 0.6 + 0.4 * np.sin(across - 2 * np.pi * speed * time_s + begin)
        swing = [np.sin(rate * time_s + phase) for rate, phase in self._twigs]
        aside = self._amplitude * gust * (0.5 + swing[0] + 0.5 * swing[1])
        along = self._amplitude * gust * 0.4 * (swing[2] + 0.5 * swing[3])
        x = self._x + cv2.resize(aside, self._size)
        y = self._y + cv2.resize(along, self._size)
        return cv2.remap(layers, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
