"""Compiled decisions about live tracks: which to look for, which have shown to be targets, which have ended."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from skytrace.vision import candidates as cand
from skytrace.vision import link

_NEW_HITS, _NEW_CHANGE = 4, 0.6  # a track that is not confirmed yet is looked for from then on
_SAME_PX, _SAME_SIZES = 2.0, 0.5  # a track this close to a candidate has a claim to it
_CLAIM_HITS = 8.0
_SHORT_PATIENCE, _PATIENCE_SHARE, _LONG_PATIENCE = 2.0, 0.25, 10.0  # frames; more for every hit


class TrackerSettings(NamedTuple):
    """Speeds and accelerations are in picture widths, so that they mean the same at any size."""

    first_speed: float = 0.5  # widths/s, one deviation of a new track's speed
    acceleration: float = 0.2  # widths/s^2, one deviation
    turn: float = 3.0  # 1/s, added times the speed: what is fast turns fast
    standing_speed: float = 0.01  # widths/s, of something that did not change since the last picture
    standing_share: float = 0.1  # of the acceleration, until it has moved
    gate: float = 4.0  # deviations
    least_seen: float = 0.35  # share of the last frames in which a confirmed track is found, or it ends
    seen_memory_s: float = 1.0
    history_s: float = 60.0  # what is kept of a track that has not moved yet
    min_hits: int = 8
    least_way_px: float = 4.0  # to be confirmed, a track has to get this far from where it began
    least_way_sizes: float = 0.5  # and this many of its sizes farther
    clutter_factor: float = 4.0  # times as far against trees and houses
    clutter_change: float = 2.5  # and changing it this many times as much as the limit
    least_change: float = 1.75  # times the limit for a change, on the average
    least_novelty: float = 0.4  # share of its response that must be new where it is: what has moved is
    max_edge_px: float = 2.75  # from background to brightest on the average; what is solid is sharper
    fast_sizes: float = 4.0  # so many of its sizes a second is faster than any cloud goes:
    fast_edge_px: float = 3.3  # then it may be softer,
    fast_change: float = 1.25  # and change less,
    far_ways: float = 4.0  # least of all after so many times the way it has to go,
    far_speed: float = 0.015  # at so many widths/s,
    far_hits: int = 24
    far_miss: float = 0.25  # where expected to within so many of its sizes,
    far_change: float = 0.5
    companions: int = 3  # so many tracks around that drift alike are clouds
    drift_alike: float = 0.35  # share of the speed by which they differ
    drift_memory_s: float = 10.0
    watch_way_px: float = 1.5  # a track that got this far is looked for in every picture
    max_tracks: int = 400


@njit(cache=True, error_model="numpy")
def to_seek(tracks, frame, settings):
    """Indices (m,) of the tracks to be looked for in a picture in which they were not among the candidates."""
    out = np.empty(len(tracks), np.int64)
    n = 0
    for k, t in enumerate(tracks):
        new = (
            t[link.WAY] > settings.watch_way_px
            and t[link.HITS] >= _NEW_HITS
            and t[link.EDGE] < settings.fast_edge_px
            and t[link.NOVELTY] > settings.least_novelty
            and t[link.CHANGE] > _NEW_CHANGE
        )
        if (t[link.CONFIRMED] > 0 or new) and t[link.FRAME] < frame:
            out[n] = k
            n += 1
    return out[:n]


@njit(cache=True, error_model="numpy")
def is_claimed(tracks, k, c):
    """Whether a candidate found for track k belongs to another one."""
    for i, t in enumerate(tracks):
        near = np.hypot(t[link.X] - c[cand.X], t[link.Y] - c[cand.Y]) < max(_SAME_PX, _SAME_SIZES * t[link.SIZE])
        older = t[link.CONFIRMED] > 0 or t[link.HITS] >= min(_CLAIM_HITS, tracks[k, link.HITS])
        if i != k and near and older:
            return True
    return False


@njit(cache=True, error_model="numpy")
def to_confirm(tracks, frame, rate_hz, width_px, settings):
    """Indices (m,) of the tracks that have come to move and look like a target in this picture."""
    out = np.empty(len(tracks), np.int64)
    n = 0
    for k, t in enumerate(tracks):
        fresh = t[link.FRAME] == frame and t[link.CONFIRMED] == 0 and t[link.HITS] >= settings.min_hits
        if fresh and _is_target(t, rate_hz, width_px, settings):
            out[n] = k
            n += 1
    return out[:n]


@njit(cache=True, error_model="numpy")
def _is_target(t, rate_hz, width_px, s):
    need = s.least_way_px + s.least_way_sizes * t[link.SIZE] + 3 * np.sqrt(t[link.NOISE])
    clutter = t[link.ISOLATED] < 0.5
    # Dirt on the lens keeps its place in the picture when the camera shakes, a roof keeps it in the scenery.
    way = min(t[link.WAY], np.hypot(t[link.X] - t[link.RAW_X], t[link.Y] - t[link.RAW_Y]))
    if way <= (s.clutter_factor if clutter else 1.0) * need or t[link.NOVELTY] <= s.least_novelty:
        return False
    age_s = max(t[link.FRAME] - t[link.BORN], 1.0) / rate_hz
    fast = way > s.fast_sizes * t[link.SIZE] * age_s and way > 2 * need and t[link.HITS] >= 2 * s.min_hits
    if t[link.EDGE] >= (s.fast_edge_px if fast else s.max_edge_px):
        return False
    far = fast and way > s.far_ways * need and way > s.far_speed * width_px * age_s and t[link.HITS] >= s.far_hits
    if far and t[link.CHANGE] > s.far_change and np.sqrt(t[link.NOISE]) < s.far_miss * t[link.SIZE]:
        return True
    if clutter:
        return t[link.CHANGE] > s.clutter_change
    return t[link.CHANGE] > (s.fast_change if fast else s.least_change)


@njit(cache=True, error_model="numpy")
def are_alive(tracks, frame, rate_hz, settings):
    """Whether each track (n,) goes on; keeps the share of the last frames in which it was found."""
    alive = np.empty(len(tracks), np.bool_)
    for k, t in enumerate(tracks):
        seen = 1.0 if t[link.FRAME] == frame else 0.0
        t[link.SEEN] += (seen - t[link.SEEN]) / (settings.seen_memory_s * rate_hz)
        # What stands still is measured now and then only.
        if t[link.WAY] < settings.watch_way_px and (t[link.HITS] > 1 or t[link.CHANGE] <= 1):
            patience = 2.0 * cand.REST_FRAMES + 1
        elif t[link.HITS] == 1:
            patience = 1.0
        else:
            patience = min(_SHORT_PATIENCE + _PATIENCE_SHARE * t[link.HITS], _LONG_PATIENCE)
        if t[link.CONFIRMED] > 0:
            alive[k] = t[link.SEEN] > settings.least_seen
        else:
            alive[k] = frame - t[link.FRAME] <= patience
    return alive
