"""What a video file says of itself, found without reading it to its end."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path

import av
import numpy as np
from av.container import InputContainer
from av.error import FFmpegError
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from skytrace.errors import InputError
from skytrace.geometry.arrays import FloatArray

# Frames from whose time stamps the rate and its constancy are judged: ten seconds of ordinary video.
_PROBED_FRAMES = 300
NO_FRAMES = "no frame of its video can be decoded: it is empty or damaged; copy it from the camera again"
NO_TIME_STAMPS = "its video has no time stamps: convert it to MP4 or MKV, which keep them"
_SLICES = 4  # of a picture, decoded at once
_FULL_RANGE = 2  # AVCOL_RANGE_JPEG
_INTERLACED_ORDERS = (2, 3, 4, 5)  # AV_FIELD_TT and what follows
_ATTACHED_PICTURE = 0x0400  # AV_DISPOSITION_ATTACHED_PIC


@dataclass(frozen=True, slots=True)
class VideoInfo:
    """A video as its file describes it. Sizes and pixels are the sensor's: no rotation is applied anywhere."""

    path: Path
    size_px: tuple[int, int]  # width, height as stored
    nominal_rate_hz: float | None  # what most frames follow; none where fewer than two frames have time stamps
    average_rate_hz: float | None  # frames by duration, where the container declares both
    variable_rate: bool  # the first ten seconds do not keep to one frame interval
    start_s: float  # the container's time of the first frame
    duration_s: float | None  # as declared; none where the container does not say
    rotation_deg: int  # how far players turn the picture clockwise: 0, 90, 180 or 270
    created: datetime | None  # by the camera's own clock, which may be wrong, or mean the end of the recording
    codec: str
    bit_depth: int  # of the luma
    full_range: bool  # luma uses 0 to 255; otherwise black is 16 and white 235
    interlaced: bool


def open_video(path: Path | str) -> VideoInfo:
    """Describe a video file, having decoded its first frame.

    Raises InputError where there is no file, no video in it, or not one frame that can be decoded.
    """
    path = Path(path)
    with opened(path) as (container, stream):
        frame = _first_frame(container, stream)
        if frame is None:
            raise InputError(path, NO_FRAMES)
        frame_format, codec = frame.format, stream.codec_context
        order = int(getattr(codec, "field_order", 0))
        start_s = 0.0 if frame.pts is None else seconds(frame.pts, stream)
        duration_s = stream_duration_s(stream)
        if duration_s is None and container.duration is not None:
            duration_s = container.duration / av.time_base
        described = {
            "size_px": (frame.width, frame.height),
            "start_s": start_s,
            "duration_s": duration_s,
            "rotation_deg": _rotation_deg(frame, stream),
            "created": _creation_time(container, stream),
            "codec": codec.name,
            "bit_depth": frame_format.components[0].bits,
            "full_range": int(frame.color_range) == _FULL_RANGE or frame_format.name.startswith("yuvj"),
            "interlaced": bool(frame.interlaced_frame) or order in _INTERLACED_ORDERS,
        }
    with opened(path) as (container, stream):
        probed_s = _packet_times(container, stream, _PROBED_FRAMES)
        n_declared, declared_hz = stream.frames, float(stream.average_rate or 0)
        tick_s = float(stream.time_base or 0)
    nominal_hz, variable = _rate(probed_s, declared_hz, tick_s)
    average_hz = n_declared / duration_s if n_declared and duration_s else None
    return VideoInfo(
        path=path, nominal_rate_hz=nominal_hz, average_rate_hz=average_hz, variable_rate=variable, **described
    )


def frame_times(path: Path | str) -> FloatArray:
    """Times (n,) in seconds of all frames in presentation order, on the container's clock, without decoding.

    They are those that `skytrace.io.video.read_frames` gives of an undamaged file. Raises InputError like
    `open_video`, and where the container keeps no time stamps.
    """
    path = Path(path)
    with opened(path) as (container, stream):
        times_s = _packet_times(container, stream)
    if len(times_s) == 0:
        raise InputError(path, NO_TIME_STAMPS)
    return times_s


@contextmanager
def opened(path: Path, frame_threads: int = 1) -> Iterator[tuple[InputContainer, VideoStream]]:
    """The container and its main video stream.

    Several threads share the slices of a picture, where the camera wrote several: this costs nothing. More than one
    frame thread decodes as many pictures at once, of any file: sooner done, for some percent more work in all.
    """
    if not path.exists():
        raise InputError(path, "no such video file")
    if not path.is_file():
        raise InputError(path, "is not a file: expected a video")
    try:
        # An absolute path cannot be mistaken for a protocol.
        container = av.open(str(path.absolute()), metadata_errors="replace")
    except (FFmpegError, OSError) as error:
        raise InputError(path, _why_not_opened(path, error)) from None
    with container:
        assert isinstance(container, InputContainer)
        stream = _main_stream(path, container)
        stream.thread_type = "FRAME" if frame_threads > 1 else "SLICE"
        stream.codec_context.thread_count = frame_threads if frame_threads > 1 else min(os.cpu_count() or 1, _SLICES)
        yield container, stream


def seconds(stamp: int, stream: VideoStream) -> float:
    """A time stamp of a stream in seconds, rounded once."""
    return float(stamp * stream.time_base) if stream.time_base else float(stamp)


def stream_duration_s(stream: VideoStream) -> float | None:
    """How long a stream's own header says it is."""
    if stream.duration is not None:
        return seconds(stream.duration, stream)
    tag = stream.metadata.get("DURATION", "")  # Matroska
    if tag.count(":") != 2:
        return None
    hours, minutes, rest = tag.split(":")
    # FFmpeg writes the time of the end there, mkvmerge the time from begin to end.
    begin_s = 0.0 if stream.start_time is None else max(seconds(stream.start_time, stream), 0.0)
    return max(3600 * int(hours) + 60 * int(minutes) + float(rest) - begin_s, 0.0)


def _why_not_opened(path: Path, error: Exception) -> str:
    if isinstance(error, PermissionError):
        return "cannot be read: no permission"
    with path.open("rb") as file:
        head = file.read(12)
    if not head:
        return "is empty: copy it from the camera again"
    if head[4:8] == b"ftyp":
        return (
            "has no index, as after a recording or copy that was cut off: copy it from the camera again, "
            "or repair it with a tool that rebuilds the index of MP4 files"
        )
    return "is not a video that can be read: expected a file such as MP4, MOV, MKV or AVI"


def _main_stream(path: Path, container: InputContainer) -> VideoStream:
    # Text files are "videos" of the tty format, photographs of one frame of theirs.
    if container.format.name == "tty" or container.format.name.startswith("image2"):
        raise InputError(path, "is not a video: expected a file such as MP4, MOV, MKV or AVI")
    if container.format.name.endswith("_pipe"):
        raise InputError(path, "is a photograph, not a video: expected a file such as MP4, MOV, MKV or AVI")
    streams = [s for s in container.streams.video if not int(s.disposition) & _ATTACHED_PICTURE]
    if not streams:
        what = "only sound" if container.streams.audio else "no video"
        raise InputError(path, f"holds {what}: expected a file with a video stream")
    # Cameras put previews beside the recording.
    stream = max(streams, key=lambda s: s.codec_context.width * s.codec_context.height if s.codec_context else -1)
    if stream.codec_context is None:
        raise InputError(path, "its video has an unknown codec: convert it to H.264 in MP4, at its own frame times")
    return stream


def _first_frame(container: InputContainer, stream: VideoStream) -> VideoFrame | None:
    for packet in container.demux(stream):
        try:
            for frame in packet.decode():
                assert isinstance(frame, VideoFrame)
                return frame
        except FFmpegError:
            continue
    return None


def _packet_times(container: InputContainer, stream: VideoStream, limit: int | None = None) -> FloatArray:
    """Times (n,) of a stream's first packets in presentation order; what an edit list hides is left out."""
    packets = islice((p for p in container.demux(stream) if p.size and not p.is_discard), limit)
    times_s = sorted({seconds(packet.pts, stream) for packet in packets if packet.pts is not None})
    # The packets within reach of the limit may follow others that were not read yet.
    return np.array(times_s if limit is None or len(times_s) < limit else times_s[: -(limit // 10)])


def _rate(times_s: FloatArray, declared_hz: float, tick_s: float) -> tuple[float | None, bool]:
    """The rate most frames follow, and whether some do not."""
    if len(times_s) < 2:
        return None, False
    interval_s = np.diff(times_s)
    typical_s = float(np.median(interval_s))
    # Time stamps are rounded to the container's tick: a constant rate alternates between two neighbouring intervals.
    if (np.abs(interval_s - typical_s) > 1.5 * tick_s + 0.01 * typical_s).any():
        return 1 / typical_s, True
    measured_hz = len(interval_s) / float(times_s[-1] - times_s[0])
    # A declared rate is exact where it is true; some containers state their tick instead.
    true = abs(declared_hz / measured_hz - 1) < tick_s * measured_hz / len(interval_s) + 1e-6
    return declared_hz if true else measured_hz, False


def _rotation_deg(frame: VideoFrame, stream: VideoStream) -> int:
    if frame.rotation:
        return round(-frame.rotation / 90) * 90 % 360
    tag = stream.metadata.get("rotate", "")
    return round(int(tag) / 90) * 90 % 360 if tag.lstrip("-").isdecimal() else 0


def _creation_time(container: InputContainer, stream: VideoStream) -> datetime | None:
    for text in (container.metadata.get("creation_time"), stream.metadata.get("creation_time")):
        try:
            created = datetime.fromisoformat(text or "")
        except ValueError:
            continue
        # Cameras without a clock write the epoch of the format.
        if created.year > 1970:
            return created if created.tzinfo else created.replace(tzinfo=UTC)
    return None
