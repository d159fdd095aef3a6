"""`skytrace detect`."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from skytrace.cli.frame_progress import FrameLines
from skytrace.io.detections import read_detections
from skytrace.io.video import read_frames
from tests.unit.flying_scene import Disc, Scene, line
from tests.unit.video_files import write_sound, write_video

from .command import contents, skytrace

N = 50
PATH = line((40, 60), (2.3, 0.9), N)


@pytest.fixture(scope="module")
def videos(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("videos")
    options = {"crf": "18"}
    first = write_video(folder / "a.mp4", list(Scene([Disc(PATH, 8.0)]).pictures()), options=options)
    second = write_video(folder / "b.mp4", list(Scene([Disc(PATH[::-1], 8.0)], seed=1).pictures()), options=options)
    return first, second


def test_one_video(videos: tuple[Path, Path], tmp_path: Path) -> None:
    output = tmp_path / "new" / "tracks.csv"
    result = skytrace("detect", videos[0], "-o", output)
    assert result.code == 0, result.err
    assert "seen in 5" in result.out or "seen in 4" in result.out
    assert f"written to   {output}" in result.out
    assert f"a.mp4        {N} frames" in result.err
    found = read_detections(output)
    assert len(found) >= N - 3
    assert np.hypot(*(found.xy_px - PATH[found.frame]).T).max() < 3
    assert contents(tmp_path / "new").keys() == {"tracks.csv"}


def test_several_videos_each_once(videos: tuple[Path, Path], tmp_path: Path) -> None:
    arguments = ("detect", *videos, "-o", tmp_path / "tracks", "--preview", tmp_path / "pictures", "--json")
    first = skytrace(*arguments)
    assert first.code == 0, first.err
    abouts = json.loads(first.out)
    assert [a["video"] for a in abouts] == ["a.mp4", "b.mp4"]
    assert all(a["on_target"] >= N - 3 for a in abouts)
    written = contents(tmp_path)
    assert {k for k in written if not k.endswith("/")} == {
        "tracks/a.csv",
        "tracks/b.csv",
        "pictures/a.png",
        "pictures/b.png",
    }
    assert "done" in first.err
    # One is lost, the other is not done again.
    (tmp_path / "tracks" / "a.csv").unlink()
    again = skytrace(*arguments)
    assert again.code == 0
    assert again.out == first.out
    assert "a  " in again.err
    assert "b  " not in again.err
    assert contents(tmp_path) == written


def test_pictures(videos: tuple[Path, Path], tmp_path: Path) -> None:
    sheet, overlay = tmp_path / "sheet.png", tmp_path / "overlay.mp4"
    assert skytrace("detect", videos[0], "-o", tmp_path / "t.csv", "--preview", sheet).code == 0
    picture = cv2.imread(str(sheet))
    assert picture is not None
    assert picture.shape[1] == 1600
    green = (picture[..., 1].astype(int) - picture[..., [0, 2]].max(axis=2)) > 60
    assert green.sum() > 200
    result = skytrace("detect", videos[0], "-o", tmp_path / "t.csv", "--preview", overlay)
    assert result.code == 0
    assert str(overlay) in result.out
    shown = list(read_frames(overlay))
    assert len(shown) == N
    # The box around the target is brighter or darker than the sky at its corner.
    plain = next(iter(read_frames(videos[0]))).luma
    assert np.abs(shown[20].luma.astype(int) - plain).max() > 40
    assert {p.name for p in tmp_path.iterdir()} == {"t.csv", "sheet.png", "overlay.mp4"}


def test_mog2_and_mask(videos: tuple[Path, Path], tmp_path: Path) -> None:
    result = skytrace("detect", videos[0], "-o", tmp_path / "t.csv", "--method", "mog2", "--json")
    (about,) = json.loads(result.out)
    assert about["method"] == "mog2"
    assert about["on_target"] > 0.6 * N
    cv2.imwrite(str(tmp_path / "mask.png"), np.zeros((240, 320), np.uint8))
    result = skytrace("detect", videos[0], "-o", tmp_path / "t.csv", "--mask", tmp_path / "mask.png")
    assert result.code == 0
    assert "nothing was found" in result.err
    assert "seen in 0 of them" in result.out


def test_what_cannot_be_done(videos: tuple[Path, Path], tmp_path: Path) -> None:
    sound = write_sound(tmp_path / "sound.mp4")
    small = tmp_path / "small.png"
    cv2.imwrite(str(small), np.zeros((4, 4), np.uint8))
    (tmp_path / "twin").mkdir()
    twin = tmp_path / "twin" / "a.mkv"
    twin.write_bytes(videos[0].read_bytes())
    target = tmp_path / "t.csv"
    cases = [
        ((sound, "-o", target), "only sound"),
        ((tmp_path / "none.mp4", "-o", target), "no such video"),
        ((videos[0], "-o", videos[0]), "is the video itself"),
        ((videos[0], "-o", target, "--preview", tmp_path / "p.gif"), ".png for a contact sheet or in .mp4"),
        ((videos[0], "-o", target, "--preview", videos[0]), "is the video itself"),
        ((videos[0], "-o", tmp_path / "x.png", "--preview", tmp_path / "x.png"), "a name of its own"),
        ((videos[0], "-o", target, "--mask", small), "expected a picture of the video's size 320 x 240, got 4 x 4"),
        ((videos[0], twin, "-o", tmp_path / "out"), "two of the videos are called 'a'"),
        ((videos[0], "-o", sound / "t.csv"), "is a file, not a folder"),
        ((*videos, "-o", small), "is a file, not a folder"),
    ]
    before = contents(tmp_path)
    for arguments, words in cases:
        result = skytrace("detect", *arguments)
        assert result.code == 3, arguments
        assert words in result.message
    assert contents(tmp_path) == before


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="needs Linux's /proc")
def test_interrupted_at_work(videos: tuple[Path, Path], tmp_path: Path) -> None:
    arguments = [sys.executable, "-m", "skytrace", "detect", *map(str, videos), "-o", str(tmp_path / "out")]
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True)
    with process:
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
        end_s = time.monotonic() + 60
        while len(children.read_text().split()) < 2 and time.monotonic() < end_s:
            time.sleep(0.01)
        workers = [int(pid) for pid in children.read_text().split()]
        os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert workers
    assert (process.returncode, out) == (130, b""), err.decode()
    assert "interrupted" in err.decode()
    assert "Traceback" not in err.decode()
    assert not (tmp_path / "out").exists() or list((tmp_path / "out").iterdir()) == []
    while any(map(_lives, workers)) and time.monotonic() < end_s:
        time.sleep(0.01)
    assert not any(map(_lives, workers))


def _lives(pid: int) -> bool:
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_progress_tells_rate_and_time_left(capsys: pytest.CaptureFixture[str], monkeypatch) -> None:
    now_s = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now_s[0])
    lines = FrameLines(sys.stderr, {"cam": 300, "other": None})
    for k in range(1, 201):
        now_s[0] += 0.125
        lines.count("cam", k)
    lines.count("other", 1)
    now_s[0] += 6
    lines.count("other", 50)
    lines.close("cam", 300)
    told = capsys.readouterr().err.splitlines()
    assert told[0].split() == ["cam", "41/300", "frames", "8.2", "a", "second", "32", "s", "left"]
    assert told[-2].split() == ["other", "50", "frames", "8.3", "a", "second"]
    assert told[-1].split()[:3] == ["cam", "300", "frames"]
    assert told[-1].endswith("done")
