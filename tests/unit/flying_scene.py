"""Pictures of something dark that flies before a sky, drawn exactly where it is said to be."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from skytrace.vision.follow import Follower
from skytrace.vision.found import FoundTrack


@dataclass(frozen=True)
class Disc:
    """A disc whose centre in frame k is path[k]; NaN where it is not to be seen."""

    path: np.ndarray  # (n, 2)
    diameter_px: float = 6.0
    luma: float = 60.0


@dataclass(frozen=True)
class Scene:
    """Frames of `size_px`: a sky that gets brighter downwards, discs, then a gain and noise."""

    discs: Sequence[Disc]
    size_px: tuple[int, int] = (320, 240)
    noise: float = 1.5
    background: np.ndarray | None = None  # (n or 1, h, w) instead of the sky
    gain: np.ndarray | None = None  # (n,)
    seed: int = 0
    n: int = field(default=0)

    def pictures(self) -> Iterator[np.ndarray]:
        """Luma (h, w) uint8, frame after frame."""
        rng = np.random.default_rng(self.seed)
        width, height = self.size_px
        sky = np.repeat(np.linspace(150, 180, height)[:, None], width, axis=1)
        for k in range(self.n or len(self.discs[0].path)):
            luma = sky.copy() if self.background is None else self.background[k % len(self.background)].astype(float)
            for disc in self.discs:
                draw(luma, disc.path[k], disc.diameter_px, disc.luma)
            if self.gain is not None:
                luma = 16 + (luma - 16) * self.gain[k]
            yield np.clip(np.rint(luma + rng.normal(0, self.noise, luma.shape)), 0, 255).astype(np.uint8)


def draw(luma: np.ndarray, centre: np.ndarray, diameter_px: float, value: float) -> None:
    """A disc, its rim as dark as the share of each pixel it covers."""
    if not np.isfinite(centre).all():
        return
    reach = int(diameter_px) + 3
    x0, y0 = np.rint(centre).astype(int) - reach
    x1, y1 = x0 + 2 * reach + 1, y0 + 2 * reach + 1
    x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, luma.shape[1]), min(y1, luma.shape[0])
    if x0 >= x1 or y0 >= y1:
        return
    y, x = np.mgrid[y0:y1, x0:x1]
    cover = np.clip(0.5 * diameter_px + 0.5 - np.hypot(x - centre[0], y - centre[1]), 0, 1)
    luma[y0:y1, x0:x1] += cover * (value - luma[y0:y1, x0:x1])


def line(begin: tuple[float, float], step: tuple[float, float], n: int) -> np.ndarray:
    """A straight path (n, 2)."""
    return np.array(begin) + np.arange(n)[:, None] * np.array(step)


def follow(scene: Scene, rate_hz: float = 30.0, **options) -> tuple[FoundTrack, ...]:
    """The tracks found in a scene."""
    follower = Follower(scene.size_px, rate_hz, **options)
    for k, luma in enumerate(scene.pictures()):
        follower.step(k, luma)
    return follower.finish()


def on_path(track: FoundTrack, path: np.ndarray, within_px: float = 3.0) -> np.ndarray:
    """For each detection of a track whether it is where the path is."""
    return np.hypot(*(track.xy_px - path[track.frame]).T) < within_px


def recall(tracks: Sequence[FoundTrack], path: np.ndarray) -> float:
    """Share of the frames with something on the path in which a track found it."""
    found = {int(f) for t in tracks for f in t.frame[on_path(t, path)]}
    return len(found) / int(np.isfinite(path[:, 0]).sum())
