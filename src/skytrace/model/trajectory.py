"""The target's path: separate segments of uniform cubic B-splines, each claimed only where cameras support it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from skytrace.geometry.arrays import FloatArray, IntArray, frozen_array
from skytrace.geometry.rigid import Similarity
from skytrace.solvers import bspline


@dataclass(frozen=True, eq=False, slots=True)
class Segment:
    """A uniform cubic B-spline over [begin_s, end_s], the covered part of its knot span."""

    knot_start_s: float
    knot_spacing_s: float
    control_in_world: FloatArray  # (n >= 4, 3)
    begin_s: float
    end_s: float
    knot_sigma: FloatArray | None = None  # (n - 2,) posterior deviation of the position at each knot

    def __post_init__(self) -> None:
        object.__setattr__(self, "control_in_world", frozen_array(self.control_in_world, (None, 3), "control_in_world"))
        if len(self.control_in_world) < 4:
            raise ValueError(f"control_in_world: expected at least 4 points, got {len(self.control_in_world)}")
        if self.knot_sigma is not None:
            n = len(self.control_in_world) - 2
            object.__setattr__(self, "knot_sigma", frozen_array(self.knot_sigma, (n,), "knot_sigma"))
        if not self.knot_spacing_s > 0:
            raise ValueError(f"knot_spacing_s: expected a positive number, got {self.knot_spacing_s}")
        if self.end_s < self.begin_s:
            raise ValueError(f"segment ends ({self.end_s}) before it begins ({self.begin_s})")

    @property
    def n_intervals(self) -> int:
        return len(self.control_in_world) - 3

    def evaluate(self, time_s: FloatArray, derivative: int = 0) -> FloatArray:
        """Position (n, 3), or its derivative of an order up to 3, at times (n,) inside the knot span."""
        interval, u = bspline.locate(time_s, self.knot_start_s, self.knot_spacing_s, self.n_intervals)
        return bspline.evaluate(self.control_in_world, interval, u, self.knot_spacing_s, derivative)

    def sigma(self, time_s: FloatArray) -> FloatArray:
        """Posterior deviation (n,) of the position, interpolated between knots; NaN where none was computed."""
        if self.knot_sigma is None:
            return np.full(len(time_s), np.nan)
        knots = self.knot_start_s + self.knot_spacing_s * np.arange(len(self.knot_sigma))
        return np.interp(time_s, knots, self.knot_sigma)


@dataclass(frozen=True, eq=False, slots=True)
class Trajectory:
    """Segments in order of time; between them nothing is claimed."""

    segments: tuple[Segment, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "segments", tuple(self.segments))
        ends = [(s.begin_s, s.end_s) for s in self.segments]
        if any(after[0] < before[1] for before, after in pairwise(ends)):
            raise ValueError("segments: expected to follow each other without overlap")

    @property
    def covered_s(self) -> float:
        """Total covered time in seconds."""
        return float(sum(s.end_s - s.begin_s for s in self.segments))

    def segment_index(self, time_s: FloatArray) -> IntArray:
        """Index (n,) of the segment that covers each time, -1 where none does."""
        time_s = np.asarray(time_s, float)
        index = np.full(len(time_s), -1, np.int64)
        for k, segment in enumerate(self.segments):
            index[(time_s >= segment.begin_s) & (time_s <= segment.end_s)] = k
        return index

    def _evaluate(self, time_s: FloatArray, derivative: int) -> FloatArray:
        time_s = np.asarray(time_s, float)
        index = self.segment_index(time_s)
        out = np.full((len(time_s), 3), np.nan)
        for k, segment in enumerate(self.segments):
            inside = index == k
            out[inside] = segment.evaluate(time_s[inside], derivative)
        return out

    def position(self, time_s: FloatArray) -> FloatArray:
        """Position (n, 3) in the world at times (n,); NaN where not covered."""
        return self._evaluate(time_s, 0)

    def velocity(self, time_s: FloatArray) -> FloatArray:
        """Velocity (n, 3) per second; NaN where not covered."""
        return self._evaluate(time_s, 1)

    def acceleration(self, time_s: FloatArray) -> FloatArray:
        """Acceleration (n, 3) per second squared; NaN where not covered."""
        return self._evaluate(time_s, 2)

    def sigma(self, time_s: FloatArray) -> FloatArray:
        """Posterior deviation (n,) of the position (root of the summed variances of the three axes)."""
        time_s = np.asarray(time_s, float)
        index = self.segment_index(time_s)
        out = np.full(len(time_s), np.nan)
        for k, segment in enumerate(self.segments):
            inside = index == k
            out[inside] = segment.sigma(time_s[inside])
        return out

    def sample_times(self, rate_hz: float) -> FloatArray:
        """Times (n,) at multiples of 1 / rate_hz inside the covered segments, their ends included."""
        times = []
        for s in self.segments:
            # A millionth of a step inside the ends, so that no two samples coincide once they are written.
            first, last = np.ceil(s.begin_s * rate_hz + 1e-6), np.floor(s.end_s * rate_hz - 1e-6)
            times.append(np.concatenate([[s.begin_s], np.arange(first, last + 1) / rate_hz, [s.end_s]]))
        return np.concatenate(times) if times else np.zeros(0)

    def transformed(self, b_from_world: Similarity) -> Trajectory:
        """The same path in another frame and unit."""
        return Trajectory(
            tuple(
                Segment(
                    s.knot_start_s,
                    s.knot_spacing_s,
                    b_from_world.apply(s.control_in_world),
                    s.begin_s,
                    s.end_s,
                    None if s.knot_sigma is None else s.knot_sigma * b_from_world.scale,
                )
                for s in self.segments
            )
        )
