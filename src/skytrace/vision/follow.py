"""Detector and tracker together: pictures in, one after the other, tracks out."""

from __future__ import annotations

from collections import deque
from typing import Literal, Protocol

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.vision.detect import Detector, LumaArray
from skytrace.vision.found import FoundTrack
from skytrace.vision.mog2 import Mog2Detector
from skytrace.vision.track import Tracker

Method = Literal["tophat", "mog2"]

_TURNING, _WHILE_S = 0.01, 0.5  # widths/s over so long: faster than clouds


class AnyDetector(Protocol):
    """What the tracker needs of a detector."""

    @property
    def unsettled(self) -> bool:
        """Whether the picture looked at last changed as a whole, so that changes in it mean nothing."""
        ...

    @property
    def scene_shift_px(self) -> FloatArray:
        """How far the scenery (2,) has moved in the picture since the first one."""
        ...

    def look(self, luma: LumaArray) -> FloatArray:
        """The candidates (n, N_COLUMNS) of a picture (height, width)."""
        ...

    def seek(
        self, xy_px: FloatArray, radius_px: float, contrast: float, size_px: float, least_change: float
    ) -> FloatArray | None:
        """The candidate (N_COLUMNS,) around a place that looks like something known."""
        ...

    def learn(self, sure_px: FloatArray, unsure_px: FloatArray) -> None:
        """Take the picture looked at last as background but for boxes (n, 4) around targets."""
        ...


class Follower:
    """Follows everything that moves through a video. `mask` (height, width) is zero where nothing is to be found."""

    def __init__(
        self, size_px: tuple[int, int], frame_rate_hz: float, method: Method = "tophat", mask: LumaArray | None = None
    ) -> None:
        self._detector: AnyDetector
        if method == "mog2":
            self._detector = Mog2Detector(frame_rate_hz, mask)
        else:
            self._detector = Detector(size_px, frame_rate_hz, mask)
        self._tracker = Tracker(size_px[0], frame_rate_hz)
        self.view_moved_px = 0.0  # how far what is taken for scenery moved in the picture at most
        self.turned = False  # and it did so faster than clouds drift
        self._turning_px = _TURNING * size_px[0] * _WHILE_S
        self._recent_px: deque[FloatArray] = deque(maxlen=max(2, round(_WHILE_S * frame_rate_hz)))

    def step(self, frame: int, luma: LumaArray) -> None:
        """Look at the next picture (height, width); frames that are missing leave out their numbers."""
        detector, tracker = self._detector, self._tracker
        found = detector.look(luma)
        shift_px = detector.scene_shift_px
        tracker.step(frame, found, detector.seek, shift_px, detector.unsettled)
        detector.learn(*tracker.boxes_px())
        self.view_moved_px = max(self.view_moved_px, float(np.hypot(shift_px[0], shift_px[1])))
        self._recent_px.append(shift_px.copy())
        dx, dy = shift_px - self._recent_px[0]
        self.turned |= bool(np.hypot(dx, dy) > self._turning_px)

    def finish(self) -> tuple[FoundTrack, ...]:
        """The tracks, in order of their first frames."""
        return tuple(sorted(self._tracker.finish(), key=lambda t: (int(t.frame[0]), t.track_id)))
