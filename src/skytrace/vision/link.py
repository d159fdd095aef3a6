"""Compiled steps of tracking: prediction, association and update of all live tracks at once.

A constant-velocity Kalman filter whose acceleration noise grows with speed, the same along both axes; lengths in
pixels, times in frames.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from skytrace.vision import candidates as cand

# Columns of a live track.
X, Y, VX, VY, PXX, PXV, PVV = 0, 1, 2, 3, 4, 5, 6
CONTRAST, SIZE, REACH = 7, 8, 9  # running means; reach is half the longer side
FIRST_X, FIRST_Y, WAY = 10, 11, 12  # where it began, moved along with the scenery, and how far it is from there
HITS, FRAME = 13, 14  # detections so far; frame of the last
ISOLATED, CHANGE, NOVELTY, EDGE, STRENGTH = 15, 16, 17, 18, 19  # running means of its candidates' marks
NOISE = 20  # mean square of what predictions miss
CONFIRMED = 21
BORN = 22  # frame of the first detection
RAW_X, RAW_Y = 23, 24  # where it began, in the picture
SEEN = 25  # share of the last frames in which it was found
N_COLUMNS = 26

_SHAPE_VARIANCE = 0.1  # px^2, what the picture of an object moves about in it
_SHAPE_SHARE = 0.05  # of its size
_SURPRISE = 3.0  # squared distance in variances along one axis; 2 is the mean
_FIRST_WAY_PX = 4.0
_LOOK_SCALE = 0.5  # deviation of the logarithm of contrast and size from picture to picture
_LOOK_LIMIT = 9.0
_CLEAR_GAP = 2  # frames
_CLUTTER_REACH_PX = 6.0
_LEAST_CHANGE, _CHANGE_PER_GAP, _CHANGE_SHARE = 0.6, 0.1, 0.3
_MEMORY = 0.1  # share of a new value in running means
_LONG_MEMORY = 0.03


class MotionModel(NamedTuple):
    """How targets move, in pixels and frames; see TrackerSettings."""

    acceleration: float
    turn: float
    first_speed: float
    standing_speed: float
    standing_share: float
    watch_way_px: float
    gate: float
    least_novelty: float
    reach_px: float


@njit(cache=True, error_model="numpy")
def predict(tracks, dt, shift_x, shift_y, unsettled, model):
    """Move tracks (n, N_COLUMNS) on by dt frames; where each began moves with the scenery.

    While the camera's motion is not known, tracks that are not confirmed begin anew.
    """
    for t in tracks:
        t[X] += dt * t[VX]
        t[Y] += dt * t[VY]
        a = model.acceleration + model.turn * np.hypot(t[VX], t[VY])
        standing = t[CONFIRMED] == 0 and t[WAY] < model.watch_way_px
        if standing:
            a *= model.standing_share
            t[X] += shift_x
            t[Y] += shift_y
        t[FIRST_X] += shift_x
        t[FIRST_Y] += shift_y
        if unsettled and t[CONFIRMED] == 0:
            t[FIRST_X], t[FIRST_Y], t[HITS], t[BORN] = t[X], t[Y], min(t[HITS], 3.0), t[FRAME]
        q = a * a
        t[PXX] += dt * (2 * t[PXV] + dt * t[PVV]) + 0.25 * q * dt**4
        t[PXV] += dt * t[PVV] + 0.5 * q * dt**3
        t[PVV] += q * dt * dt
        excess = t[PVV] / model.first_speed**2
        if excess > 1:
            t[PVV] /= excess
            t[PXV] /= np.sqrt(excess)


@njit(cache=True, error_model="numpy")
def least_change(t, frame):
    """How much has to change, in limits of the detector, to be taken for a confirmed target against clutter.

    Next to where it was a moment ago little is enough; what comes up after a gap has to be as strong as the target was.
    """
    gap = frame - t[FRAME] - 1
    return min(_LEAST_CHANGE + _CHANGE_PER_GAP * max(gap - _CLEAR_GAP, 0.0), max(1.0, _CHANGE_SHARE * t[STRENGTH]))


@njit(cache=True, error_model="numpy")
def clutter_reach(t, frame):
    """How far from where it is expected a target may come up against clutter.

    A target lost in the open sky does not come up far away in front of trees.
    """
    if frame - t[FRAME] - 1 > _CLEAR_GAP and t[ISOLATED] > 0.5:
        return _CLUTTER_REACH_PX + t[SIZE]
    return np.inf


@njit(cache=True, error_model="numpy")
def _cost(t, c, frame, model):
    """Negative logarithm of how well a candidate continues a track; infinite outside the gate.

    What has long been where it is does not continue a confirmed target, whose place is kept out of the background.
    """
    d2 = (c[cand.X] - t[X]) ** 2 + (c[cand.Y] - t[Y]) ** 2
    if d2 > model.reach_px**2:
        return np.inf
    if t[CONFIRMED] > 0:
        if c[cand.NOVELTY] < model.least_novelty:
            return np.inf
        if c[cand.ISOLATED] == 0 and (c[cand.CHANGE] < least_change(t, frame) or d2 > clutter_reach(t, frame) ** 2):
            return np.inf
    s = t[PXX] + c[cand.SIGMA] ** 2 + _SHAPE_VARIANCE + (_SHAPE_SHARE * t[SIZE]) ** 2
    d2 /= s
    if d2 > model.gate**2:
        return np.inf
    same = c[cand.CONTRAST] if t[CONTRAST] > 0 else -c[cand.CONTRAST]
    look = np.log(max(same, 0.5) / max(abs(t[CONTRAST]), 0.5)) / _LOOK_SCALE
    grown = np.log(c[cand.SIZE] / t[SIZE]) / _LOOK_SCALE
    return d2 + 2 * np.log(s) + 0.5 * (min(look * look, _LOOK_LIMIT) + min(grown * grown, _LOOK_LIMIT))


@njit(cache=True, error_model="numpy")
def costs(tracks, found, frame, model):
    """Costs (n, m) of continuing n tracks by m candidates, infinite where impossible; and the pairs (n,) agreed on.

    A pair is agreed on where each is the other's cheapest and neither has another choice, which settles most of them;
    -1 is for tracks that have none.
    """
    n, m = len(tracks), len(found)
    cost = np.empty((n, m))
    choices, suitors = np.zeros(n, np.int64), np.zeros(m, np.int64)
    # Most pairs are far beyond the gate, which needs nothing but distances to be seen.
    reach2 = np.empty(m)
    for i in range(m):
        reach2[i] = model.gate**2 * found[i, cand.SIGMA] ** 2
    for k in range(n):
        t = tracks[k]
        own = model.gate**2 * (t[PXX] + _SHAPE_VARIANCE + (_SHAPE_SHARE * t[SIZE]) ** 2)
        for i in range(m):
            if (found[i, cand.X] - t[X]) ** 2 + (found[i, cand.Y] - t[Y]) ** 2 > 1.001 * (own + reach2[i]):
                cost[k, i] = np.inf
                continue
            cost[k, i] = _cost(t, found[i], frame, model)
            if cost[k, i] < np.inf:
                choices[k] += 1
                suitors[i] += 1
    owner = np.full(n, -1)
    for k in range(n):
        if choices[k] == 1:
            for i in range(m):
                if cost[k, i] < np.inf and suitors[i] == 1:
                    owner[k] = i
    return cost, owner, choices


@njit(cache=True, error_model="numpy")
def update(t, c, frame):
    """Take a candidate into a track. What has stood still and now moves off is less sure of its motion at once."""
    own = c[cand.SIGMA] ** 2 + _SHAPE_VARIANCE + (_SHAPE_SHARE * t[SIZE]) ** 2
    ex, ey = c[cand.X] - t[X], c[cand.Y] - t[Y]
    surprise = (ex * ex + ey * ey) / (_SURPRISE * (t[PXX] + own))
    if surprise > 1 and t[CONFIRMED] == 0 and t[WAY] < _FIRST_WAY_PX and c[cand.CHANGE] > 1:
        t[PXX] *= surprise
        t[PXV] *= surprise
        t[PVV] *= surprise
    s = t[PXX] + own
    kx, kv = t[PXX] / s, t[PXV] / s
    t[X] += kx * ex
    t[Y] += kx * ey
    t[VX] += kv * ex
    t[VY] += kv * ey
    t[PVV] -= kv * t[PXV]
    t[PXV] *= 1 - kx
    t[PXX] *= 1 - kx
    t[HITS] += 1
    share, long_share = max(_MEMORY, 1 / t[HITS]), max(_LONG_MEMORY, 1 / t[HITS])
    t[CONTRAST] += share * (c[cand.CONTRAST] - t[CONTRAST])
    t[SIZE] *= (c[cand.SIZE] / t[SIZE]) ** share
    t[REACH] += share * (0.5 * max(c[cand.WIDTH], c[cand.HEIGHT]) - t[REACH])
    t[CHANGE] += share * (c[cand.CHANGE] - t[CHANGE])
    t[NOVELTY] += share * (c[cand.NOVELTY] - t[NOVELTY])
    t[STRENGTH] += long_share * (max(c[cand.CHANGE], c[cand.STANDING]) - t[STRENGTH])
    t[NOISE] += share * (ex * ex + ey * ey - t[NOISE])
    t[ISOLATED] += long_share * (c[cand.ISOLATED] - t[ISOLATED])
    if c[cand.ISOLATED] > 0:
        t[EDGE] += long_share * (c[cand.EDGE] - t[EDGE])
    if t[HITS] <= 3:
        t[FIRST_X] += (c[cand.X] - t[FIRST_X]) / t[HITS]
        t[FIRST_Y] += (c[cand.Y] - t[FIRST_Y]) / t[HITS]
    t[WAY] = np.hypot(t[X] - t[FIRST_X], t[Y] - t[FIRST_Y])
    t[FRAME] = frame


@njit(cache=True, error_model="numpy")
def update_owned(tracks, found, owner, frame):
    """Take the candidates owned by tracks into them."""
    for k in range(len(tracks)):
        if owner[k] >= 0:
            update(tracks[k], found[owner[k]], frame)


@njit(cache=True, error_model="numpy")
def begin(t, c, frame, model):
    """A new track from a candidate."""
    t[:] = 0.0
    t[X], t[Y] = c[cand.X], c[cand.Y]
    t[FIRST_X], t[FIRST_Y], t[RAW_X], t[RAW_Y] = t[X], t[Y], t[X], t[Y]
    t[PXX] = c[cand.SIGMA] ** 2 + _SHAPE_VARIANCE
    # What did not change since the last picture cannot be fast.
    speed = model.first_speed if c[cand.CHANGE] > 1 else model.standing_speed
    t[PVV] = speed * speed
    t[CONTRAST], t[SIZE], t[REACH] = c[cand.CONTRAST], c[cand.SIZE], 0.5 * max(c[cand.WIDTH], c[cand.HEIGHT])
    t[HITS], t[FRAME], t[BORN] = 1.0, frame, frame
    t[ISOLATED], t[CHANGE], t[NOVELTY] = c[cand.ISOLATED], c[cand.CHANGE], c[cand.NOVELTY]
    t[STRENGTH] = max(c[cand.CHANGE], c[cand.STANDING])
    t[EDGE] = c[cand.EDGE] if c[cand.ISOLATED] > 0 else 2.0
