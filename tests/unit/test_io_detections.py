"""Detection files: every layout that is accepted, every mistake with its line."""

from __future__ import annotations

import time
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skytrace.errors import InputError
from skytrace.io.detections import parse_columns, read_detections

PIXEL = st.floats(-1e5, 1e5, allow_nan=False).map(lambda v: float(np.round(v, 6)))
ROWS = st.lists(st.tuples(st.integers(-1000, 10**9), PIXEL, PIXEL), min_size=1, max_size=30)


def write(folder: Path, text: str) -> Path:
    path = folder / "cam.txt"
    path.write_bytes(text.encode())
    return path


def refused(path: Path, columns: str | None = None) -> InputError:
    with pytest.raises(InputError) as caught:
        read_detections(path, columns)
    return caught.value


@pytest.mark.parametrize(
    ("columns", "text"),
    [
        ("x y frame", "10 20 5\n11.5 21 6\n"),
        ("frame x y", "5 10 20\n6 11.5 21\n"),
        ("frame,x,y", "5.000000 10 20\n6.000000 11.5 21\n"),
        ("x y frame", "10,20,5\r\n11.5,21,6\r\n"),
        ("x y frame", "10;20;5\n11.5 ; 21 ; 6"),
        ("x y frame", "10\t20\t5\n11.5\t21\t6\n"),
        ("x y frame", "  10\t 20  5 4000 1\n11.5  21\t6 17\n"),
        ("x y _ frame", "10 20 77 5\n11.5 21 78 6\n"),
        ("x_px y_px frame", "# comment\n\n10 20 5\n # another\n11.5 21 6 # at the end\n"),
        ("frame x y", " frame no.            x            y\n5 10 20\n6 11.5 21\n"),
        ("x y frame", "tracks of the first camera\nx y frame\n10 20 5\n11.5 21 6\n"),
        (None, " frame no.            x            y\n5 10 20\n6 11.5 21\n"),
        (None, "Frame,X,Y\n5,10,20\n6,11.5,21\n"),
        (None, '\ufeff"y_px","frame","area","x_px"\n"20","5","1","10"\n21,6,2,11.5\n'),
        (None, "frame\tarea size\tx\ty\n5\t1\t10\t20\n6\t2\t11.5\t21\n"),
    ],
)
def test_layouts_are_read_alike(tmp_path, columns, text):
    got = read_detections(write(tmp_path, text), columns)
    assert got.frame.tolist() == [5, 6]
    assert got.frame.dtype == np.int64
    assert got.xy_px.tolist() == [[10, 20], [11.5, 21]]
    assert got.sigma_px is None
    assert got.time_s is None


def test_file_order_and_lines_are_kept(tmp_path):
    got = read_detections(write(tmp_path, "# a\n1 2 9\n\n3 4 7\n3 4 7\n"), "x y frame")
    assert got.frame.tolist() == [9, 7, 7]
    assert got.line.tolist() == [2, 4, 5]


def test_output_of_skytrace_detect(tmp_path):
    text = (
        "frame,time_s,x_px,y_px,sigma_px,track_id,target\n"
        "3,0.10,7,8,0.5,2,0\n"
        "3,0.10,1.5,2.5,0.25,1,1\n"
        "4,0.15,2.5,3.5,0.3,1,1\n"
    )
    got = read_detections(write(tmp_path, text))
    assert got.frame.tolist() == [3, 4]
    assert got.sigma_px is not None
    assert got.sigma_px.tolist() == [0.25, 0.3]
    assert got.time_s is not None
    assert got.time_s.tolist() == [0.10, 0.15]
    assert got.n_other_target == 1


def test_rows_of_zeros_are_absent_and_counted(tmp_path):
    got = read_detections(write(tmp_path, "1 0.0 0.0\n2 0 5\n3 0 0\n"), "frame x y")
    assert got.frame.tolist() == [2]
    assert got.n_absent == 2


def test_a_camera_that_never_sees_the_target_is_no_mistake(tmp_path):
    got = read_detections(write(tmp_path, "1 0 0\n2 0 0\n"), "frame x y")
    assert len(got) == 0
    assert got.n_absent == 2


def test_positions_that_are_not_finite_are_left_to_cleaning(tmp_path):
    got = read_detections(write(tmp_path, "1,nan,3\n2,4,\n3,inf,6\n4,7,8\n"), "frame x y")
    assert np.isnan(got.x).tolist() == [True, True, True, False]
    assert got.frame.tolist() == [1, 2, 3, 4]


def test_infinite_positions_raise_no_warning(tmp_path):
    path = write(tmp_path, "".join(f"{k} inf {-k}\n" for k in range(12)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.isnan(read_detections(path, "frame x y").x).all()


@pytest.mark.parametrize(
    ("columns", "text", "line", "words"),
    [
        ("x y frame", "1 2 3\n4 five 6\n", 2, "expected a number for y, got 'five'"),
        ("x y frame", "1 2 3\n# c\n\n4 5 0x1f\n", 4, "expected a number for frame"),
        ("x y frame", "1 2 3\n4 5 1_0\n", 2, "got '1_0'"),
        ("x y frame", "1;2;3\n4,5;5;6\n", 2, "write decimals with a point"),
        ("x y frame", "1 2 3\n4 5\n", 2, "expected at least 3 columns (x y frame), got 2"),
        ("x y frame", "1 2\n4 5\n", 1, "expected at least 3 columns"),
        ("x y _ frame", "1 2 3 4\n4 5 6\n", 2, "expected at least 4 columns"),
        ("x y frame", "1 2 3\n4 5 6.5\n", 2, "whole frame number, got 6.5"),
        ("x y frame", "1 2 3\n4 5 nan\n", 2, "whole frame number"),
        ("x y frame", "1 2 3\n4 5 inf\n", 2, "whole frame number"),
        ("x y frame", "1 2 3\n4 5 1e17\n", 2, "whole frame number"),
        ("x,y,frame", "1,2,3\n4,5,\n", 2, "whole frame number"),
        ("x y frame sigma", "1 2 3 1\n4 5 6 0\n", 2, "positive sigma_px, got 0"),
        ("x y frame sigma_px", "1 2 3 1\n4 5 6 nan\n", 2, "positive sigma_px"),
        ("x y frame target", "1 2 3 1\n4 5 6 2\n", 2, "target 0 or 1"),
        ("x y frame time_s", "1 2 3 0.1\n4 5 6 nan\n", 2, "finite time_s"),
        ("x y frame time_s", "1 2 3 0.1\n4 5 6 0.05\n", 2, "time stamps must follow"),
        ("x y frame time_s", "1 2 3 0.1\n9 9 3 0.2\n", 2, "time stamps must follow"),
        ("frame x y", "x y frame\n1 2 3\n", 1, "column 1 is 'x' in the header, 'frame' in detections_columns"),
        (None, "1 2 3\n4 5 6\n", 1, "set detections_columns"),
        (None, "# only a comment\n1 2 3\n", 2, "set detections_columns"),
        (None, "bx by n\n1 2 3\n", 1, "no column 'frame' or 'x' or 'y'"),
        (None, "frame,x,x_px,y\n1,2,3,4\n", 1, "column 'x' is named twice"),
        (None, "frame,x,y,w,h\n1,2,3,4,5\n", 1, "centre"),
    ],
)
def test_a_mistake_is_named_with_its_line(tmp_path, columns, text, line, words):
    path = write(tmp_path, text)
    error = refused(path, columns)
    assert words in error.message
    assert error.line == line
    assert str(error).startswith(f"{path}:{line}: ")


def test_boxes_are_read_once_their_columns_are_declared(tmp_path):
    got = read_detections(write(tmp_path, "frame,x,y,w,h\n1,2,3,4,5\n"), "frame x y")
    assert got.xy_px.tolist() == [[2, 3]]


@pytest.mark.parametrize("text", ["", "\n \n", "# nothing\n", "frame,x,y\n"])
def test_an_empty_file_is_refused(tmp_path, text):
    assert "empty" in refused(write(tmp_path, text)).message or "no rows" in refused(write(tmp_path, text)).message


def test_files_that_are_no_text(tmp_path):
    assert "does not exist" in refused(tmp_path / "none.txt").message
    assert "folder" in refused(tmp_path).message
    video = tmp_path / "cam.mp4"
    video.write_bytes(b"1 2 3\n\x00\x00\x01ftyp")
    assert "binary" in refused(video, "x y frame").message
    video.write_bytes(b"1 2 3\n\xff\xfe\x80")
    error = refused(video, "x y frame")
    assert "not UTF-8" in error.message
    assert error.line == 2


@pytest.mark.parametrize("columns", ["x y", "x y frame x", "x y fram", "", "_ _ _"])
def test_wrong_declarations(tmp_path, columns):
    with pytest.raises(ValueError, match="column"):
        parse_columns(columns)
    assert "detections_columns" in refused(write(tmp_path, "1 2 3\n"), columns).message


def test_a_misspelt_column_is_suggested():
    with pytest.raises(ValueError, match="did you mean 'frame'"):
        parse_columns("x y fram")


def track(rng: np.random.Generator, n: int = 200) -> tuple[np.ndarray, np.ndarray]:
    """Frames with gaps and a pixel-quantised random walk."""
    frame = np.cumsum(rng.integers(1, 4, n))
    xy = np.round(500 + np.cumsum(rng.normal(0, 2, (n, 2)), axis=0))
    return frame, xy


def text_of(*columns: np.ndarray) -> str:
    return "\n".join(" ".join(f"{v:g}" for v in row) for row in zip(*columns, strict=True))


def test_swapped_columns_are_noticed(tmp_path, rng):
    frame, (x, y) = (t := track(rng))[0], t[1].T
    read_detections(write(tmp_path, text_of(x, y, frame)), "x y frame")
    assert "look swapped" in refused(write(tmp_path, text_of(x, y, frame)), "frame x y").message
    assert "look swapped" in refused(write(tmp_path, text_of(frame, x, y)), "x y frame").message
    absent = text_of(
        np.append(frame, frame[-1] + 1 + np.arange(300)), np.append(x, np.zeros(300)), np.append(y, np.zeros(300))
    )
    assert "look swapped" in refused(write(tmp_path, absent), "x y frame").message


def test_unsorted_frames_and_straight_flight_are_not_swapped(tmp_path, rng):
    frame, xy = track(rng)
    shuffled = rng.permutation(len(frame))
    got = read_detections(write(tmp_path, text_of(frame[shuffled], *xy[shuffled].T)), "frame x y")
    assert got.frame.tolist() == frame[shuffled].tolist()
    rising = 2 + 2 * np.arange(len(frame))
    assert len(read_detections(write(tmp_path, text_of(frame, rising, rising)), "frame x y")) == len(frame)


@given(rows=ROWS, delimiter=st.sampled_from([" ", ",", ";", "\t", " , "]), order=st.permutations(["frame", "x", "y"]))
def test_what_is_written_is_read_back(tmp_path_factory, rows, delimiter, order):
    folder = tmp_path_factory.getbasetemp()
    named = [dict(zip(("frame", "x", "y"), row, strict=True)) for row in rows]
    body = [delimiter.join(repr(row[name]) for name in order) for row in named]
    expected = [row for row in rows if row[1] != 0 or row[2] != 0]
    for text, columns in (("\n".join(body), " ".join(order)), ("\n".join([delimiter.join(order), *body]), None)):
        try:
            got = read_detections(write(folder, text), columns)
        except InputError as error:
            assert "look swapped" in error.message  # random rows may well count up by chance  # noqa: PT017
            continue
        assert list(zip(got.frame.tolist(), got.x.tolist(), got.y.tolist(), strict=True)) == expected


@given(rows=ROWS)
def test_the_careful_parser_agrees_with_the_fast_one(tmp_path_factory, rows):
    folder = tmp_path_factory.getbasetemp()
    text = "".join(f"{f},{x!r},{y!r}\n" for f, x, y in rows)
    fast = read_detections(write(folder, f"{text}7,1.5,2\n"), "frame x y")
    slow = read_detections(write(folder, f"{text}7,1.5,\n"), "frame x y")  # only the careful one takes an empty cell
    assert fast.frame.tolist() == slow.frame.tolist()
    assert fast.xy_px[:-1].tolist() == slow.xy_px[:-1].tolist()


def test_thirty_thousand_rows_take_under_a_tenth_of_a_second(tmp_path, rng):
    frame, xy = track(rng, 30_000)
    path = write(tmp_path, text_of(*(xy + 0.123).T, frame))
    read_detections(path, "x y frame")
    best = min(_timed(lambda: read_detections(path, "x y frame")) for _ in range(3))
    assert best < 0.1


def _timed(call) -> float:
    begin = time.process_time()
    call()
    return time.process_time() - begin
