"""Films of a simulated flight: what each camera recorded, with the true place of the target in every frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.io.video_writer import TICKS_PER_S, VideoWriter
from skytrace.simulation.cameras import TrueCamera
from skytrace.simulation.filming import ticks
from skytrace.simulation.flight import Motion
from skytrace.simulation.render_distractors import Distractor, draw_distractors
from skytrace.simulation.render_noise import Field, sensor_noise
from skytrace.simulation.render_object import Ellipses, Patch, draw
from skytrace.simulation.render_scenery import Scenery
from skytrace.simulation.render_sky import Grid, Sky
from skytrace.simulation.render_target import TargetInFilm, place_target, target_looks
from skytrace.simulation.simulator import SimulatedFlight, TrueExposures

Planes = tuple[Field, Field, Field]

_BLACK = 16
_NOISE_MARGIN = 64  # the noise of a frame is cut out of a larger piece at a random place


@dataclass(frozen=True, slots=True, kw_only=True)
class Film:
    """How a flight is filmed. The defaults are what a small drone looks like in consumer video on a fair day."""

    target_m: float = 0.6  # width of the target
    target_luma: float = 50.0  # luma code of its shell; most drones are dark against the sky
    clouds: bool = True
    scenery: bool = True  # fields, hills, trees in the wind
    distractors: bool = False  # birds, insects, blinking lamps
    noise: float = 1.8  # deviation of the sensor's noise in luma codes
    exposure_drift: float = 0.05  # how far the automatic exposure wanders
    quality: int = 21  # x264's constant rate factor

    def __post_init__(self) -> None:
        for name, (low, high) in _RANGES.items():
            if not low <= getattr(self, name) <= high:
                raise ValueError(f"{name}: expected a value from {low:g} to {high:g}, got {getattr(self, name)}")


_RANGES = {
    "target_m": (0.01, 100.0),
    "target_luma": (16.0, 235.0),
    "noise": (0.0, 30.0),
    "exposure_drift": (0.0, 0.5),
    "quality": (0, 51),
}


def render_videos(
    simulated: SimulatedFlight,
    film: Film,
    folder: Path,
    rng: np.random.Generator,
    on_frame: Callable[[str, int, int], None] = lambda camera_id, done, total: None,
) -> None:
    """Write `video/ID.mp4` of every camera and `truth/frames/ID.csv` into a folder.

    The flight must be counted from its first filmed frames, as `as_filmed` does. `on_frame` learns the camera, its
    frames done and all its frames. The truth has a row a frame: its index, its time stamp in the file, the target's
    centre and width in pixels where it is to be seen, whether its centre is in the picture, and its mean difference in
    luma codes from what is behind it. The centre is that in the middle of the exposure of the row it lies on.
    """
    for part in ("video", "truth/frames"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    truth = simulated.truth
    for recording, camera_rng in zip(simulated.recordings, rng.spawn(len(simulated.recordings)), strict=True):
        camera_id = recording.camera_id
        camera, exposures = truth.cameras[camera_id], truth.exposures[camera_id]
        shot = Shot(camera, exposures, truth.motion, film, camera_rng)
        stamps = ticks(exposures, camera.frame_rate_hz, TICKS_PER_S)
        video = folder / "video" / f"{camera_id}.mp4"
        with VideoWriter(video, camera.intrinsics.size_px, camera.frame_rate_hz, film.quality) as writer:
            for k, stamp in enumerate(stamps):
                writer.write(int(stamp), *shot.frame(k))
                on_frame(camera_id, k + 1, len(stamps))
        table = folder / "truth" / "frames" / f"{camera_id}.csv"
        write_frame_truth(table, stamps / TICKS_PER_S, shot.target, shot.contrast)


def write_frame_truth(path: Path, time_s: FloatArray, target: TargetInFilm, contrast: FloatArray) -> None:
    """The truth of every frame of a film."""
    rows = np.column_stack([np.arange(len(time_s)), time_s, target.xy_px, target.size_px, target.inside, contrast])
    header = "frame,time_s,x_px,y_px,size_px,visible,contrast"
    np.savetxt(path, rows, fmt="%d,%.9f,%.4f,%.4f,%.3f,%d,%.1f", header=header, comments="")


class Shot:
    """One camera's pictures of the flight, to be asked for in order."""

    def __init__(
        self,
        camera: TrueCamera,
        exposures: TrueExposures,
        motion: Motion,
        film: Film,
        rng: np.random.Generator,
    ) -> None:
        sky_rng, scenery_rng, distractor_rng, noise_rng, look_rng = rng.spawn(5)
        self._camera, self._beat, self._motion, self._film = camera, exposures.beat, motion, film
        self.target = place_target(camera, exposures, motion, film.target_m)
        self.contrast = np.full(len(exposures.beat), np.nan)  # of the target in the frames drawn so far
        self._looks = target_looks(self.target, motion, film.target_m, film.target_luma)
        lens, pose = camera.intrinsics, camera.camera_from_world
        width, height = lens.size_px
        self._grid = Grid(lens, pose.rotation.T)
        self._sky = Sky(self._grid, look_rng.uniform(0.05, 0.95) if film.clouds else 0.0, sky_rng)
        self._scenery = Scenery(lens, pose, self._grid, scenery_rng) if film.scenery else None
        self._exposure_s = 1 / look_rng.uniform(250.0, 1500.0)
        self._gain = _Gain(film.exposure_drift, look_rng)
        self._noise_rng = noise_rng
        self._noise = sensor_noise((height + _NOISE_MARGIN, width + _NOISE_MARGIN), noise_rng) if film.noise else None
        begin_s, end_s = camera.clock.world_time(exposures.beat[[0, -1]], np.zeros(2))
        self._distractors: tuple[Distractor, ...] = ()
        if film.distractors:
            self._distractors = draw_distractors(lens.size_px, begin_s, end_s, distractor_rng)

    def frame(self, k: int) -> Planes:
        """Luma (h, w) and chroma (h/2, w/2) of frame k as encoded."""
        luma, blue, red = self.scene(k)
        return self._expose(luma, k), cv2.convertScaleAbs(blue), cv2.convertScaleAbs(red)

    def scene(self, k: int) -> Planes:
        """Luma and chroma of frame k before exposure, noise and rounding."""
        planes = self._background(k)
        for ellipses, path_px, centre_px in self._things(k):
            patch = draw(planes[0], ellipses, path_px, partial(self._row_time_s, k), self._exposure_s, centre_px)
            if patch is not None:
                _take_colour(planes[1], planes[2], patch)
                if ellipses is self._looks[k]:
                    self.contrast[k] = patch.contrast
        return planes

    def _row_time_s(self, k: int, row_px: FloatArray) -> FloatArray:
        return self._camera.clock.world_time(self._beat[k], row_px)

    def _background(self, k: int) -> Planes:
        width, height = self._camera.intrinsics.size_px
        time_s = float(self._row_time_s(k, np.array(0.5 * height)))
        sky, sky_u, sky_v = self._sky.at(time_s)
        luma = self._grid.enlarge(sky)
        blue, red = (self._grid.enlarge(c, (width // 2, height // 2)) for c in (sky_u, sky_v))
        if self._scenery is not None:
            self._scenery.draw(luma, blue, red, time_s)
        return luma, blue, red

    def _things(self, k: int) -> list[tuple[Ellipses, Callable[[FloatArray], FloatArray], FloatArray]]:
        """What to draw into frame k, from behind to before: looks, path in the image, place."""
        things = []
        middle_s = self._row_time_s(k, np.array([0.5 * self._camera.intrinsics.height_px]))
        for distractor in self._distractors:
            if distractor.begin_s <= middle_s[0] <= distractor.end_s:
                centre_px = distractor.path_px(middle_s)[0]
                things.append((distractor.look(float(middle_s[0])), distractor.path_px, centre_px))
        look = self._looks[k]
        if look is not None:
            things.append((look, self._target_path_px, self.target.xy_px[k]))
        return things

    def _target_path_px(self, time_s: FloatArray) -> FloatArray:
        return self._camera.intrinsics.project(self._camera.camera_from_world.apply(self._motion.position(time_s)))

    def _expose(self, luma: Field, k: int) -> Field:
        gain = self._gain.at(float(self._row_time_s(k, np.array(0.0))))
        black = _BLACK * (1 - gain)
        if self._noise is None:
            return cv2.convertScaleAbs(luma, alpha=gain, beta=black)
        x, y = self._noise_rng.integers(0, _NOISE_MARGIN, 2)
        strength = self._film.noise * self._noise_rng.choice([-1.0, 1.0])
        noise = self._noise[y : y + luma.shape[0], x : x + luma.shape[1]]
        return cv2.addWeighted(luma, gain, noise, strength, black, dtype=cv2.CV_8U)


class _Gain:
    """An automatic exposure that wanders with the light and takes a small step now and then."""

    def __init__(self, drift: float, rng: np.random.Generator) -> None:
        self._amplitude = drift * np.array([0.5, 0.3, 0.2])
        self._rate = 2 * np.pi / rng.uniform([30.0, 8.0, 3.0], [90.0, 20.0, 6.0])
        self._phase = rng.uniform(0, 2 * np.pi, 3)
        self._step, self._pace_s = 0.4 * drift, rng.uniform(10.0, 25.0)

    def at(self, time_s: float) -> float:
        stepped = np.tanh(8 * np.sin(2 * np.pi * time_s / self._pace_s))
        wander = (self._amplitude * np.sin(self._rate * time_s + self._phase)).sum()
        return float(1 + wander + 0.5 * self._step * stepped)


def _take_colour(blue: Field, red: Field, patch: Patch) -> None:
    """Make both chroma planes grey where something grey covers the picture."""
    top, left = patch.top // 2, patch.left // 2
    above, before = patch.top % 2, patch.left % 2
    rows, columns = patch.cover.shape
    cover = np.pad(patch.cover, ((above, (rows + above) % 2), (before, (columns + before) % 2)))
    cover = 0.25 * (cover[::2, ::2] + cover[1::2, ::2] + cover[::2, 1::2] + cover[1::2, 1::2])
    for plane in (blue, red):
        window = plane[top : top + cover.shape[0], left : left + cover.shape[1]]
        window += cover[: window.shape[0], : window.shape[1]] * (128 - window)
