"""From a video to tracks: decoded once, looked at picture by picture, in memory that does not grow with pictures."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skytrace.errors import InputError
from skytrace.geometry.arrays import FloatArray
from skytrace.io.tracks import TrackRows
from skytrace.io.video import Frame, LumaArray, VideoInfo, VideoWarning, open_video, read_frames
from skytrace.vision.choose import choose_target
from skytrace.vision.follow import Follower, Method
from skytrace.vision.found import FoundTrack

_VERSION = 1  # counts up when the same settings come to find something else
_ASSUMED_RATE_HZ = 30.0  # where a file does not tell its rate


@dataclass(frozen=True, eq=False, slots=True)
class DetectedVideo:
    """All tracks of a video, and which of them are the target's."""

    info: VideoInfo
    method: Method
    n_frames: int
    rate_hz: float
    tracks: tuple[FoundTrack, ...]
    target: frozenset[int]
    time_s: FloatArray  # (n,) of the frames read
    frame: FloatArray  # (n,) their indices
    view_moved_px: float  # how far what is taken for scenery moved in the picture at most
    warnings: tuple[str, ...]

    def rows(self) -> TrackRows:
        """The detections, ordered by frame and track."""
        columns = []
        taken: set[int] = set()
        # Where pieces of the target overlap, the longer one counts.
        for track in sorted(self.tracks, key=len, reverse=True):
            is_target = np.zeros(len(track), np.int64)
            if track.track_id in self.target:
                is_target[:] = [frame not in taken for frame in track.frame.tolist()]
                taken.update(track.frame.tolist())
            numbers = np.full(len(track), track.track_id)
            columns.append(np.column_stack([track.frame, track.xy_px, track.sigma_px, numbers, is_target]))
        table = np.vstack([np.zeros((0, 6)), *columns])
        table = table[np.lexsort((table[:, 4], table[:, 0]))]
        time_s = np.interp(table[:, 0], self.frame, self.time_s) if len(self.frame) else table[:, 0]
        frame, number, target = (table[:, k].astype(np.int64) for k in (0, 4, 5))
        return TrackRows(frame, time_s, table[:, 1:3], table[:, 3], number, target)

    def about(self) -> dict[str, Any]:
        """Plain values for people and machines."""
        return {
            "video": self.info.path.name,
            "method": self.method,
            "size_px": list(self.info.size_px),
            "rotation_deg": self.info.rotation_deg,
            "created": None if self.info.created is None else self.info.created.isoformat(),
            "frames": self.n_frames,
            "rate_hz": self.rate_hz,
            "begin_s": float(self.time_s[0]),
            "end_s": float(self.time_s[-1]),
            "on_target": int(self.rows().target.sum()),
            "view_moved_px": round(self.view_moved_px, 2),
            "warnings": list(self.warnings),
            "tracks": [_about_track(t, self.target, self.frame, self.time_s) for t in self.tracks],
        }


def detect_video(
    path: Path,
    method: Method = "tophat",
    mask: LumaArray | None = None,
    on_frame: Callable[[Frame], None] = lambda frame: None,
    frame_threads: int = 1,
) -> DetectedVideo:
    """Detect and track everything that moves through a video.

    `mask` (height, width) is zero where nothing is to be found. `on_frame` is given every frame before it is looked
    at. Raises InputError where nothing of the video can be read or the mask has another size.
    """
    info = open_video(path)
    if mask is not None:
        check_mask(mask, info.size_px)
    rate_hz = info.nominal_rate_hz or _ASSUMED_RATE_HZ
    follower = Follower(info.size_px, rate_hz, method, mask)
    warnings: list[VideoWarning] = []
    time_s, index = array("d"), array("d")
    for frame in read_frames(path, on_warning=warnings.append, frame_threads=frame_threads):
        on_frame(frame)
        follower.step(frame.index, frame.luma)
        time_s.append(frame.time_s)
        index.append(frame.index)
    tracks = follower.finish()
    messages = [w.message for w in warnings]
    if follower.turned:
        moved = f"its view moved by up to {follower.view_moved_px:.0f} px"
        messages.append(f"the camera turned: {moved}; reconstruct takes cameras to stand still")
    if not tracks:
        messages.append("nothing was found that moves like a target")
    return DetectedVideo(
        info,
        method,
        len(index),
        rate_hz,
        tracks,
        choose_target(tracks, info.size_px[0], rate_hz),
        np.array(time_s),
        np.array(index),
        follower.view_moved_px,
        tuple(messages),
    )


def detector_identity(method: Method) -> str:
    """What decides the result beside the video: the method, its version and its settings."""
    from skytrace.vision.detect import DetectorSettings
    from skytrace.vision.judge import TrackerSettings

    settings = DetectorSettings() if method == "tophat" else ""
    return f"{method} {_VERSION} {settings} {TrackerSettings()}"


def read_mask(path: Path) -> LumaArray:
    """A mask (height, width) from a picture file: black, and what is see-through, is where nothing is to be found."""
    import cv2

    if not path.is_file():
        raise InputError(path, "no such picture file")
    picture = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_UNCHANGED) if path.stat().st_size else None
    if picture is None:
        raise InputError(path, "cannot be read as a picture: expected PNG or JPEG")
    bright = picture if picture.ndim == 2 else picture[..., : min(3, picture.shape[2])].max(axis=2)
    shown = bright > 0
    if picture.ndim == 3 and picture.shape[2] == 4:
        shown &= picture[..., 3] > 0
    return shown.astype(np.uint8)


def check_mask(mask: LumaArray, size_px: tuple[int, int]) -> None:
    """Raise InputError where a mask (height, width) is not as large as a video's pictures."""
    height, width = mask.shape
    if (width, height) != size_px:
        expected = f"{size_px[0]} x {size_px[1]}"
        raise InputError("--mask", f"expected a picture of the video's size {expected}, got {width} x {height}")


def _about_track(track: FoundTrack, target: frozenset[int], frame: FloatArray, time_s: FloatArray) -> dict[str, Any]:
    begin_s, end_s = np.interp(track.frame[[0, -1]], frame, time_s)
    return {
        "id": track.track_id,
        "target": track.track_id in target,
        "detections": len(track),
        "begin_s": round(float(begin_s), 6),
        "end_s": round(float(end_s), 6),
        "quality": round(track.quality, 3),
        "size_px": round(track.size_px, 1),
        "contrast": round(track.contrast, 1),
    }


def expected_frames(info: VideoInfo) -> int | None:
    """About how many frames a video has, where its file tells."""
    rate_hz = info.average_rate_hz or info.nominal_rate_hz
    return None if rate_hz is None or info.duration_s is None else max(1, round(rate_hz * info.duration_s))
