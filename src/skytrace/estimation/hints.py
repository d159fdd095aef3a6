"""What users know of the clocks beforehand: offsets, moments seen by several cameras, wall-clock starts.

A hint is a prior over the offset of two cameras. It says where to search and decides between offsets that the tracks
leave open; its say is bounded, so that a wrong one cannot overrule tracks that are sure of themselves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import groupby
from types import MappingProxyType
from typing import Literal

import numpy as np

OFFSET_SIGMA_S = 0.5  # of an offset given without its deviation
START_SIGMA_S = 3.0  # of a wall-clock start
PRECISE_S = 0.1  # a hint as good as this can tie a camera by itself
# The most that a hint adds to the logarithm of the odds. Less than twice ln 19, so that a wrong hint can unsettle an
# offset that the tracks alone are 95 % sure of, but never make its own rival as sure.
MOST_NATS = 5.0
_RIGHT_ODDS = 9.0  # of hints that mean what they say against such as are simply wrong
_MODE_SIGMA_S = 0.1  # how well a mode is placed before it is refined
CONTRADICTION = 4.0  # deviations beyond which two statements contradict each other
_LEAST_RATE_ERROR = 3e-3  # smaller ones are found from the tracks

Source = Literal["offset_s", "start_time"]


@dataclass(frozen=True, slots=True)
class OffsetHint:
    """When a camera's clock showed 0, in seconds on a clock that all hints of the same source share."""

    camera_id: str
    offset_s: float
    sigma_s: float = OFFSET_SIGMA_S
    source: Source = "offset_s"

    def __post_init__(self) -> None:
        _require_finite(self.name, self.offset_s)
        _require_deviation(self.name, self.sigma_s)

    @property
    def name(self) -> str:
        return f"{self.source} of {self.camera_id}"


@dataclass(frozen=True, slots=True)
class SimultaneousHint:
    """One moment as several cameras' clocks showed it, each known to `sigma_s`: a flash, a clap, a start."""

    name: str
    camera_time_s: Mapping[str, float]
    sigma_s: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "camera_time_s", MappingProxyType(dict(self.camera_time_s)))
        if len(self.camera_time_s) < 2:
            raise ValueError(f"{self.name}: expected the times of at least two cameras, got {len(self.camera_time_s)}")
        for time_s in self.camera_time_s.values():
            _require_finite(self.name, time_s)
        _require_deviation(self.name, self.sigma_s)


@dataclass(frozen=True, slots=True)
class PairHint:
    """camera time 1 = offset_s + rate * camera time 0, known to `sigma_s` at camera time 0 = `centre_s`."""

    sources: tuple[str, ...]  # names of the hints it was made of
    offset_s: float
    rate: float
    centre_s: float
    sigma_s: float
    rate_sigma: float
    heavy_tail: bool = False

    @property
    def name(self) -> str:
        return " and ".join(self.sources)

    def time1_s(self, time0_s: float) -> float:
        return self.offset_s + self.rate * time0_s

    def sigma_at(self, time0_s: float) -> float:
        """Deviation of `time1_s`: grows with the distance from the moment that was given."""
        return float(np.hypot(self.sigma_s, self.rate_sigma * (time0_s - self.centre_s)))

    def favour(self, time0_s: float, time1_s: float, span_s: float) -> float:
        """Logarithm (nats) of the odds that it gives two moments to be one, against any within `span_s`; bounded.

        A hint is right but for normal errors, those of wall clocks with the tails of a Cauchy distribution, or simply
        wrong.
        """
        sigma = float(np.hypot(self.sigma_at(time0_s), _MODE_SIGMA_S))
        z2 = ((time1_s - self.time1_s(time0_s)) / sigma) ** 2
        density = 1 / (np.pi * (1 + z2)) if self.heavy_tail else np.exp(-0.5 * min(z2, 1400.0)) / np.sqrt(2 * np.pi)
        return min(MOST_NATS, float(np.log1p(_RIGHT_ODDS * span_s * density / sigma)))


@dataclass(frozen=True, eq=False, slots=True)
class Hints:
    """Everything given; without any, synchronisation is blind. Hints of unknown cameras say nothing."""

    offsets: Sequence[OffsetHint] = ()
    simultaneous: Sequence[SimultaneousHint] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "offsets", tuple(self.offsets))
        object.__setattr__(self, "simultaneous", tuple(self.simultaneous))
        keys = [(h.source, h.camera_id) for h in self.offsets]
        for key in keys:
            if keys.count(key) > 1:
                raise ValueError(f"offsets: {key[0]} of {key[1]} is given twice")

    def __bool__(self) -> bool:
        return bool(self.offsets or self.simultaneous)

    @property
    def offsets_s(self) -> Mapping[str, float]:
        """The `offset_s` given, by camera."""
        return {h.camera_id: h.offset_s for h in self.offsets if h.source == "offset_s"}

    def between(self, camera0: str, camera1: str, rate_sigma: float) -> tuple[PairHint, ...]:
        """What they say of two cameras whose clocks' rates agree to `rate_sigma`.

        Offsets of one source make a hint, each common moment makes one, and two common moments or more make another
        together, which also knows the rate.
        """
        found: list[PairHint] = []
        for _, group in groupby(sorted(self.offsets, key=lambda h: h.source), key=lambda h: h.source):
            own = {h.camera_id: h for h in group}
            if camera0 in own and camera1 in own:
                a, b = own[camera0], own[camera1]
                sigma_s = float(np.hypot(a.sigma_s, b.sigma_s))
                offset_s = a.offset_s - b.offset_s
                found.append(
                    PairHint((a.name, b.name), offset_s, 1.0, 0.0, sigma_s, rate_sigma, a.source == "start_time")
                )
        moments = [h for h in self.simultaneous if camera0 in h.camera_time_s and camera1 in h.camera_time_s]
        for h in moments:
            time0_s, time1_s = h.camera_time_s[camera0], h.camera_time_s[camera1]
            sigma_s = float(np.sqrt(2) * h.sigma_s)
            found.append(PairHint((h.name,), time1_s - time0_s, 1.0, time0_s, sigma_s, rate_sigma))
        line = _line_through(moments, camera0, camera1, rate_sigma)
        return (*found, line) if line is not None else tuple(found)

    def stretch(self, camera_id: str, partner: str, rate_sigma: float) -> float | None:
        """By what factor a camera's clock must be stretched to run like the partner's, where moments tell a gross one.

        None where they tell nothing beyond what the tracks find by themselves.
        """
        for hint in self.between(partner, camera_id, rate_sigma):
            if abs(hint.rate - 1) > max(_LEAST_RATE_ERROR, CONTRADICTION * hint.rate_sigma):
                return 1 / hint.rate
        return None

    def stretched(self, camera_id: str, factor: float) -> Hints:
        """The same hints for a camera whose clock was stretched by a factor."""

        def moved(h: SimultaneousHint) -> SimultaneousHint:
            times = dict(h.camera_time_s)
            if camera_id in times:
                times[camera_id] *= factor
            return replace(h, camera_time_s=times)

        return replace(self, simultaneous=tuple(moved(h) for h in self.simultaneous))


def from_start_times(
    start_time: Mapping[str, datetime],
    first_frame_s: Mapping[str, float] | None = None,
    sigma_s: float = START_SIGMA_S,
) -> tuple[OffsetHint, ...]:
    """Hints from the wall-clock times at which cameras took their frame 0, as containers' metadata tell them.

    `first_frame_s` are the cameras' own times of frame 0, 0 by default. Cameras' clocks differ, and some containers
    keep when a recording ended: these are weak hints with heavy tails. Raises ValueError where only some have a time
    zone.
    """
    if len({time.tzinfo is None for time in start_time.values()}) > 1:
        raise ValueError("start_time: expected all of them with a time zone, or none")
    if not start_time:
        return ()
    earliest = min(start_time.values())
    return tuple(
        OffsetHint(c, (time - earliest).total_seconds() - (first_frame_s or {}).get(c, 0.0), sigma_s, "start_time")
        for c, time in start_time.items()
    )


def _line_through(
    moments: Sequence[SimultaneousHint], camera0: str, camera1: str, rate_sigma: float
) -> PairHint | None:
    """Offset and rate from several common moments, by least squares; None where they lie together."""
    time0 = np.array([h.camera_time_s[camera0] for h in moments])
    time1 = np.array([h.camera_time_s[camera1] for h in moments])
    if len(moments) < 2 or np.ptp(time0) <= 0:
        return None
    sigma = np.sqrt(2) * np.array([h.sigma_s for h in moments])
    centre = float(np.average(time0, weights=sigma**-2))
    shift = time1 - time0
    rows = np.column_stack([np.ones(len(moments)), time0 - centre]) / sigma[:, None]
    held = np.vstack([rows, [0.0, 1 / rate_sigma]])

    def fitted(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        b = np.concatenate([shift / sigma, np.zeros(len(A) - len(sigma))])
        return np.linalg.lstsq(A, b, rcond=None)[0], np.sqrt(np.diag(np.linalg.inv(A.T @ A)))

    x, deviation = fitted(rows)
    # A nominal frame rate that is plainly wrong must not bend what was measured.
    if abs(x[1]) <= CONTRADICTION * np.hypot(deviation[1], rate_sigma):
        x, deviation = fitted(held)
    if x[1] <= -1:
        return None
    if len(moments) > 2:
        chi2 = float(((rows @ x - shift / sigma) ** 2).sum())
        deviation = deviation * np.sqrt(max(1.0, chi2 / (len(moments) - 2)))
    rate = 1 + float(x[1])
    offset_s = float(x[0]) + centre - rate * centre
    sources = tuple(h.name for h in moments)
    return PairHint(sources, offset_s, rate, centre, float(deviation[0]), float(deviation[1]))


def _require_finite(name: str, value: float) -> None:
    if not np.isfinite(value):
        raise ValueError(f"{name}: expected a finite number, got {value}")


def _require_deviation(name: str, sigma_s: float) -> None:
    if not (np.isfinite(sigma_s) and sigma_s > 0):
        raise ValueError(f"{name}: expected a positive deviation, got {sigma_s}")
