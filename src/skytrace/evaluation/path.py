"""A reconstructed path given by samples, as a run stores it, made continuous again inside its segments."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.geometry.arrays import BoolArray, FloatArray, IntArray, frozen_array
from skytrace.model.trajectory import Trajectory


@dataclass(frozen=True, eq=False, slots=True)
class SampledPath:
    """Samples of a path in order of time; between two samples of one segment it is their cubic Hermite curve.

    Raises ValueError when shapes disagree or times do not increase inside a segment.
    """

    time_s: FloatArray  # (n >= 2,)
    position: FloatArray  # (n, 3) in the world of the reconstruction
    velocity: FloatArray  # (n, 3) per second
    segment: IntArray  # (n,) equal inside a segment, different in neighbouring ones
    n_cameras: IntArray | None = None  # (n,) cameras that saw the target
    sigma: FloatArray | None = None  # (n,) posterior deviation of the position in world units, NaN where unknown

    def __post_init__(self) -> None:
        object.__setattr__(self, "time_s", frozen_array(self.time_s, (None,), "time_s"))
        n = len(self.time_s)
        if n < 2:
            raise ValueError(f"time_s: expected at least 2 samples, got {n}")
        object.__setattr__(self, "position", frozen_array(self.position, (n, 3), "position"))
        object.__setattr__(self, "velocity", frozen_array(self.velocity, (n, 3), "velocity"))
        object.__setattr__(self, "segment", frozen_array(self.segment, (n,), "segment", np.int64))
        if self.n_cameras is not None:
            object.__setattr__(self, "n_cameras", frozen_array(self.n_cameras, (n,), "n_cameras", np.int64))
        if self.sigma is not None:
            object.__setattr__(self, "sigma", frozen_array(self.sigma, (n,), "sigma", finite=False))
        step_s = np.diff(self.time_s)
        wrong = np.flatnonzero((step_s < 0) | (step_s <= 0) & self._joined)
        if len(wrong):
            raise ValueError(
                f"time_s: expected increasing times, sample {wrong[0] + 1} does not follow its predecessor"
            )

    @classmethod
    def from_trajectory(cls, trajectory: Trajectory, rate_hz: float = 50.0) -> SampledPath:
        """Samples of a spline trajectory at `rate_hz`, the ends of its segments included."""
        times, segments = [], []
        for k, segment in enumerate(trajectory.segments):
            times.append(Trajectory((segment,)).sample_times(rate_hz))
            segments.append(np.full(len(times[-1]), k))
        # Evaluated by segment: where one ends the instant the next begins, the time alone names no segment.
        parts = list(zip(trajectory.segments, times, strict=True))
        return cls(
            np.concatenate([np.zeros(0), *times]),
            np.concatenate([np.zeros((0, 3)), *(s.evaluate(t) for s, t in parts)]),
            np.concatenate([np.zeros((0, 3)), *(s.evaluate(t, 1) for s, t in parts)]),
            np.concatenate([np.zeros(0, np.int64), *segments]),
            sigma=np.concatenate([np.zeros(0), *(s.sigma(t) for s, t in parts)]),
        )

    @property
    def _joined(self) -> BoolArray:
        """Which samples (n - 1,) and their successors belong to one segment."""
        return self.segment[:-1] == self.segment[1:]

    @property
    def covered_s(self) -> float:
        """Seconds that lie inside segments."""
        return float(np.diff(self.time_s)[self._joined].sum())

    def even_times(self, rate_hz: float) -> FloatArray:
        """Times (m,) every 1 / rate_hz seconds, those that lie inside segments; the first sample's where none does."""
        n = int((self.time_s[-1] - self.time_s[0]) * rate_hz) + 1
        times = self.time_s[0] + np.arange(n) / rate_hz
        inside = self.locate(times)[1]
        return times[inside] if inside.any() else self.time_s[:1].copy()

    def locate(self, time_s: FloatArray) -> tuple[IntArray, BoolArray]:
        """The sample (m,) at or before each time, its successor being the other end; and which times are covered."""
        time_s = np.asarray(time_s, float)
        index = np.searchsorted(self.time_s, time_s, side="right") - 1
        index = np.clip(index, 0, len(self.time_s) - 2)
        # The last instant of a segment belongs to the interval before it.
        at_end = (time_s == self.time_s[index]) & ~self._joined[index] & (index > 0)
        index = np.where(at_end, index - 1, index)
        inside = self._joined[index] & (time_s >= self.time_s[index]) & (time_s <= self.time_s[index + 1])
        return index, inside

    def evaluate(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Position and velocity (m, 3) at times (m,); NaN outside the segments."""
        time_s = np.asarray(time_s, float)
        index, inside = self.locate(time_s)
        position, velocity = np.full((len(time_s), 3), np.nan), np.full((len(time_s), 3), np.nan)
        i = index[inside]
        h = (self.time_s[i + 1] - self.time_s[i])[:, None]
        u = (time_s[inside] - self.time_s[i])[:, None] / h
        p0, m0, m1 = self.position[i], h * self.velocity[i], h * self.velocity[i + 1]
        rise = self.position[i + 1] - p0
        quadratic, cubic = 3 * rise - 2 * m0 - m1, m0 + m1 - 2 * rise
        position[inside] = p0 + u * (m0 + u * (quadratic + u * cubic))
        velocity[inside] = (m0 + u * (2 * quadratic + 3 * u * cubic)) / h
        return position, velocity

    def n_cameras_at(self, time_s: FloatArray) -> IntArray | None:
        """Number of cameras (m,) at the sample nearest to each covered time."""
        if self.n_cameras is None:
            return None
        index, _ = self.locate(time_s)
        later = 2 * np.asarray(time_s) > self.time_s[index] + self.time_s[index + 1]
        return self.n_cameras[index + later]

    def sigma_at(self, time_s: FloatArray) -> FloatArray | None:
        """Posterior deviation (m,) at covered times, linear between samples."""
        if self.sigma is None:
            return None
        index, _ = self.locate(time_s)
        u = (np.asarray(time_s) - self.time_s[index]) / (self.time_s[index + 1] - self.time_s[index])
        return (1 - u) * self.sigma[index] + u * self.sigma[index + 1]

    def without_far_samples(self, factor: float = 5.0) -> SampledPath:
        """The path without samples farther from its median point than `factor` x the 90 % radius.

        A handful of points thrown to the horizon would otherwise be all that a least-squares search looks at. The
        segments are broken where samples are taken out.
        """
        radius = np.linalg.norm(self.position - np.median(self.position, axis=0), axis=1)
        keep = radius <= factor * np.quantile(radius, 0.9)
        if keep.all() or keep.sum() < 2:
            return self
        broken = ~self._joined | ~keep[:-1] | ~keep[1:]
        return SampledPath(
            self.time_s[keep],
            self.position[keep],
            self.velocity[keep],
            np.concatenate([[0], np.cumsum(broken)])[keep],
            None if self.n_cameras is None else self.n_cameras[keep],
            None if self.sigma is None else self.sigma[keep],
        )
