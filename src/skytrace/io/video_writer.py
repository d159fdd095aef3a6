"""Videos written frame by frame, every frame with its own time stamp."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from types import TracebackType

import av
import numpy as np
from av.video.frame import VideoFrame
from numpy.typing import NDArray

TICKS_PER_S = 90000  # of the time stamps: frame intervals of all common rates are whole numbers of it

# The encoder's result depends on its number of threads.
_THREADS = 2


class VideoWriter:
    """An H.264 file (yuv420p, limited range), to be used in a `with` block.

    `rate_hz` is the nominal rate that the file states; `quality` x264's constant rate factor, 0 lossless, 18 to 28 what
    cameras record; `effort` its preset.
    """

    def __init__(
        self, path: Path, size_px: tuple[int, int], rate_hz: float, quality: int = 20, effort: str = "superfast"
    ) -> None:
        if size_px[0] % 2 or size_px[1] % 2:
            raise ValueError(f"size_px: expected an even width and height, got {size_px}")
        self._container = av.open(str(Path(path).absolute()), "w")
        rate = Fraction(rate_hz).limit_denominator(1001)
        self._stream = self._container.add_stream("libx264", rate=rate)
        self._stream.width, self._stream.height = size_px
        self._stream.pix_fmt = "yuv420p"
        self._stream.time_base = self._stream.codec_context.time_base = Fraction(1, TICKS_PER_S)
        self._stream.codec_context.thread_type = "FRAME"
        self._stream.codec_context.thread_count = _THREADS
        self._stream.options = {"preset": effort, "crf": str(quality)}
        self._size_px = size_px

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        try:
            if kind is None:
                self._container.mux(self._stream.encode(None))
        finally:
            self._container.close()

    def write(self, ticks: int, luma: NDArray, blue: NDArray, red: NDArray) -> None:
        """Append a frame at a time in ticks: luma (h, w) and both chroma planes (h/2, w/2), all uint8."""
        frame = VideoFrame(*self._size_px, "yuv420p")
        for plane, values in zip(frame.planes, (luma, blue, red), strict=True):
            rows = np.frombuffer(memoryview(plane), np.uint8)  # type: ignore[arg-type]
            rows.reshape(-1, plane.line_size)[: values.shape[0], : values.shape[1]] = values
        frame.pts, frame.time_base = ticks, Fraction(1, TICKS_PER_S)
        self._container.mux(self._stream.encode(frame))
