"""`skytrace calibrate`: pictures and videos in, calibrations out; refusals that say what is missing."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from skytrace.io.calibration import read_calibration

from .command import Result, contents, skytrace

sys.path.insert(0, str(Path(__file__).parents[1] / "unit"))
from board_scene import PINHOLE, Board, half_size, render, shots

LENS = half_size(PINHOLE)


def write_pictures(folder: Path, n: int, **poses: object) -> Path:
    """Pictures of a board, the first parts of whose names are not in the order of their numbers as text."""
    rng, board = np.random.default_rng(5), Board()
    folder.mkdir()
    for k, shot in enumerate(shots(LENS, n, rng, **poses)):  # type: ignore[arg-type]
        cv2.imwrite(str(folder / f"p{k + 1}.png"), render(LENS, board, shot, rng, over=2))
    return folder


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_pictures(tmp_path_factory.mktemp("boards") / "pictures", 10, turn_rad=0.003)


@pytest.fixture(scope="module")
def finished(pictures: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    folder = tmp_path_factory.mktemp("calibrated")
    result = skytrace("calibrate", pictures, "-o", folder / "lens.json", "--report", folder / "page.html")
    return folder, result


def test_a_folder_of_pictures_gives_the_lens(finished) -> None:
    folder, result = finished
    assert result.code == 0, result.err
    lens, rate_hz = read_calibration(folder / "lens.json")
    assert rate_hz is None
    assert (lens.model, lens.size_px) == ("pinhole", (640, 360))
    assert lens.deviation is not None
    assert abs(np.log(lens.focal_px[0] / LENS.focal_px[0])) < max(3 * lens.deviation.focal, 0.005)
    about = json.loads((folder / "lens.json").read_text())["calibration"]
    assert about["pictures"] == 10
    assert about["used"] >= 9
    assert about["board"] == "chessboard, 8 x 7 squares"
    assert about["rms_px"] < 0.3
    assert "boards" in result.err
    for word in ("10 in all", "pinhole, 640 x 360 px", "written to", "two halves"):
        assert word in result.out


def test_the_report_holds_every_picture_and_both_figures(finished) -> None:
    page = (finished[0] / "page.html").read_text(encoding="utf-8")
    assert all(f">p{k}.png<" in page for k in range(1, 11))
    for anchor in ('id="coverage"', 'id="residuals"', '"coverage":{"data"', '"residuals":{"data"'):
        assert anchor in page
    assert "http://" not in page.split("<script")[0]


def test_json_and_a_pattern_in_the_order_of_numbers(pictures: Path, tmp_path: Path) -> None:
    result = skytrace(
        *("calibrate", pictures / "p*.png", "--board", "7x8", "--model", "fisheye"),
        *("-o", tmp_path / "lens.json", "--json"),
    )
    assert result.code == 0, result.err
    document = json.loads(result.out)
    assert (document["model"], len(document["distortion"])) == ("fisheye", 4)
    assert document["board"] == "chessboard, 8 x 7 squares"
    assert document["model_costs"].keys() == {"fisheye"}
    assert document["deviation"]["focal"] > 0


def test_a_video_gives_the_lens_and_its_frame_rate(pictures: Path, tmp_path: Path) -> None:
    from skytrace.io.video_writer import VideoWriter

    with VideoWriter(tmp_path / "board.mp4", LENS.size_px, 10.0, 12) as writer:
        for k in range(1, 11):
            grey = np.asarray(cv2.imread(str(pictures / f"p{k}.png"), cv2.IMREAD_GRAYSCALE), np.uint8)
            blurred = np.asarray(cv2.GaussianBlur(grey, (0, 0), 3), np.uint8)
            colourless = np.full((LENS.size_px[1] // 2, LENS.size_px[0] // 2), 128, np.uint8)
            for i, picture in enumerate((blurred, grey, blurred, grey)):
                writer.write(9000 * (4 * (k - 1) + i), picture, colourless, colourless)
    output = tmp_path / "lens.json"
    result = skytrace("calibrate", tmp_path / "board.mp4", "-o", output, "--model", "pinhole", "--json")
    assert result.code == 0, result.err
    lens, rate_hz = read_calibration(tmp_path / "lens.json")
    assert rate_hz == pytest.approx(10)
    assert lens.focal_px[0] == pytest.approx(LENS.focal_px[0], rel=0.02)
    # Of each two frames the sharp one was looked at.
    assert json.loads(result.out)["pictures"] == 20


def test_boards_seen_head_on_are_refused_with_advice(tmp_path: Path) -> None:
    folder = write_pictures(tmp_path / "flat", 5, tilt_deg=(0.0, 2.0), turn_rad=0.004)
    files = ("-o", tmp_path / "lens.json", "--report", tmp_path / "page.html")
    result = skytrace("calibrate", folder, *files, "--model", "pinhole")
    assert result.code == 4
    assert "tilt the board" in result.err
    assert not (tmp_path / "lens.json").exists()
    assert "do not determine the lens" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_too_few_views_are_refused(pictures: Path, tmp_path: Path) -> None:
    result = skytrace("calibrate", pictures / "p1.png", pictures / "p2.png", "-o", tmp_path / "lens.json")
    assert result.code == 4
    assert "too few views of a board [pictures 2, that show the board 2] (needed: 4)" in result.err
    blank = tmp_path / "blank.png"
    cv2.imwrite(str(blank), np.full((200, 300), 90, np.uint8))
    result = skytrace("calibrate", blank, "-o", tmp_path / "lens.json")
    assert result.code == 4
    assert "that show the board 0" in result.err


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["{tmp}/none", "-o", "{tmp}/l.json"], 3, "no such file, folder or pattern"),
        (["{tmp}/empty", "-o", "{tmp}/l.json"], 3, "no picture in this folder"),
        (["{tmp}/text.png", "-o", "{tmp}/l.json"], 3, "is no picture that can be read"),
        (["{tmp}/tiny.png", "-o", "{tmp}/l.json"], 3, "too small to show a board"),
        (["{tmp}/text.txt", "-o", "{tmp}/l.json"], 3, "text.txt"),
        (["{tmp}/a.png", "{tmp}/b.png", "-o", "{tmp}/l.json"], 3, "is 320 x 200 px, a.png is 300 x 200"),
        (["{tmp}/a.png", "-o", "{tmp}/l.yaml"], 3, "ends in .json"),
        (["{tmp}/a.png", "-o", "{tmp}/l.json", "--report", "{tmp}/l.json"], 3, "is also the file for"),
        (["{tmp}/a.png", "-o", "{tmp}/l.json", "--board", "8"], 2, "such as 8x7"),
        (["{tmp}/a.png", "-o", "{tmp}/l.json", "--board", "3x7"], 2, "4x4 or more"),
        (["{tmp}/a.png", "-o", "{tmp}/l.json", "--model", "omni"], 2, "--model"),
    ],
)
def test_bad_input(tmp_path: Path, arguments: list[str], code: int, words: str) -> None:
    (tmp_path / "empty").mkdir()
    for name in ("text.png", "text.txt"):
        (tmp_path / name).write_text("not a picture")
    for name, shape in (("tiny.png", (20, 20)), ("a.png", (200, 300)), ("b.png", (200, 320))):
        cv2.imwrite(str(tmp_path / name), np.full(shape, 90, np.uint8))
    before = contents(tmp_path)
    result = skytrace("calibrate", *(a.format(tmp=tmp_path) for a in arguments))
    assert result.code == code, result.err
    assert words in " ".join(result.err.split())
    assert "Traceback" not in result.err
    assert contents(tmp_path) == before
