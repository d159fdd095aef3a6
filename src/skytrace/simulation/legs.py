"""Flights made of straight legs, with hovers between them or turns rounded by a bounded acceleration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.geometry.arrays import FloatArray, frozen_array


@dataclass(frozen=True, slots=True)
class _Style:
    """How a kind of flight is flown."""

    min_leg: float  # length of the shortest leg, in horizontal half extents
    acceleration_m_s2: float  # peak while turning
    min_turn_rad: float  # smallest change of direction between legs
    hover_s: tuple[float, float] = (0.0, 0.0)
    alternate_height: bool = False


_STYLES = {
    "legs": _Style(min_leg=0.6, acceleration_m_s2=4.0, min_turn_rad=0.2),
    "turns": _Style(min_leg=0.35, acceleration_m_s2=25.0, min_turn_rad=1.2),
    "hover_legs": _Style(min_leg=0.5, acceleration_m_s2=4.0, min_turn_rad=0.0, hover_s=(3.0, 8.0)),
    "climbs": _Style(min_leg=0.3, acceleration_m_s2=15.0, min_turn_rad=0.5, alternate_height=True),
}


def _ramp(s: FloatArray) -> FloatArray:
    """Rise from 0 to 1 over [0, 1] with two vanishing derivatives at both ends."""
    return s**3 * (10 + s * (6 * s - 15))


def _ramp_integral(s: FloatArray) -> FloatArray:
    """Integral of the ramp from 0 to s; 1/2 at 1."""
    return s**4 * (2.5 + s * (s - 3))


_RAMP_PEAK_SLOPE = 1.875


@dataclass(frozen=True, eq=False, slots=True)
class LegsMotion:
    """Straight legs at constant velocity; around each corner the velocity passes smoothly from one leg to the next.

    The path is three times continuously differentiable and stays in the convex hull of its corners.
    """

    begin_s: float
    end_s: float
    corner_s: FloatArray  # (n + 1,) start of each leg and end of the last
    corner_m: FloatArray  # (n + 1, 3)
    blend_s: FloatArray  # (n + 1,) duration of the turn centred on each corner, not longer than the legs it joins

    def __post_init__(self) -> None:
        object.__setattr__(self, "corner_s", frozen_array(self.corner_s, (None,), "corner_s"))
        n = len(self.corner_s)
        if n < 2 or (np.diff(self.corner_s) <= 0).any():
            raise ValueError("corner_s: expected at least two strictly increasing times")
        object.__setattr__(self, "corner_m", frozen_array(self.corner_m, (n, 3), "corner_m"))
        object.__setattr__(self, "blend_s", frozen_array(self.blend_s, (n,), "blend_s"))

    def position(self, time_s: FloatArray) -> FloatArray:
        leg, velocity, before, after = self._locate(time_s)
        start = self.corner_m[leg] + velocity[leg] * (np.asarray(time_s, float) - self.corner_s[leg])[:, None]
        jump, blend = self._jumps(velocity), self.blend_s[:, None]
        turn_in = jump[leg] * blend[leg] * _ramp_integral(before)[:, None]
        return start + turn_in + jump[leg + 1] * blend[leg + 1] * _ramp_integral(after)[:, None]

    def velocity(self, time_s: FloatArray) -> FloatArray:
        leg, velocity, before, after = self._locate(time_s)
        jump = self._jumps(velocity)
        return velocity[leg] - jump[leg] * _ramp(before)[:, None] + jump[leg + 1] * _ramp(after)[:, None]

    def _locate(self, time_s: FloatArray) -> tuple[np.ndarray, FloatArray, FloatArray, FloatArray]:
        """Leg (n,) of each time, the legs' velocities (m, 3), and how deep each time lies in the turn at either end.

        The depth is 0 outside the turn and 1/2 at the corner; it counts from the turn's border inside the leg.
        """
        t = np.asarray(time_s, float)
        velocity = np.diff(self.corner_m, axis=0) / np.diff(self.corner_s)[:, None]
        leg = np.clip(np.searchsorted(self.corner_s, t, side="right") - 1, 0, len(velocity) - 1)
        blend = np.where(self.blend_s > 0, self.blend_s, 1.0)
        before = 0.5 - (t - self.corner_s[leg]) / blend[leg]
        after = 0.5 + (t - self.corner_s[leg + 1]) / blend[leg + 1]
        return leg, velocity, np.clip(before, 0, 1), np.clip(after, 0, 1)

    @staticmethod
    def _jumps(velocity: FloatArray) -> FloatArray:
        """Change of velocity (m + 1, 3) at each corner; none at the two ends."""
        return np.pad(np.diff(velocity, axis=0), ((1, 1), (0, 0)))


def fly_straight(
    begin_s: float, end_s: float, centre_m: FloatArray, half_m: FloatArray, speed_m_s: float, rng: np.random.Generator
) -> LegsMotion:
    """One level pass through the centre at constant velocity, slowed if it would leave the box."""
    heading = rng.uniform(0, 2 * np.pi)
    length = min(speed_m_s * (end_s - begin_s), 2 * half_m[0])
    step = 0.5 * length * np.array([np.cos(heading), np.sin(heading), 0.0])
    ends = np.stack([centre_m - step, centre_m + step])
    return LegsMotion(begin_s, end_s, np.array([begin_s, end_s]), ends, np.zeros(2))


def fly_legs(
    kind: str,
    begin_s: float,
    end_s: float,
    centre_m: FloatArray,
    half_m: FloatArray,
    speed_m_s: float,
    rng: np.random.Generator,
) -> LegsMotion:
    """Random legs of a kind ("legs", "turns", "hover_legs", "climbs") inside the box centre +- half (3,)."""
    style = _STYLES[kind]
    corners, times = [_draw_corner(style, centre_m, half_m, 0, rng)], [begin_s]
    heading = np.zeros(3)
    while times[-1] < end_s:
        corner, heading = _next_corner(style, corners[-1], heading, centre_m, half_m, len(corners), rng)
        duration = float(np.linalg.norm(corner - corners[-1])) / (speed_m_s * rng.uniform(0.8, 1.2))
        corners.append(corner)
        times.append(times[-1] + duration)
        if style.hover_s[1] > 0:
            corners.append(corner)
            times.append(times[-1] + rng.uniform(*style.hover_s))
    corner_s, corner_m = np.array(times), np.array(corners)
    return LegsMotion(begin_s, end_s, corner_s, corner_m, _blends(corner_s, corner_m, style.acceleration_m_s2))


def _draw_corner(
    style: _Style, centre_m: FloatArray, half_m: FloatArray, index: int, rng: np.random.Generator
) -> FloatArray:
    place = rng.uniform(-1, 1, 3)
    if style.alternate_height:
        place[2] = (-1) ** index * rng.uniform(0.6, 1.0)
    return centre_m + place * half_m


def _next_corner(
    style: _Style,
    corner: FloatArray,
    heading: FloatArray,
    centre_m: FloatArray,
    half_m: FloatArray,
    index: int,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """The next corner, far enough and after enough of a turn, and the unit direction (3,) towards it."""
    best, best_heading, best_shortfall = corner, heading, np.inf
    for _ in range(50):
        candidate = _draw_corner(style, centre_m, half_m, index, rng)
        step = candidate - corner
        length = max(float(np.linalg.norm(step)), 1e-9)
        turn = np.arccos(np.clip(step @ heading / length, -1, 1)) if heading.any() else np.pi
        shortfall = max(1 - length / (style.min_leg * half_m[0]), style.min_turn_rad - turn, 0.0)
        if shortfall < best_shortfall:
            best, best_heading, best_shortfall = candidate, step / length, shortfall
        if shortfall == 0:
            break
    return best, best_heading


def _blends(corner_s: FloatArray, corner_m: FloatArray, acceleration_m_s2: float) -> FloatArray:
    """Duration (n,) of the turn at each corner: from the acceleration, at most the shorter of the legs it joins."""
    leg_s = np.diff(corner_s)
    velocity = np.diff(corner_m, axis=0) / leg_s[:, None]
    wanted = _RAMP_PEAK_SLOPE * np.linalg.norm(np.diff(velocity, axis=0), axis=1) / acceleration_m_s2
    blend = np.zeros(len(corner_s))
    blend[1:-1] = np.minimum(wanted, np.minimum(leg_s[:-1], leg_s[1:]))
    return blend
