"""How the target flies: motions as exact functions of world time, and their random construction for a scenario."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from skytrace.geometry.arrays import FloatArray, frozen_array
from skytrace.model.trajectory import Segment
from skytrace.simulation.legs import LegsMotion, fly_legs, fly_straight
from skytrace.simulation.scenario import Scenario

_N_HARMONICS = 6
# Sinusoids seldom peak together: with this sum of amplitudes, in half extents, a flight just fills its box.
_FILL = 1.5


class Motion(Protocol):
    """The target's path in metres over world time; claimed on [begin_s, end_s], smoothly continued beyond."""

    @property
    def begin_s(self) -> float: ...

    @property
    def end_s(self) -> float: ...

    def position(self, time_s: FloatArray) -> FloatArray:
        """Position (n, 3) in metres in the world at times (n,)."""
        ...

    def velocity(self, time_s: FloatArray) -> FloatArray:
        """Velocity (n, 3) in metres per second: the exact derivative of `position`."""
        ...


@dataclass(frozen=True, eq=False, slots=True)
class HarmonicMotion:
    """A sum of sinusoids along each axis around a centre: smooth to every order."""

    begin_s: float
    end_s: float
    centre_m: FloatArray  # (3,)
    amplitude_m: FloatArray  # (k, 3)
    rate_rad_s: FloatArray  # (k, 3)
    phase_rad: FloatArray  # (k, 3) at begin_s

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre_m", frozen_array(self.centre_m, (3,), "centre_m"))
        object.__setattr__(self, "amplitude_m", frozen_array(self.amplitude_m, (None, 3), "amplitude_m"))
        for name in ("rate_rad_s", "phase_rad"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), (len(self.amplitude_m), 3), name))

    def position(self, time_s: FloatArray) -> FloatArray:
        elapsed = (np.asarray(time_s, float) - self.begin_s)[:, None]
        out = np.tile(self.centre_m, (len(elapsed), 1))
        for amplitude, rate, phase in zip(self.amplitude_m, self.rate_rad_s, self.phase_rad, strict=True):
            out += amplitude * np.sin(rate * elapsed + phase)
        return out

    def velocity(self, time_s: FloatArray) -> FloatArray:
        elapsed = (np.asarray(time_s, float) - self.begin_s)[:, None]
        out = np.zeros((len(elapsed), 3))
        for amplitude, rate, phase in zip(self.amplitude_m, self.rate_rad_s, self.phase_rad, strict=True):
            out += amplitude * rate * np.cos(rate * elapsed + phase)
        return out


@dataclass(frozen=True, eq=False, slots=True)
class SplineMotion:
    """A flight that lies exactly in the space of uniform cubic splines."""

    segment: Segment

    @property
    def begin_s(self) -> float:
        return self.segment.begin_s

    @property
    def end_s(self) -> float:
        return self.segment.end_s

    def position(self, time_s: FloatArray) -> FloatArray:
        return self.segment.evaluate(time_s)

    def velocity(self, time_s: FloatArray) -> FloatArray:
        return self.segment.evaluate(time_s, derivative=1)


def harmonic_motion(
    begin_s: float,
    end_s: float,
    centre_m: FloatArray,
    half_extent_m: FloatArray,
    speed_m_s: float,
    rng: np.random.Generator,
) -> HarmonicMotion:
    """A random smooth flight about the box centre +- half_extent (3,), of the given root mean square speed.

    The harmonics share the velocity equally, as real flights do: large slow sweeps and small quick turns.
    """
    ratio = 3.0 ** rng.uniform(-1, 1, (_N_HARMONICS, 3))
    phase = rng.uniform(0, 2 * np.pi, (_N_HARMONICS, 3))
    reach = _FILL * np.asarray(half_extent_m, float) / (1 / ratio).sum(0)
    energy = 0.5 * _N_HARMONICS * float(reach @ reach)
    base = speed_m_s / np.sqrt(energy) if energy > 0 else 1.0
    return HarmonicMotion(begin_s, end_s, centre_m, reach / ratio, base * ratio, phase)


def spline_motion(guide: Motion, spacing_s: float) -> SplineMotion:
    """The cubic spline with knots at integer multiples of the spacing whose control points lie on the guide."""
    first = int(np.floor(guide.begin_s / spacing_s))
    first -= first * spacing_s > guide.begin_s  # products round, too
    last = max(int(np.ceil(guide.end_s / spacing_s)), first + 1)
    last += first * spacing_s + (last - first) * spacing_s < guide.end_s
    control = guide.position(spacing_s * np.arange(first - 1.0, last + 2.0))
    return SplineMotion(Segment(first * spacing_s, spacing_s, control, guide.begin_s, guide.end_s))


def build_motion(
    scenario: Scenario, begin_s: float, rng: np.random.Generator
) -> HarmonicMotion | SplineMotion | LegsMotion:
    """The scenario's flight over [begin_s, begin_s + duration_s] of world time."""
    end_s = begin_s + scenario.duration_s
    centre = np.array([0.0, 0.0, scenario.altitude_m])
    half = np.array([0.5 * scenario.extent_m, 0.5 * scenario.extent_m, scenario.half_height_m])
    if scenario.motion in ("smooth", "spline"):
        smooth = harmonic_motion(begin_s, end_s, centre, half, scenario.speed_m_s, rng)
        return smooth if scenario.motion == "smooth" else spline_motion(smooth, scenario.knot_spacing_s)
    if scenario.motion == "hover":
        place = centre + rng.uniform(-0.5, 0.5, 3) * half
        sway = np.full(3, scenario.sway_m)
        return harmonic_motion(begin_s, end_s, place, sway, scenario.sway_m, rng)
    if scenario.motion == "straight":
        return fly_straight(begin_s, end_s, centre, half, scenario.speed_m_s, rng)
    return fly_legs(scenario.motion, begin_s, end_s, centre, half, scenario.speed_m_s, rng)
