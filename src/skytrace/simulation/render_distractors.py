"""Birds, insects and lamps: things that move or change and are not the target."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.simulation.render_bodies import bird, disc
from skytrace.simulation.render_object import Ellipses

_BIRDS_PER_S, _INSECTS_PER_S, _LAMPS = 0.06, 0.15, 2


@dataclass(frozen=True, slots=True)
class Distractor:
    """Something seen from begin_s to end_s, on a path in the image."""

    begin_s: float
    end_s: float
    path_px: Callable[[FloatArray], FloatArray]  # (n, 2) at times (n,)
    look: Callable[[float], Ellipses]


def draw_distractors(
    size_px: tuple[int, int], begin_s: float, end_s: float, rng: np.random.Generator
) -> tuple[Distractor, ...]:
    """The distractors of one camera between two times."""
    length_s = end_s - begin_s
    kinds = (
        (_bird, int(rng.poisson(_BIRDS_PER_S * length_s)) + 1),
        (_insect, int(rng.poisson(_INSECTS_PER_S * length_s)) + 1),
        (_lamp, _LAMPS),
    )
    return tuple(make(size_px, begin_s, end_s, rng) for make, n in kinds for _ in range(n))


def _crossing(
    size_px: tuple[int, int], middle_s: float, speed_px_s: float, bend: float, rng: np.random.Generator
) -> Callable[[FloatArray], FloatArray]:
    """A path through the upper part of the image that winds to both sides."""
    width, height = size_px
    place = np.array([rng.uniform(0.1, 0.9) * width, rng.uniform(0.05, 0.7) * height])
    heading = rng.choice([0.0, np.pi]) + rng.normal(0, 0.35)
    along = np.array([np.cos(heading), np.sin(heading)])
    aside = np.array([-along[1], along[0]])
    rate, phase = rng.uniform(0.5, 1.5), rng.uniform(0, 2 * np.pi)

    def path_px(time_s: FloatArray) -> FloatArray:
        t = np.asarray(time_s, float)[:, None] - middle_s
        return place + speed_px_s * (t * along + bend * (np.sin(rate * t + phase) - np.sin(phase)) * aside)

    return path_px


def _bird(size_px: tuple[int, int], begin_s: float, end_s: float, rng: np.random.Generator) -> Distractor:
    middle_s = rng.uniform(begin_s, end_s)
    wide = size_px[0] * rng.uniform(0.004, 0.014)
    speed = wide * rng.uniform(4.0, 12.0)  # some dozen wing spans a second
    path_px = _crossing(size_px, middle_s, speed, 0.4, rng)
    bank, tone = rng.normal(0, 0.3), float(rng.uniform(35, 70))
    beat_hz, glide_s, phase = rng.uniform(2.5, 6.0), rng.uniform(2.0, 6.0), rng.uniform(0, 2 * np.pi)
    frame = wide * np.array([[np.cos(bank), -np.sin(bank), 0.0], [np.sin(bank), np.cos(bank), 0.0]])

    def look(time_s: float) -> Ellipses:
        gliding = np.sin(2 * np.pi * time_s / glide_s + phase) > 0.3
        flap = 0.15 if gliding else 0.9 * np.sin(2 * np.pi * beat_hz * time_s + phase)
        return bird(float(flap), tone).seen(frame)

    half_s = (0.6 * size_px[0] + wide) / speed
    return Distractor(middle_s - half_s, middle_s + half_s, path_px, look)


def _insect(size_px: tuple[int, int], begin_s: float, end_s: float, rng: np.random.Generator) -> Distractor:
    middle_s = rng.uniform(begin_s, end_s)
    path_px = _crossing(size_px, middle_s, size_px[0] * rng.uniform(0.3, 1.5), 0.2, rng)
    wide = size_px[0] * rng.uniform(0.003, 0.01)
    fly = disc(rng.uniform(0.15, 0.5), float(rng.uniform(50, 110)))
    ellipses = fly.seen(np.array([[wide, 0.0, 0.0], [0.0, wide, 0.0]]))
    half_s = rng.uniform(0.15, 0.6)
    return Distractor(middle_s - half_s, middle_s + half_s, path_px, lambda _: ellipses)


def _lamp(size_px: tuple[int, int], begin_s: float, end_s: float, rng: np.random.Generator) -> Distractor:
    """A lamp, or a pane that catches the sun: it blinks where it stands."""
    place = np.array([rng.uniform(0.05, 0.95) * size_px[0], rng.uniform(0.6, 0.95) * size_px[1]])
    wide = max(1.2, 0.002 * size_px[0] * rng.uniform(0.5, 1.5))
    pace_s, lit_s, phase_s = rng.uniform(0.7, 2.0), rng.uniform(0.05, 0.4), rng.uniform(0, 2.0)
    frame = np.array([[wide, 0.0, 0.0], [0.0, wide, 0.0]])
    lit, dark = disc(1.0, 232.0).seen(frame), disc(0.6, 120.0).seen(frame)

    def look(time_s: float) -> Ellipses:
        return lit if (time_s + phase_s) % pace_s < lit_s else dark

    return Distractor(begin_s, end_s, lambda time_s: np.tile(place, (len(time_s), 1)), look)
