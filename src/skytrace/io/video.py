"""Videos as a stream of luma pictures with their times: decoded once, in order, in memory that does not grow."""

from __future__ import annotations

import heapq
import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from av.container import InputContainer
from av.error import FFmpegError
from av.packet import Packet
from av.video.frame import VideoFrame
from av.video.stream import VideoStream
from numpy.typing import NDArray

from skytrace.errors import InputError
from skytrace.io.video_info import (
    NO_FRAMES,
    NO_TIME_STAMPS,
    VideoInfo,
    frame_times,
    open_video,
    opened,
    seconds,
    stream_duration_s,
)

__all__ = ["Frame", "VideoInfo", "VideoWarning", "frame_times", "open_video", "read_frames"]

LumaArray = NDArray[np.uint8]

_QUIET_S = 1.0  # damage in shorter intervals is reported as one
# Layouts whose luma is a plane of its own, one byte or one 16-bit word a pixel.
_PLANAR_LUMA = ("yuv", "gray", "nv12", "nv16", "nv21", "nv24", "nv42")


@dataclass(frozen=True, eq=False, slots=True)
class Frame:
    """One picture. `luma` looks into the decoder's own memory, which lives as long as the array does."""

    index: int  # 0-based in presentation order
    time_s: float  # the container's time stamp
    luma: LumaArray  # (height, width) read-only, rows as the sensor recorded them; see VideoInfo.full_range


@dataclass(frozen=True, slots=True)
class VideoWarning:
    """A part of a video that could not be read."""

    path: Path
    time_s: float  # of the last frame before it
    message: str  # names that time

    def __str__(self) -> str:
        return f"{self.path}: {self.message}"


def warn(warning: VideoWarning) -> None:
    """Report through Python's warnings."""
    warnings.warn(str(warning), stacklevel=3)


def read_frames(
    path: Path | str, *, on_warning: Callable[[VideoWarning], None] = warn, frame_threads: int = 1
) -> Iterator[Frame]:
    """Decode a video's frames in presentation order.

    Times are pts * time_base, as the container keeps them: they need not begin at zero nor be evenly spaced. Luma of
    more than 8 bits is cut to 8. Of interlaced frames the field of the even rows is kept, its rows between them
    interpolated: all rows of a picture then belong to one time. What is damaged or missing is left out and reported to
    `on_warning`; the frames keep their indices. More than one of `frame_threads` is sooner done, for some percent more
    work in all, and holds that many pictures more; the frames are the same.

    Raises InputError where there is no file, no video in it, or not one frame that can be decoded.
    """
    path = Path(path)
    with opened(path, frame_threads) as (container, stream):
        yield from _Reader(path, container, stream, on_warning).frames()


class _Reader:
    """Follows one video from its first frame to its last."""

    def __init__(
        self, path: Path, container: InputContainer, stream: VideoStream, on_warning: Callable[[VideoWarning], None]
    ) -> None:
        self._path, self._container, self._stream, self._on_warning = path, container, stream, on_warning
        self._waiting: list[int] = []  # heap of the time stamps that went in and did not come out yet
        self._stamped = False  # packets have time stamps
        self._suspect: set[int] = set()  # time stamps of packets known to be incomplete
        self._broken = False  # no packet can be found from some place on
        self._set_back = 0  # packets whose clock runs behind that of the packets before them
        self._index = -1
        self._begin_s = self._last_s = self._longest_s = 0.0
        self._size: tuple[int, int] | None = None
        self._damage_s: tuple[float, float] | None = None  # from the last good frame before to the first behind

    def frames(self) -> Iterator[Frame]:
        for picture in self._decoded():
            if picture.pts is None and self._size is None:
                raise InputError(self._path, NO_TIME_STAMPS)
            time_s = -np.inf if picture.pts is None else seconds(picture.pts, self._stream)
            missing = self._count(picture.pts, picture.interlaced_frame)
            unusable = missing is None or picture.is_corrupt or picture.pts in self._suspect
            unusable |= self._size is not None and time_s <= self._last_s
            if missing != 0 or unusable:
                self._damaged(max(time_s, self._last_s))
            if unusable:
                continue
            size = (picture.width, picture.height)
            if self._size is None:
                self._size, self._begin_s = size, time_s
            elif size != self._size:
                self._report(f"the picture's size changes from {self._size} to {size}; the rest is not read")
                return
            elif not missing:
                self._longest_s = max(self._longest_s, time_s - self._last_s)
            if self._damage_s is not None and time_s > self._damage_s[1] + _QUIET_S:
                self._end_damage()
            self._last_s = time_s
            yield Frame(self._index, time_s, luma_of(picture))
        if self._size is None:
            raise InputError(self._path, NO_FRAMES)
        self._check_end()

    def _decoded(self) -> Iterator[VideoFrame]:
        """Whatever the decoder makes of the packets there are."""
        for packet in self._packets():
            try:
                pictures = self._stream.codec_context.decode(packet)
            except FFmpegError:
                continue  # what did not come out is missed by its time stamp
            for picture in pictures:
                assert isinstance(picture, VideoFrame)
                yield picture

    def _packets(self) -> Iterator[Packet | None]:
        """The packets up to the end or the first that cannot be found, then none: the decoder's rest is asked for."""
        last_dts = -math.inf
        try:
            for packet in self._container.demux(self._stream):
                if not packet.size:  # stands for a frame the camera dropped
                    continue
                if packet.dts is not None:
                    if packet.dts < last_dts:
                        self._set_back += 1
                        continue
                    last_dts = packet.dts
                if packet.pts is not None and not packet.is_discard and packet.pts not in self._waiting:
                    heapq.heappush(self._waiting, packet.pts)
                    self._stamped = True
                    if packet.is_corrupt:
                        self._suspect.add(packet.pts)
                yield packet
        except FFmpegError:
            self._broken = True
        yield None

    def _count(self, stamp: int | None, interlaced: bool) -> int | None:
        """Step to the index of the frame with a time stamp; how many frames before it never came out of the decoder.

        None for a frame the decoder made up to fill a hole.
        """
        passed = 0
        while stamp is not None and self._waiting and self._waiting[0] <= stamp:
            heapq.heappop(self._waiting)
            passed += 1
        if passed == 0 and self._stamped:
            return None
        # The two fields of an interlaced frame can be two packets.
        missing = 0 if interlaced else max(passed - 1, 0)
        self._index += 1 + missing
        return missing

    def _damaged(self, until_s: float) -> None:
        begin_s = self._last_s if self._damage_s is None else self._damage_s[0]
        self._damage_s = (begin_s, max(until_s, begin_s))

    def _end_damage(self) -> None:
        if self._damage_s is not None:
            begin_s, end_s = self._damage_s
            self._damage_s = None
            if end_s > begin_s:
                self._report(f"damaged between {begin_s:.3f} s and {end_s:.3f} s: frames there are missing", begin_s)

    def _check_end(self) -> None:
        """Report damage up to the end, an end before the declared one, and what was joined to the end."""
        declared_s = stream_duration_s(self._stream)
        # The last frame is shown about as long as others.
        read_s = self._last_s - self._begin_s + 2 * self._longest_s
        self._end_damage()
        if self._broken or self._waiting or (declared_s is not None and read_s < declared_s):
            declared = "" if declared_s is None else f"; it should last {declared_s:.3f} s"
            self._report(f"cut off or damaged: nothing can be read after {self._last_s:.3f} s{declared}")
        if self._set_back:
            what = f"time stamps jump back, at last after {self._last_s:.3f} s, as where files were joined"
            self._report(f"{what}: {self._set_back} frames are not read; split the file there")

    def _report(self, message: str, time_s: float | None = None) -> None:
        self._on_warning(VideoWarning(self._path, self._last_s if time_s is None else time_s, message))


def luma_of(picture: VideoFrame) -> LumaArray:
    """Brightness (height, width) of a decoded picture: a view of its memory where that holds one byte a pixel."""
    first = picture.format.components[0]
    name, bits = picture.format.name, first.bits
    in_place = name.startswith(_PLANAR_LUMA) and picture.format.is_planar and not name.endswith("be")
    if not in_place:
        picture, bits = picture.reformat(format="gray"), 8
    plane = picture.planes[0]
    word = np.dtype(np.uint8 if bits == 8 else "<u2")
    rows = np.frombuffer(memoryview(plane), word)  # type: ignore[arg-type]
    rows = rows.reshape(-1, plane.line_size // word.itemsize)
    recorded: NDArray = rows[: picture.height, : picture.width]
    luma = recorded if bits == 8 else (recorded >> (bits - 8)).astype(np.uint8)
    if picture.interlaced_frame:
        luma = _even_field(luma)
    luma.flags.writeable = False
    return luma


def _even_field(luma: LumaArray) -> LumaArray:
    """The field of the even rows, the odd rows the mean of their neighbours."""
    out = luma.copy()
    above, below = luma[0:-2:2], luma[2::2]
    n = len(below)
    out[1 : 2 * n : 2] = (above[:n] & below) + ((above[:n] ^ below) >> 1)
    if len(luma) % 2 == 0:
        out[-1] = luma[-2]
    return out
