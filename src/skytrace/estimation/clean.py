"""From raw detections to tracklets: what cannot be the moving target is dropped and counted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from skytrace.geometry.arrays import BoolArray, FloatArray, IntArray
from skytrace.model.track import Track

REASONS = (
    "not_finite",
    "outside_image",
    "duplicate_frame",
    "repeated_time",
    "isolated_jump",
    "frozen",
    "short_tracklet",
)


@dataclass(frozen=True, slots=True)
class CleanSettings:
    """Thresholds; lengths are relative to the image width so that they hold for any resolution."""

    max_gap_s: float = 0.4  # a longer silence ends a tracklet
    median_taps: int = 11
    jump_floor_width: float = 0.004  # deviations below this fraction of the width are never a jump
    jump_ratio: float = 4.0  # ... nor below this many times the local scatter about the running median
    frozen_s: float = 0.5
    frozen_extent_width: float = 0.001
    min_detections: int = 4  # a cubic needs four


@dataclass(frozen=True, eq=False, slots=True)
class CleanTracks:
    """Tracklets in order of time, and how many detections were dropped for which reason."""

    tracklets: tuple[Track, ...]
    dropped: Mapping[str, int]


def clean_detections(
    frame: ArrayLike,
    xy_px: ArrayLike,
    frame_rate_hz: float,
    size_px: tuple[int, int],
    settings: CleanSettings,
    sigma_px: FloatArray | None = None,
    time_s: FloatArray | None = None,
) -> CleanTracks:
    """Tracklets of the moving target from detections (n,), (n, 2) in any order.

    `time_s` (n,) are per-frame time stamps where known, never falling with the frame; otherwise frames are taken to be
    evenly spaced. Frames that share a time show one moment, of which the first detection counts.
    """
    frame, xy_px = np.asarray(frame, float), np.asarray(xy_px, float)
    dropped: dict[str, int] = dict.fromkeys(REASONS, 0)

    finite = np.isfinite(frame) & np.isfinite(xy_px).all(axis=1)
    dropped["not_finite"] = int((~finite).sum())
    inside = finite & (xy_px >= -0.5).all(axis=1) & (xy_px <= np.array(size_px) - 0.5).all(axis=1)
    dropped["outside_image"] = int((finite & ~inside).sum())

    order = np.flatnonzero(inside)[np.argsort(frame[inside], kind="stable")]
    first = one_per_frame(frame[order], xy_px[order])
    dropped["duplicate_frame"] = len(order) - len(first)
    order = order[first]
    t = frame[order] / frame_rate_hz if time_s is None else time_s[order]
    later = np.diff(t, prepend=-np.inf) > 0
    dropped["repeated_time"] = int((~later).sum())
    order, t = order[later], t[later]

    width = size_px[0]
    smooth = ~isolated_jumps(xy_px[order], settings.median_taps, settings.jump_ratio, settings.jump_floor_width * width)
    dropped["isolated_jump"] = int((~smooth).sum())
    order, t = order[smooth], t[smooth]

    everything = Track(
        frame[order].astype(np.int64),
        xy_px[order],
        None if sigma_px is None else sigma_px[order],
        None if time_s is None else t,
    )
    tracklets = []
    for piece in split_at_breaks(t, xy_px[order], settings.max_gap_s, settings.jump_floor_width * width):
        if len(piece) < settings.min_detections:
            dropped["short_tracklet"] += len(piece)
        elif is_frozen(t[piece], xy_px[order[piece]], settings.frozen_s, settings.frozen_extent_width * width):
            dropped["frozen"] += len(piece)
        else:
            tracklets.append(everything.select(piece))
    return CleanTracks(tuple(tracklets), dropped)


def one_per_frame(frame: FloatArray, xy_px: FloatArray) -> IntArray:
    """Indices of one detection a frame, of frames (n,) in order: of several, the nearest to the previous position."""
    _, first, count = np.unique(frame, return_index=True, return_counts=True)
    keep = first.copy()
    for k in np.flatnonzero(count > 1):
        before = xy_px[keep[k - 1]] if k else xy_px[first[k]]
        rows = np.arange(first[k], first[k] + count[k])
        keep[k] = rows[np.argmin(np.linalg.norm(xy_px[rows] - before, axis=1))]
    return keep


def isolated_jumps(xy_px: FloatArray, taps: int, ratio: float, floor_px: float) -> BoolArray:
    """Detections (n,) that stand off the running median of their neighbours by more than the local motion explains."""
    if len(xy_px) < taps:
        return np.zeros(len(xy_px), bool)
    half = taps // 2
    padded = np.pad(xy_px, ((half, half), (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, taps, axis=0)  # (n, 2, taps)
    median = np.median(windows, axis=2)
    deviation = np.linalg.norm(windows - median[:, :, None], axis=1)  # (n, taps)
    return np.linalg.norm(xy_px - median, axis=1) > np.maximum(ratio * np.median(deviation, axis=1), floor_px)


def split_at_breaks(time_s: FloatArray, xy_px: FloatArray, max_gap_s: float, floor_px: float) -> list[IntArray]:
    """Index ranges of tracklets: a break is a long silence, or a step that the steps around it do not explain."""
    if len(time_s) == 0:
        return []
    dt = np.diff(time_s)
    step = np.linalg.norm(np.diff(xy_px, axis=0), axis=1)
    speed = step / dt
    # Compare with the faster of the typical steps on either side, so that accelerating targets stay whole; beyond the
    # ends there are none.
    side = 5
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(speed, side), side)
    usual = np.maximum(np.median(windows[: len(speed)], axis=1), np.median(windows[side + 1 :], axis=1))
    breaks = (dt > max_gap_s) | ((step > 3 * floor_px) & (step > 5 * usual * dt))
    return np.split(np.arange(len(time_s)), np.flatnonzero(breaks) + 1)


def is_frozen(time_s: FloatArray, xy_px: FloatArray, frozen_s: float, extent_px: float) -> bool:
    """Whether a tracklet stands still all along: a stuck blob, since a target that hovers also arrives and leaves."""
    extent = np.ptp(xy_px, axis=0).max()
    return bool(extent <= extent_px and time_s[-1] - time_s[0] >= frozen_s)
