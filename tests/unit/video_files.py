"""Tiny video files with chosen properties."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np


def ramp(n: int, size_px: tuple[int, int] = (64, 48)) -> list[np.ndarray]:
    """Luma pictures (h, w) with a bright square that moves from left to right."""
    width, height = size_px
    out = []
    for k in range(n):
        luma = np.full((height, width), 60, np.uint8)
        left = (3 * k) % (width - 8)
        luma[height // 2 : height // 2 + 8, left : left + 8] = 200
        out.append(luma)
    return out


def write_video(
    path: Path,
    pictures: Sequence[np.ndarray],
    *,
    pts: Sequence[int] | None = None,
    time_base: Fraction = Fraction(1, 1000),
    codec: str = "libx264",
    pixel_format: str = "yuv420p",
    options: Mapping[str, str] | None = None,
    container_options: Mapping[str, str] | None = None,
    full_range: bool = False,
    rotation_deg: int = 0,
    metadata: Mapping[str, str] | None = None,
) -> Path:
    """Encode luma pictures (h, w), or (h, w) uint16 of a 10-bit format; 25 frames a second unless pts are given."""
    height, width = pictures[0].shape
    if pts is None:
        pts = [40 * k for k in range(len(pictures))]
    with av.open(str(path), "w", options=dict(container_options or {})) as container:
        container.metadata.update(metadata or {})
        stream = container.add_stream(codec, rate=Fraction(1) / time_base, options=dict(options or {}))
        stream.width, stream.height, stream.pix_fmt = width, height, pixel_format
        stream.codec_context.time_base = time_base
        if full_range:
            stream.codec_context.color_range = 2
        if rotation_deg:
            stream.set_display_rotation(rotation_deg)
        for stamp, luma in zip(pts, pictures, strict=True):
            frame = frame_of(luma, pixel_format)
            frame.pts, frame.time_base = stamp, time_base
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def frame_of(luma: np.ndarray, pixel_format: str) -> av.VideoFrame:
    """A grey frame whose luma plane holds a picture exactly."""
    height, width = luma.shape
    frame = av.VideoFrame(width, height, pixel_format)
    for k, plane in enumerate(frame.planes):
        row_bytes = plane.line_size
        content = np.full((plane.height, row_bytes // luma.itemsize), 128 << (2 * (luma.itemsize - 1)), luma.dtype)
        if k == 0:
            content[:, :width] = luma
        plane.update(content.tobytes().ljust(plane.buffer_size, b"\0"))
    return frame


def write_sound(path: Path) -> Path:
    """A second of silence."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=44100)
        for _ in range(40):
            frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
            frame.sample_rate = 44100
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def write_empty(path: Path) -> Path:
    """A video stream without a frame."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        container.start_encoding()
    return path
