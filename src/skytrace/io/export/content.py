"""What every format is written from, and what a format says of itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from types import MappingProxyType
from typing import Literal

import numpy as np

from skytrace.geometry.arrays import FloatArray, IntArray, frozen_array
from skytrace.geometry.rigid import Rigid
from skytrace.model.camera import Clock, Intrinsics

Unit = Literal["m", "arbitrary"]
Content = str | bytes | Mapping[str, str]  # a file, or a folder's files by their names


@dataclass(frozen=True, eq=False, slots=True)
class ExportCamera:
    """A registered camera in the frame of the export."""

    camera_id: str
    camera_from_frame: Rigid
    clock: Clock  # on the reference camera's clock
    intrinsics: Intrinsics  # refined
    geodetic: FloatArray | None = None  # (3,) latitude and longitude in radians, height in metres

    def __post_init__(self) -> None:
        if self.geodetic is not None:
            object.__setattr__(self, "geodetic", frozen_array(self.geodetic, (3,), "geodetic"))


@dataclass(frozen=True, eq=False, slots=True)
class ExportRun:
    """A run sampled as it is to be written. Rows of `segment` -1 lie in gaps: only their times are numbers."""

    name: str
    reference: str  # the camera whose clock times were estimated on
    unit: Unit
    frame: str  # of positions, in words
    time_s: FloatArray  # (n,)
    position: FloatArray  # (n, 3)
    velocity: FloatArray  # (n, 3) per second
    n_cameras: IntArray  # (n,)
    segment: IntArray  # (n,)
    sigma: FloatArray | None = None  # (n,) posterior deviation of the position; none where it is not wanted
    geodetic: FloatArray | None = None  # (n, 3) latitude and longitude in radians, height in metres
    vertical_datum: str | None = None  # what heights are counted from
    time_zero: datetime | None = None  # in UTC: the instant of time_s = 0, where known
    cameras: Mapping[str, ExportCamera] = field(default_factory=dict)
    clock: str = ""  # what time_s is, in words

    def __post_init__(self) -> None:
        object.__setattr__(self, "time_s", frozen_array(self.time_s, (None,), "time_s"))
        n = len(self.time_s)
        for name in ("position", "velocity"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), (n, 3), name, finite=False))
        for name in ("n_cameras", "segment"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), (n,), name, np.int64))
        for name, shape in (("sigma", (n,)), ("geodetic", (n, 3))):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, frozen_array(value, shape, name, finite=False))
        object.__setattr__(self, "cameras", MappingProxyType(dict(self.cameras)))
        if self.geodetic is not None and not self.vertical_datum:
            raise ValueError("vertical_datum: expected a name beside geodetic coordinates")
        if self.time_zero is not None and self.time_zero.tzinfo is None:
            raise ValueError("time_zero: expected an instant with its time zone")

    def stretches(self) -> Iterator[slice]:
        """The rows of each segment in order of time, gaps left out."""
        begins = np.flatnonzero(np.diff(self.segment, prepend=-2))
        for begin, end in zip(begins, np.append(begins[1:], len(self.segment)), strict=True):
            if self.segment[begin] >= 0:
                yield slice(int(begin), int(end))

    def longitude_latitude_deg(self) -> FloatArray:
        """Longitude and latitude in degrees and height in metres (n, 3), in the order of GeoJSON and KML."""
        if self.geodetic is None:
            raise ValueError("geodetic: the run has no georeference")
        return lon_lat_height(self.geodetic)

    def instants(self, default: datetime | None = None) -> list[str]:
        """The instants (n,) as ISO 8601 in UTC to the microsecond; `default` stands in for an unknown time_zero."""
        zero = self.time_zero or default
        if zero is None:
            raise ValueError("time_zero: the run has none")
        return [isoformat(zero + timedelta(seconds=t)) for t in self.time_s.tolist()]


def lon_lat_height(geodetic: FloatArray) -> FloatArray:
    """Longitude and latitude in degrees, height (..., 3), of latitude and longitude in radians, height (..., 3)."""
    latitude, longitude, height_m = np.moveaxis(np.asarray(geodetic), -1, 0)
    return np.stack([np.degrees(longitude), np.degrees(latitude), height_m], axis=-1)


def isoformat(instant: datetime) -> str:
    """An instant as ISO 8601 in UTC to the microsecond, with the Z that XML and JSON readers expect."""
    return instant.astimezone(UTC).isoformat(timespec="microseconds").replace("+00:00", "Z")


@dataclass(frozen=True, slots=True)
class Format:
    """One format: its name on the command line, what it needs of a run, and the pure function that writes it.

    `write` gets a run that has what `needs` says, rows in gaps only where `gaps` allows them, and `unit` "m" where
    metres are needed. It may raise InputError for a run that the format cannot hold.
    """

    name: str
    suffix: str  # of its files; empty for a folder
    summary: str
    write: Callable[[ExportRun], Content]
    needs: Literal["nothing", "metres", "georeference"] = "nothing"
    rate_hz: float | None = None  # where none is asked for; none: as the run is stored
    gaps: Literal["never", "allowed", "always"] = "never"
