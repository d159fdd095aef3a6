"""Sky with drifting, changing clouds, as luma and chroma codes."""

from __future__ import annotations

import cv2
import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.model.camera import Intrinsics
from skytrace.simulation.render_noise import Field, fractal_tile

_TILE = 1024
_CLOUD_BASE_M = 1200.0
_TILE_M = 7000.0  # side of the tile of clouds
_DETAIL = 5.3  # the tile of details is this much smaller
# Clouds are not followed to the horizon, where one pixel holds many of them.
_LOWEST_RAD = np.radians(5.0)
_GRID_WIDTH = 640
BLUE_U, BLUE_V = 158.0, 101.0


class Grid:
    """A coarse raster over a picture, and where its points look."""

    def __init__(self, lens: Intrinsics, world_from_camera: FloatArray) -> None:
        width, height = self.size_px = lens.size_px
        self.step = max(1.0, width / _GRID_WIDTH)
        self.shape = (round(height / self.step), round(width / self.step))
        rows, columns = self.shape
        # cv2.resize keeps the borders of the picture, not the centres of its corner pixels.
        x = (np.arange(columns) + 0.5) * width / columns - 0.5
        y = (np.arange(rows) + 0.5) * height / rows - 0.5
        xy_px = np.stack(np.meshgrid(x, y), axis=2).reshape(-1, 2)
        xy_norm, good = lens.undistort(xy_px)
        # Corners that no ray through this lens reaches still show some sky.
        plain = (xy_px - lens.principal_px) / lens.focal_px
        xy_norm = np.where(good[:, None], xy_norm, plain)
        rays = np.column_stack([xy_norm, np.ones(len(xy_norm))]) @ world_from_camera.T
        self.elevation_rad = np.arctan2(rays[:, 2], np.hypot(rays[:, 0], rays[:, 1])).reshape(self.shape)
        self.azimuth_rad = np.arctan2(rays[:, 1], rays[:, 0]).reshape(self.shape)

    def enlarge(self, values: Field, size_px: tuple[int, int] | None = None) -> Field:
        return cv2.resize(values.astype(np.float32, copy=False), size_px or self.size_px)


class Sky:
    """The sky over a grid; `cloudiness` is the share of it under clouds."""

    def __init__(self, grid: Grid, cloudiness: float, rng: np.random.Generator) -> None:
        self._cloudiness = cloudiness
        height = np.clip(np.sin(np.maximum(grid.elevation_rad, 0.0)), 0, 1) ** 0.6
        sun_azimuth, sun_height = rng.uniform(-np.pi, np.pi), rng.uniform(0.4, 0.9)
        towards = np.cos(grid.elevation_rad) * np.cos(grid.azimuth_rad - sun_azimuth)
        sunward = towards * np.cos(sun_height) + np.sin(grid.elevation_rad) * np.sin(sun_height)
        glow = np.clip(0.5 + 0.5 * sunward, 0, 1)
        depth = rng.uniform(0.85, 1.1)
        self._clear = (178 - 78 * depth * height + 22 * glow**4).astype(np.float32)
        self._clear_u = (BLUE_U - 22 * (1 - height) - 8 * glow**4).astype(np.float32)
        self._clear_v = (BLUE_V + 18 * (1 - height) + 8 * glow**4).astype(np.float32)
        if cloudiness == 0:
            return
        self._rng_tiles(rng)
        distance = _CLOUD_BASE_M / np.tan(np.sqrt(np.maximum(grid.elevation_rad, 0.0) ** 2 + _LOWEST_RAD**2))
        px = distance * _TILE / _TILE_M
        self._place = np.stack([px * np.cos(grid.azimuth_rad), px * np.sin(grid.azimuth_rad)], 2).astype(np.float32)
        risen = np.clip((grid.elevation_rad - 0.01) / 0.08, 0, 1)
        self._haze = (risen * (0.75 * np.exp(-distance / 9000.0) + 0.25)).astype(np.float32)
        wind = rng.uniform(4.0, 14.0) * _TILE / _TILE_M
        heading = rng.uniform(-np.pi, np.pi)
        self._wind = wind * np.array([np.cos(heading), np.sin(heading)])
        turn = heading + rng.uniform(-0.6, 0.6)
        self._detail_wind = 1.2 * wind * np.array([np.cos(turn), np.sin(turn)])

    def _rng_tiles(self, rng: np.random.Generator) -> None:
        shape = fractal_tile(_TILE, 1.75, rng)
        # What faces the sun is bright: the slope of the clouds' thickness along one direction.
        lit = cv2.GaussianBlur(shape - np.roll(shape, (6, 9), (0, 1)), (0, 0), 1.0)
        self._shape = np.dstack([shape, lit / lit.std()])
        self._detail = fractal_tile(_TILE, 1.45, rng)
        mixed = shape + 0.32 * self._detail
        self._threshold = float(np.quantile(mixed, 1 - self._cloudiness))
        self._softness = float(rng.uniform(0.5, 1.1))
        self._brightness = float(rng.uniform(195, 215))
        self._contrast = float(rng.uniform(0.6, 1.1))

    def at(self, time_s: float) -> tuple[Field, Field, Field]:
        """Luma and both chroma codes over the grid."""
        if self._cloudiness == 0:
            return self._clear, self._clear_u, self._clear_v
        place = self._place - (self._wind * time_s).astype(np.float32)
        shape, lit = cv2.split(_look_up(self._shape, place))
        shift = (self._detail_wind * time_s - self._wind * time_s).astype(np.float32)
        detail = _look_up(self._detail, (place - shift) * np.float32(_DETAIL))
        thickness = (shape + 0.32 * detail - self._threshold) / self._softness
        cover = np.clip(thickness, 0, 1)
        cover *= cover * (3 - 2 * cover)
        cover *= self._haze
        # Thick clouds are grey below; their rims and sunward sides shine.
        shade = self._brightness - self._contrast * (14 * np.clip(thickness - 0.8, 0, 3) - 9 * lit - 4 * detail)
        luma = self._clear + cover * (shade - self._clear)
        grey = 0.9 * cover
        return luma, self._clear_u + grey * (129 - self._clear_u), self._clear_v + grey * (127 - self._clear_v)


def _look_up(tile: Field, place: Field) -> Field:
    """Values of a periodic tile at places (h, w, 2)."""
    # cv2.remap counts in 16 bits.
    wrapped = place - np.floor(place * np.float32(1 / _TILE)) * np.float32(_TILE)
    return cv2.remap(tile, wrapped[..., 0], wrapped[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
