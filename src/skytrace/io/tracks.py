"""TRACKS: what a detector found in one video, frame by frame, as `detections = ` of a flight reads it back."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skytrace.errors import InputError
from skytrace.geometry.arrays import FloatArray, IntArray, frozen_array
from skytrace.io.text import read_text

HEADER = "frame,time_s,x_px,y_px,sigma_px,track_id,target"
_ABOUT = "# about "


@dataclass(frozen=True, eq=False, slots=True)
class TrackRows:
    """Detections of all tracks in order of frame and track; the target has at most one a frame."""

    frame: IntArray  # (n,) 0-based, in presentation order
    time_s: FloatArray  # (n,) the container's time stamps
    xy_px: FloatArray  # (n, 2) raw pixels
    sigma_px: FloatArray  # (n,)
    track_id: IntArray  # (n,)
    target: IntArray  # (n,) 1 on the tracks taken as the target, else 0

    def __post_init__(self) -> None:
        for name in ("frame", "track_id", "target"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), (None,), name, np.int64))
        n = len(self.frame)
        for name, shape in (("time_s", (n,)), ("xy_px", (n, 2)), ("sigma_px", (n,))):
            object.__setattr__(self, name, frozen_array(getattr(self, name), shape, name))

    def __len__(self) -> int:
        return len(self.frame)


def tracks_text(rows: TrackRows, about: Mapping[str, Any]) -> str:
    """The content of a TRACKS file: a comment with what is known of video and tracks as JSON, header, rows."""
    lines = [_ABOUT + json.dumps(about, ensure_ascii=True), HEADER]
    lines += [
        f"{frame},{time_s:.9f},{x:.3f},{y:.3f},{sigma:.3f},{track},{target}"
        for frame, time_s, (x, y), sigma, track, target in zip(
            rows.frame.tolist(),
            rows.time_s.tolist(),
            rows.xy_px.tolist(),
            rows.sigma_px.tolist(),
            rows.track_id.tolist(),
            rows.target.tolist(),
            strict=True,
        )
    ]
    return "\n".join(lines) + "\n"


def read_about(path: Path) -> dict[str, Any]:
    """What a TRACKS file says of its video and tracks. Raises InputError where it does not."""
    first = read_text(path, "tracks").partition("\n")[0]
    try:
        if not first.startswith(_ABOUT):
            raise ValueError
        about = json.loads(first[len(_ABOUT) :])
        if not isinstance(about, dict):
            raise ValueError
        return about
    except ValueError:
        message = "expected a first line '# about {...}' as skytrace detect writes it"
        raise InputError(path, message, line=1) from None
