"""Time stamps of frames: rows `frame time_s` and what ffprobe prints, with every mistake's line."""

from __future__ import annotations

import io
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from skytrace.errors import InputError
from skytrace.io.timestamps import read_timestamps, typical_rate_hz, wrong_unit


def write(folder: Path, text: str) -> Path:
    (folder / "times.txt").write_text(text)
    return folder / "times.txt"


@pytest.mark.parametrize(
    ("text", "frames", "times"),
    [
        ("3 0.1\n4 0.14\n9 0.3\n", [3, 4, 9], [0.1, 0.14, 0.3]),
        ("frame,time_s\n0,0.0\n1,0.04\n", [0, 1], [0.0, 0.04]),
        ("time_s;frame\n0.5;7\n0.6;8\n", [7, 8], [0.5, 0.6]),
        ("frame timestamp\n0 1714731300.25\n1 1714731300.29\n", [0, 1], [1714731300.25, 1714731300.29]),
        ("frame,time_s,x_px,y_px\n5,0.2,10,20\n6,0.24,11,20\n", [5, 6], [0.2, 0.24]),
        ("0 0.0\n1 0.04\n2 0.04\n3 0.12\n", [0, 1, 2, 3], [0.0, 0.04, 0.04, 0.12]),  # a repeated and a dropped frame
        # ffprobe -of csv=p=0
        ("0.000000\n0.033367\n0.066733\n", [0, 1, 2], [0.0, 0.033367, 0.066733]),
        ("0.000000,\n0.033367,\n\n0.066733\n", [0, 1, 2], [0.0, 0.033367, 0.066733]),
        ("0.000000,side_data,Skip Samples\n0.033367\n", [0, 1], [0.0, 0.033367]),
        ("-0.033367\n0.000000\n", [0, 1], [-0.033367, 0.0]),
        ("0.0\nN/A\n0.08\n", [0, 2], [0.0, 0.08]),
        ("N/A\n0.04\n0.08\n", [1, 2], [0.04, 0.08]),
        ("0.0\n0.04\n0.04\n0.2\n", [0, 1, 2, 3], [0.0, 0.04, 0.04, 0.2]),
        # Packets with B-frames: in decode order I P B B
        ("0.00\n0.12\n0.04\n0.08\n0.24\n0.16\n0.20\n", list(range(7)), [0.04 * k for k in range(7)]),
        # ffprobe -of csv
        ("packet,0.000000\npacket,0.040000,\n", [0, 1], [0.0, 0.04]),
        ("frame,0.000000\nframe,0.040000\n", [0, 1], [0.0, 0.04]),
        # ffprobe, default format
        (
            "[PACKET]\npts_time=0.000000\n[/PACKET]\n[PACKET]\npts_time=0.080000\n[SIDE_DATA]\nside_data_type=x y\n"
            "[/SIDE_DATA]\n[/PACKET]\n[PACKET]\npts_time=0.040000\n[/PACKET]\n",
            [0, 1, 2],
            [0.0, 0.04, 0.08],
        ),
        (
            "[FRAME]\nmedia_type=video\npts_time=N/A\nbest_effort_timestamp_time=0.5\n[/FRAME]\n"
            "[FRAME]\nmedia_type=audio\npts_time=0.1\nbest_effort_timestamp_time=0.1\n[/FRAME]\n"
            "[FRAME]\nmedia_type=video\npts_time=0.9\nbest_effort_timestamp_time=0.9\n[/FRAME]\n",
            [0, 1],
            [0.5, 0.9],
        ),
        ("[FRAME]\npkt_pts_time=0.5\n[/FRAME]\n[FRAME]\npkt_pts_time=0.6\n[/FRAME]\n", [0, 1], [0.5, 0.6]),
        ("pts_time=0.000000\npts_time=0.033333\n", [0, 1], [0.0, 0.033333]),
        ("[FRAME]\npts_time=0.0\n[/FRAME]\n[FRAME]\n[/FRAME]\n[FRAME]\npts_time=0.2\n[/FRAME]\n", [0, 2], [0.0, 0.2]),
    ],
)
def test_what_is_read(tmp_path, text, frames, times):
    got = read_timestamps(write(tmp_path, text))
    assert got.frame.tolist() == frames
    np.testing.assert_allclose(got.time_s, times, atol=1e-12, rtol=0)
    assert read_timestamps(write(tmp_path, text.replace("\n", "\r\n"))).time_s.tolist() == got.time_s.tolist()


def test_listings_are_of_the_whole_video_and_rows_need_not_be(tmp_path):
    assert read_timestamps(write(tmp_path, "0.0\n0.04\n")).complete
    assert not read_timestamps(write(tmp_path, "0 0.0\n1 0.04\n")).complete


ORDERED = "".join(f"{0.04 * k:.6f}\n" for k in range(100))


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("0 0.0\n1.5 0.04\n", 2, "a whole frame number, got 1.5"),
        ("0 0.0\n1 nan\n", 2, "a finite time_s"),
        ("0 0.0\n2 0.04\n1 0.08\n", 3, "frame to rise from row to row, got 1 after 2"),
        ("0 0.0\n1 0.04\n1 0.08\n", 3, "frame to rise"),
        ("0 0.0\n1 0.04\n2 0.03\n", 3, "time_s not to fall from row to row, got 0.03 after 0.04"),
        ("0 0.0 7\n1 0.04 7\n", 1, "one time a line as ffprobe lists them, got 3 columns"),
        ("n,seconds\n0,0.0\n", 1, "expected columns named frame and time_s"),
        ("0 0.0\n1\n", 2, "2 columns"),
        ("frame,time_s\n", None, "a header and no rows"),
        ("", None, "empty"),
        # listings
        ("0.0\n0.04\nO.08\n", 3, "expected one time in seconds a line, got 'O.08'"),
        ("0.0\n0.04 0.08\n", 2, "expected one time in seconds a line"),
        ("0.0\nnan\n", 2, "expected one time in seconds a line"),
        ("N/A\nN/A\n", 1, "no frame has a time"),
        ("0.0\n0.08\n0.04\nN/A\n0.16\n", 4, "N/A in a list that is not in order of time"),
        ("packet,0.0,0.0\npacket,0.04,0.04\n", 1, "columns"),
        ("[PACKET]\ndts_time=0.0\n[/PACKET]\n", 1, "got dts_time"),
        ("[PACKET]\n[/PACKET]\n", 1, "got no key"),
        ("[PACKET]\npts_time=0.0\n[/PACKET]\n[PACKET]\npts_time=zero\n[/PACKET]\n", 5, "got 'zero'"),
        ("pts_time=0.0\n0.04\n", 2, "expected key=value, got '0.04'"),
        ("frame,0.0\nframe,0.08\nframe,0.04\n", 3, "in order of presentation"),
        ("[FRAME]\npts_time=0.2\n[/FRAME]\n[FRAME]\npts_time=0.1\n[/FRAME]\n", 5, "steps back from 0.2 to 0.1 s"),
        ("best_effort_timestamp_time=0.2\nbest_effort_timestamp_time=0.1\n", 2, "steps back"),
        # A second file appended, or a clock set back by seconds: not how B-frames are ordered.
        (ORDERED + ORDERED, 101, "steps back from 3.96 to 0 s, further than a video's frames are reordered"),
    ],
)
def test_a_mistake_is_named_with_its_line(tmp_path, text, line, words):
    with pytest.raises(InputError) as caught:
        read_timestamps(write(tmp_path, text))
    assert caught.value.path == str(tmp_path / "times.txt")
    assert caught.value.line == line
    assert words in caught.value.message


def test_packets_of_a_real_video_with_b_frames_are_put_in_order_of_presentation(tmp_path):
    """An encoder's own decode order and uneven times, listed as ffprobe would."""
    av = pytest.importorskip("av")
    steps = np.random.default_rng(3).integers(20, 60, 40)
    stamps = np.cumsum(steps)  # milliseconds
    file = io.BytesIO()
    with av.open(file, "w", format="matroska") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width = stream.height = 64
        stream.pix_fmt, stream.time_base = "yuv420p", Fraction(1, 1000)
        stream.codec_context.time_base = Fraction(1, 1000)
        stream.options = {"bf": "3", "b-adapt": "0"}
        for k, stamp in enumerate(stamps):
            picture = np.full((64, 64, 3), 5 * k, np.uint8)
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts, frame.time_base = int(stamp), Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    file.seek(0)
    with av.open(file) as container:
        packets = [float(p.pts * p.time_base) for p in container.demux(video=0) if p.pts is not None]
    assert (np.diff(packets) < 0).any()
    got = read_timestamps(write(tmp_path, "".join(f"{t:.6f},\n" for t in packets)))
    np.testing.assert_allclose(got.time_s, stamps / 1000, atol=1e-6)


def test_the_typical_rate_is_that_of_most_neighbours():
    frame = np.array([0, 1, 2, 3, 10, 11, 12])
    time_s = np.array([0.0, 0.04, 0.08, 0.08, 0.4, 0.44, 0.48])
    assert typical_rate_hz(frame, time_s) == pytest.approx(25)
    order = np.array([3, 0, 6, 2, 1, 5, 4])
    assert typical_rate_hz(frame[order], time_s[order]) == pytest.approx(25)
    assert typical_rate_hz(np.array([4]), np.array([0.1])) is None
    assert typical_rate_hz(np.array([4, 5]), np.array([0.1, 0.1])) is None


@pytest.mark.parametrize(
    ("stamped_hz", "nominal_hz", "words"),
    [
        (0.03, 30.0, "look like milliseconds, expected seconds"),
        (0.03, None, "look like milliseconds"),
        (3e-5, 30.0, "look like microseconds"),
        (3e-8, None, "look like nanoseconds"),
        (1 / 3003, 29.97, "look like ticks of 1/90000 s"),
        (0.1, 30.0, "0.1 frames a second where 30 are nominal: expected seconds"),
        (5e4, None, "expected seconds"),
    ],
)
def test_time_stamps_in_another_unit_are_named(stamped_hz, nominal_hz, words):
    assert words in (wrong_unit(stamped_hz, nominal_hz) or "")


@pytest.mark.parametrize(("stamped_hz", "nominal_hz"), [(30, 30), (30, 240), (30, 960), (24, None), (1000, None)])
def test_slow_motion_is_no_mistake_of_unit(stamped_hz, nominal_hz):
    assert wrong_unit(stamped_hz, nominal_hz) is None
