"""Video files turned into tracks: whole and damaged ones, with their own times, once and no more."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from tests.unit.flying_scene import Disc, Scene, line
from tests.unit.video_files import write_empty, write_sound, write_video

from skytrace.errors import InputError
from skytrace.io.detections import read_detections
from skytrace.io.tracks import read_about
from skytrace.pipeline.detect import detect_video, read_mask
from skytrace.pipeline.videos import FLIGHT_TRACKS, VideoJob, detect_jobs, flight_jobs, job_key
from skytrace.vision.preview import Sampler

N = 60
PATH = line((40, 60), (2.3, 0.9), N)
# Intervals of 30 and 50 ms by turns, from 2 s on.
STAMPS = [2000 + 40 * k + 10 * (k % 2) for k in range(N)]
# Closed groups of pictures: what is cut off takes nothing before it along.
OPTIONS = {"crf": "18", "g": "10", "bf": "0"}


@pytest.fixture(scope="module")
def pictures():
    return list(Scene([Disc(PATH, 8.0)]).pictures())


@pytest.fixture(scope="module")
def video(pictures, tmp_path_factory):
    path = tmp_path_factory.mktemp("video") / "sky.mkv"
    return write_video(path, pictures, pts=STAMPS, options=OPTIONS)


def nobody(name, done, all_done):
    pass


def on_target(detected):
    rows = detected.rows()
    return rows.frame[rows.target == 1]


def test_frames_times_and_centres(video):
    seen = []
    detected = detect_video(video, on_frame=lambda frame: seen.append(frame.index))
    assert seen == list(range(N))
    assert detected.n_frames == N
    rows = detected.rows()
    assert len(on_target(detected)) >= N - 3
    np.testing.assert_allclose(rows.time_s, np.array(STAMPS)[rows.frame] / 1000, atol=1e-9)
    errors = np.hypot(*(rows.xy_px - PATH[rows.frame]).T)
    assert np.median(errors) < 0.15
    assert detected.warnings == ()
    about = detected.about()
    assert about["size_px"] == [320, 240]
    assert about["rotation_deg"] == 0
    assert about["on_target"] == len(on_target(detected))
    assert [t["target"] for t in about["tracks"]] == [True]


def test_orientation_is_the_sensors_and_said(pictures, tmp_path):
    path = write_video(tmp_path / "phone.mp4", pictures[:30], options=OPTIONS, rotation_deg=90)
    detected = detect_video(path)
    assert detected.about()["rotation_deg"] in (90, 270)
    assert detected.info.size_px == (320, 240)
    rows = detected.rows()
    assert np.median(np.hypot(*(rows.xy_px - PATH[rows.frame]).T)) < 0.2


def test_a_truncated_video_gives_what_could_be_read(video, tmp_path):
    path = tmp_path / "cut.mkv"
    content = video.read_bytes()
    path.write_bytes(content[: int(0.7 * len(content))])
    detected = detect_video(path)
    assert 15 < detected.n_frames < N
    assert len(on_target(detected)) > 0.8 * detected.n_frames
    (warning,) = detected.warnings
    last_s = float(detected.time_s[-1])
    assert f"{last_s:.3f} s" in warning
    assert last_s == pytest.approx(STAMPS[detected.n_frames - 1] / 1000)


@pytest.mark.parametrize(("write", "words"), [(write_sound, "only sound"), (write_empty, "no video")])
def test_refuses_what_has_no_pictures(write, words, tmp_path):
    with pytest.raises(InputError, match=words):
        detect_video(write(tmp_path / "x.mp4"))


def test_an_empty_sky_is_said(tmp_path):
    detected = detect_video(write_video(tmp_path / "sky.mp4", list(Scene([], n=12).pictures())))
    assert len(detected.rows()) == 0
    assert detected.about()["tracks"] == []
    assert "nothing was found" in detected.warnings[0]


class TestMask:
    def test_hides(self, video, tmp_path):
        picture = np.full((240, 320, 3), 255, np.uint8)
        picture[:, 100:] = 0
        cv2.imwrite(str(tmp_path / "mask.png"), picture)
        mask = read_mask(tmp_path / "mask.png")
        rows = detect_video(video, mask=mask).rows()
        assert len(rows) > 0
        assert rows.xy_px[:, 0].max() < 110

    def test_of_another_size(self, video):
        with pytest.raises(InputError, match="320 x 240, got 64 x 48"):
            detect_video(video, mask=np.ones((48, 64), np.uint8))

    def test_see_through_is_hidden(self, tmp_path):
        picture = np.full((4, 4, 4), 255, np.uint8)
        picture[:2, :, 3] = 0
        cv2.imwrite(str(tmp_path / "mask.png"), picture)
        assert read_mask(tmp_path / "mask.png").tolist() == [[0] * 4] * 2 + [[1] * 4] * 2

    @pytest.mark.parametrize("content", [None, b"", b"text"])
    def test_no_picture(self, content, tmp_path):
        path = tmp_path / "mask.png"
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(InputError, match="picture"):
            read_mask(path)


class TestJobs:
    def job(self, video, folder, **changes):
        return VideoJob("cam", video, folder / "cam.csv", job_key(video), **changes)

    def test_done_once(self, video, tmp_path, monkeypatch):
        told = []
        job = self.job(video, tmp_path)
        assert not job.done
        detect_jobs([job, job], lambda *event: told.append(event))
        assert told[-1] == ("cam", N, True)
        assert job.done
        assert read_about(job.tracks)["key"] == job.key
        assert len(read_detections(job.tracks)) >= N - 3
        assert [p.name for p in tmp_path.iterdir()] == ["cam.csv"]

        def refuse(*arguments):
            raise AssertionError("was done before")

        monkeypatch.setattr("skytrace.pipeline.videos.detect_to_file", refuse)
        detect_jobs([job], nobody)

    def test_key_tells_what_matters(self, video, tmp_path):
        other = tmp_path / "other.mkv"
        other.write_bytes(video.read_bytes() + b"\0")
        mask = tmp_path / "mask.png"
        mask.write_bytes(b"1")
        keys = {job_key(video), job_key(other), job_key(video, "mog2"), job_key(video, "tophat", mask)}
        assert len(keys) == 4
        moved = tmp_path / "moved.mkv"
        moved.write_bytes(video.read_bytes())
        assert job_key(moved) == job_key(video)

    def test_another_file_in_the_place_is_not_taken_for_done(self, video, tmp_path):
        job = self.job(video, tmp_path)
        for text in ("frame,x,y\n1,2,3\n", '# about {"key": "0"}\n', ""):
            job.tracks.write_text(text)
            assert not job.done

    def test_an_interrupt_leaves_the_old_file(self, video, tmp_path, monkeypatch):
        job = self.job(video, tmp_path)
        job.tracks.write_text("old")

        def interrupted(name, done, all_done):
            if done == 10:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            detect_jobs([job], interrupted)
        assert job.tracks.read_text() == "old"

        def half(*arguments):
            raise KeyboardInterrupt

        monkeypatch.setattr("skytrace.pipeline.videos.tracks_text", half)
        with pytest.raises(KeyboardInterrupt):
            detect_jobs([job], nobody)
        assert [p.name for p in tmp_path.iterdir()] == ["cam.csv"]
        assert job.tracks.read_text() == "old"

    def test_tracks_of_a_flight_go_to_the_cache_where_its_folder_is_closed(self, video, tmp_path, monkeypatch):
        (job,) = flight_jobs({"a": video}, tmp_path)
        assert job.tracks.parent == tmp_path / FLIGHT_TRACKS
        (tmp_path / "file").touch()
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
        (job,) = flight_jobs({"a": video}, tmp_path / "file")
        assert job.tracks.parent == tmp_path / "cache" / "skytrace" / "tracks"


def test_sampler_keeps_an_even_share():
    sampler = Sampler()
    for k in range(1000):
        sampler.add(k, k / 30, np.zeros((4, 6), np.uint8))
    frames = [s.frame for s in sampler.samples()]
    assert len(frames) == 8
    assert frames[0] == 0
    assert frames[-1] >= 850
    assert np.ptp(np.diff(frames)) <= 128
    assert Sampler().samples() == ()
