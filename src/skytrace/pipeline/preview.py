"""Pictures of what was found in a video, written to files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from skytrace.io.video import read_frames
from skytrace.pipeline.detect import DetectedVideo

if TYPE_CHECKING:
    from skytrace.vision.preview import Sample

_QUALITY = 26  # x264's constant rate factor


def write_sheet(path: Path, detected: DetectedVideo, samples: Sequence[Sample]) -> None:
    """A contact sheet of the samples as a PNG."""
    import cv2

    from skytrace.vision.preview import contact_sheet

    title = f"{detected.info.path.name}: {len(detected.tracks)} tracks; the target's are green"
    sheet = contact_sheet(samples, detected.tracks, detected.target, title)
    written, data = cv2.imencode(".png", sheet)
    assert written  # any picture can be a PNG
    path.write_bytes(data.tobytes())


def write_overlay(path: Path, detected: DetectedVideo, on_frame: Callable[[int, bool], None]) -> None:
    """The video once more with its tracks drawn over it, frame by frame with the times it had."""
    from skytrace.io.video_writer import TICKS_PER_S, VideoWriter
    from skytrace.vision.preview import Overlay

    overlay = Overlay(detected.tracks, detected.target, detected.info.size_px, detected.rate_hz)
    begin_s, last, done = float(detected.time_s[0]), -1, 0
    with VideoWriter(path, overlay.size_px, detected.rate_hz, _QUALITY) as writer:
        # What could not be read was said when it was read for the first time.
        for frame in read_frames(detected.info.path, on_warning=lambda warning: None):
            last = max(round((frame.time_s - begin_s) * TICKS_PER_S), last + 1)
            writer.write(last, *overlay.draw(frame.luma, frame.index))
            done += 1
            on_frame(done, False)
    on_frame(done, True)
