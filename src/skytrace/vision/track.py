"""Candidates of single pictures linked into tracks; tracks that move like a target are confirmed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from skytrace.geometry.arrays import FloatArray
from skytrace.vision import candidates as cand
from skytrace.vision import judge, link
from skytrace.vision.found import FoundTrack, Rows, finished
from skytrace.vision.judge import TrackerSettings

# From a place, a radius, a contrast, a size and the least change to a candidate.
Seek = Callable[[FloatArray, float, float, float, float], FloatArray | None]

_FAR = 1e6
_MAX_DRIFTS = 200


class Tracker:
    """Follows everything there is; `step` once a picture, `finish` at the end."""

    def __init__(self, width_px: int, frame_rate_hz: float, settings: TrackerSettings | None = None) -> None:
        self._settings = s = settings or TrackerSettings()
        self._rate_hz = frame_rate_hz
        self._width_px, self._reach_px = width_px, 0.1 * width_px
        speed = width_px / frame_rate_hz
        self._model = link.MotionModel(
            acceleration=s.acceleration * speed / frame_rate_hz,
            turn=s.turn / frame_rate_hz,
            first_speed=s.first_speed * speed,
            standing_speed=s.standing_speed * speed,
            standing_share=s.standing_share,
            watch_way_px=s.watch_way_px,
            gate=s.gate,
            least_novelty=s.least_novelty,
            reach_px=self._reach_px,
        )
        self._tracks = np.zeros((0, link.N_COLUMNS))
        self._ids: list[int] = []
        self._rows: list[Rows] = []
        self._next_id = 1
        self._frame = -1
        self._shift_px = np.zeros(2)
        self._drifts = np.zeros((0, 5))  # place, velocity and last frame of unconfirmed tracks that moved and ended
        self._done: list[FoundTrack] = []

    def step(
        self, frame: int, found: FloatArray, seek: Seek | None, shift_px: FloatArray, unsettled: bool = False
    ) -> None:
        """Take in the candidates (m, cand.N_COLUMNS) of a picture, in which the scenery has moved by shift_px (2,)."""
        tracks = self._tracks
        dt = float(frame - self._frame) if self._frame >= 0 else 1.0
        dx, dy = shift_px - self._shift_px
        self._frame, self._shift_px = frame, np.array(shift_px)
        link.predict(tracks, dt, dx, dy, unsettled, self._model)
        owner = self._assign(found)
        link.update_owned(tracks, found, owner, float(frame))
        values = found.tolist()
        for k in np.flatnonzero(owner >= 0).tolist():
            self._record(k, values[owner[k]])
        if seek is not None:
            self._seek(seek)
        if not unsettled:
            self._confirm()
        self._end()
        self._begin(found, values, owner)

    def boxes_px(self) -> tuple[FloatArray, FloatArray]:
        """Boxes (n, 4) x0, y0, x1, y1 around the confirmed targets seen in the last picture: the sure, the unsure.

        What stands still against clutter may be clutter: only the background can tell, in time.
        """
        t = self._tracks[(self._tracks[:, link.CONFIRMED] > 0) & (self._tracks[:, link.FRAME] == self._frame)]
        half = t[:, [link.REACH]] + 3
        boxes = np.hstack([t[:, [link.X, link.Y]] - half, t[:, [link.X, link.Y]] + half])
        sure = (t[:, link.ISOLATED] > 0.5) | (np.hypot(t[:, link.VX], t[:, link.VY]) > self._model.standing_speed)
        return boxes[sure], boxes[~sure]

    def finish(self) -> list[FoundTrack]:
        """All confirmed tracks."""
        for k in np.flatnonzero(self._tracks[:, link.CONFIRMED] > 0).tolist():
            self._keep(k)
        self._tracks, self._ids, self._rows = self._tracks[:0], [], []
        return self._done

    def _assign(self, found: FloatArray) -> NDArray[np.int64]:
        """The candidate of each track, -1 for none: the assignment of least total cost."""
        cost, owner, choices = link.costs(self._tracks, found, float(self._frame), self._model)
        unclear = np.flatnonzero((choices > 0) & (owner < 0))
        if len(unclear):
            part = cost[unclear]
            columns = np.flatnonzero(np.isfinite(part).any(axis=0))
            part = np.minimum(part[:, columns], _FAR)
            for k, i in zip(*linear_sum_assignment(part), strict=True):
                if part[k, i] < _FAR:
                    owner[unclear[k]] = columns[i]
        return owner

    def _seek(self, seek: Seek) -> None:
        """Look for what is followed and was not among the candidates."""
        tracks, frame = self._tracks, float(self._frame)
        for k in judge.to_seek(tracks, frame, self._settings).tolist():
            t = tracks[k]
            radius = min(max(6.0, 3 * np.sqrt(t[link.PXX] + 0.25)) + 0.5 * t[link.SIZE], self._reach_px)
            least_change = np.inf
            if t[link.CONFIRMED] > 0:
                least_change = link.least_change(t, frame)
                radius = min(radius, link.clutter_reach(t, frame))
            c = seek(t[:2], radius, t[link.CONTRAST], t[link.SIZE], least_change)
            if c is not None and c[cand.NOVELTY] > self._settings.least_novelty and not judge.is_claimed(tracks, k, c):
                link.update(t, c, frame)
                self._record(k, c.tolist())

    def _confirm(self) -> None:
        s, t = self._settings, self._tracks
        for k in judge.to_confirm(t, float(self._frame), self._rate_hz, float(self._width_px), s).tolist():
            t[k, link.CONFIRMED] = float(self._companions(k) < s.companions)
            t[k, link.SEEN] = 1.0

    def _companions(self, k: int) -> int:
        """How many other tracks around drift like one: clouds do so together."""
        s = self._settings
        drifts = np.vstack([self._drifts, _drifts(np.delete(self._tracks, k, axis=0), s)])
        own = _drifts(self._tracks[k : k + 1], s)
        if not len(own):
            return 0
        place, velocity = own[0, :2], own[0, 2:4]
        near = np.hypot(*(drifts[:, :2] - place).T) < 2.5 * self._reach_px
        alike = np.hypot(*(drifts[:, 2:4] - velocity).T) < s.drift_alike * np.hypot(*velocity)
        late = drifts[:, 4] > self._frame - s.drift_memory_s * self._rate_hz
        return int((near & alike & late).sum())

    def _end(self) -> None:
        s, t = self._settings, self._tracks
        alive = judge.are_alive(t, float(self._frame), self._rate_hz, s)
        if alive.all():
            return
        confirmed = t[:, link.CONFIRMED] > 0
        for k in np.flatnonzero(~alive & confirmed).tolist():
            self._keep(k)
        moved = ~(alive | confirmed) & (t[:, link.WAY] > s.watch_way_px)
        if moved.any():
            self._drifts = np.vstack([self._drifts, _drifts(t[moved], s)])[-_MAX_DRIFTS:]
        self._tracks = t[alive]
        for k in np.flatnonzero(~alive)[::-1].tolist():
            del self._ids[k], self._rows[k]

    def _begin(self, found: FloatArray, values: list[list[float]], owner: NDArray[np.int64]) -> None:
        free = np.ones(len(found), bool)
        free[owner[owner >= 0]] = False
        fresh = np.flatnonzero(free)[: self._settings.max_tracks - len(self._tracks)]
        if not len(fresh):
            return
        tracks = np.zeros((len(fresh), link.N_COLUMNS))
        for k, i in enumerate(fresh.tolist()):
            link.begin(tracks[k], found[i], float(self._frame), self._model)
            self._ids.append(self._next_id)
            self._rows.append(Rows(int(self._settings.history_s * self._rate_hz)))
            self._next_id += 1
            self._rows[-1].append(self._row(values[i]), False)
        self._tracks = np.vstack([self._tracks, tracks])

    def _record(self, k: int, c: list[float]) -> None:
        self._rows[k].append(self._row(c), bool(self._tracks[k, link.CONFIRMED] > 0))

    def _row(self, c: list[float]) -> tuple[float, ...]:
        marks = (cand.X, cand.Y, cand.SIGMA, cand.ISOLATED, cand.CHANGE, cand.CONTRAST, cand.SIZE)
        return (self._frame, *(c[k] for k in marks))

    def _keep(self, k: int) -> None:
        self._done.append(finished(self._ids[k], self._rows[k].array(), self._tracks[k], self._rate_hz))


def _drifts(tracks: FloatArray, settings: TrackerSettings) -> FloatArray:
    """Place, mean velocity and last frame (m, 5) of those tracks that moved."""
    t = tracks[(tracks[:, link.HITS] >= 5) & (tracks[:, link.WAY] > settings.watch_way_px)]
    age = np.maximum(t[:, [link.FRAME]] - t[:, [link.BORN]], 1)
    velocity = (t[:, [link.X, link.Y]] - t[:, [link.FIRST_X, link.FIRST_Y]]) / age
    return np.hstack([t[:, [link.X, link.Y]], velocity, t[:, [link.FRAME]]])
