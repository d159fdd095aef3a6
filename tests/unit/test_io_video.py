"""Reading videos: times, planes and what is wrong with files."""

from __future__ import annotations

import gc
import os
from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from tests.unit.video_files import ramp, write_empty, write_sound, write_video

from skytrace.errors import InputError
from skytrace.io.video import VideoWarning, frame_times, open_video, read_frames

LOSSLESS = {"crf": "0", "preset": "ultrafast"}
SHORT_GROUPS = {"g": "10", "crf": "20"}
INDEX_FIRST = {"movflags": "+faststart"}


@pytest.fixture(autouse=True)
def no_unexpected_warning(recwarn):
    yield
    assert not [str(w.message) for w in recwarn]


def flush_to_disk(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


class TestTimes:
    def test_variable_rate_is_exact(self, tmp_path):
        rng = np.random.default_rng(3)
        pts = 700 + np.cumsum(rng.integers(1500, 6000, 40))
        base = Fraction(1, 90000)
        video = write_video(tmp_path / "vfr.mp4", ramp(40), pts=pts.tolist(), time_base=base)
        info = open_video(video)
        with_b_frames = [f.time_s for f in read_frames(video)]
        shift_s = with_b_frames[0] - float(pts[0] * base)
        # The container may move the whole stream, never one frame against another.
        assert np.allclose(np.array(with_b_frames) - shift_s, pts / 90000, rtol=0, atol=1e-12)
        assert frame_times(video).tolist() == with_b_frames
        assert info.variable_rate
        assert info.nominal_rate_hz == pytest.approx(90000 / np.median(np.diff(pts)))
        assert info.average_rate_hz == pytest.approx(39 / ((pts[-1] - pts[0]) / 90000), rel=0.1)
        assert info.start_s == with_b_frames[0]

    def test_constant_rate_rounded_to_ticks_is_constant(self, tmp_path):
        pts = [round(1000 * k / 29.97) for k in range(40)]
        info = open_video(write_video(tmp_path / "cfr.mkv", ramp(40), pts=pts))
        assert not info.variable_rate
        assert info.nominal_rate_hz == pytest.approx(29.97, rel=2e-3)

    def test_indices_count_in_presentation_order(self, tmp_path):
        pictures = ramp(30)
        video = write_video(tmp_path / "b.mp4", pictures, options={"bf": "3", "crf": "0"})
        frames = list(read_frames(video, frame_threads=2))
        assert [f.index for f in frames] == list(range(30))
        for frame, picture in zip(frames, pictures, strict=True):
            assert np.array_equal(frame.luma, picture)

    def test_file_without_time_stamps_is_refused(self, tmp_path):
        video = write_video(tmp_path / "raw.h264", ramp(5), options={"bf": "2"})
        with pytest.raises(InputError, match="time stamps"):
            list(read_frames(video))
        with pytest.raises(InputError, match="time stamps"):
            frame_times(video)


class TestPictures:
    def test_odd_widths_respect_the_line_stride(self, tmp_path):
        pictures = ramp(4, (70, 34))
        video = write_video(tmp_path / "odd.mkv", pictures, options=LOSSLESS)
        for frame, picture in zip(read_frames(video), pictures, strict=True):
            assert np.array_equal(frame.luma, picture)
            assert frame.luma.strides[0] > 70
            with pytest.raises(ValueError, match="read-only"):
                frame.luma[0, 0] = 1

    def test_pictures_outlive_their_reader(self, tmp_path):
        pictures = ramp(60)
        video = write_video(tmp_path / "v.mp4", pictures, options=LOSSLESS)
        kept = [f.luma for f in read_frames(video)]
        gc.collect()
        for luma, picture in zip(kept, pictures, strict=True):
            assert np.array_equal(luma, picture)

    @pytest.mark.parametrize("pixel_format", ["yuv422p", "yuv444p", "nv12"])
    def test_other_layouts(self, tmp_path, pixel_format):
        pictures = ramp(3)
        video = write_video(tmp_path / "v.mkv", pictures, pixel_format=pixel_format, options=LOSSLESS)
        for frame, picture in zip(read_frames(video), pictures, strict=True):
            assert np.array_equal(frame.luma, picture)

    def test_colours_without_a_luma_plane(self, tmp_path):
        grey = [np.full((32, 48), 90, np.uint8)] * 2
        video = write_video(tmp_path / "rgb.mkv", grey, codec="ffv1", pixel_format="gray16le")
        assert next(read_frames(video)).luma.shape == (32, 48)

    def test_ten_bits_are_cut_to_eight(self, tmp_path):
        deep = [np.arange(64 * 48, dtype=np.uint16).reshape(48, 64) % 1024]
        video = write_video(tmp_path / "deep.mkv", deep, codec="ffv1", pixel_format="yuv420p10le")
        assert open_video(video).bit_depth == 10
        frame = next(read_frames(video))
        assert frame.luma.dtype == np.uint8
        assert np.array_equal(frame.luma, deep[0] >> 2)

    def test_full_range_is_told_and_kept(self, tmp_path):
        pictures = [np.tile(np.arange(256, dtype=np.uint8), (32, 1))]
        full = write_video(tmp_path / "full.mp4", pictures, full_range=True, options=LOSSLESS)
        assert open_video(full).full_range
        assert np.array_equal(next(read_frames(full)).luma, pictures[0])
        assert not open_video(write_video(tmp_path / "limited.mp4", pictures, options=LOSSLESS)).full_range

    def test_rotation_is_told_and_not_applied(self, tmp_path):
        video = write_video(tmp_path / "turned.mp4", ramp(3), rotation_deg=90, options=LOSSLESS)
        info = open_video(video)
        assert info.rotation_deg == 270  # written counterclockwise
        assert info.size_px == (64, 48)
        assert np.array_equal(next(read_frames(video)).luma, ramp(1)[0])

    def test_interlaced_frames_become_one_field(self, tmp_path):
        # Even rows show the square where it is, odd rows where it will be a field later.
        early, late = ramp(2)
        woven = np.where(np.arange(48)[:, None] % 2 == 0, early, late)
        options = {**LOSSLESS, "x264-params": "tff=1"}
        video = write_video(tmp_path / "fields.mkv", [woven] * 3, options=options)
        assert open_video(video).interlaced
        luma = next(read_frames(video)).luma
        assert np.array_equal(luma[::2], early[::2])
        # Only rows at the square's upper and lower edge are between two values.
        assert np.array_equal(luma[25:31], early[25:31])

    def test_creation_time(self, tmp_path):
        video = write_video(tmp_path / "v.mp4", ramp(2), metadata={"creation_time": "2024-05-06T07:08:09.000000Z"})
        assert open_video(video).created == datetime(2024, 5, 6, 7, 8, 9, tzinfo=UTC)
        assert open_video(write_video(tmp_path / "w.mp4", ramp(2))).created is None


class TestDamage:
    def read(self, video: Path) -> tuple[list, list[VideoWarning]]:
        warned: list[VideoWarning] = []
        return list(read_frames(video, on_warning=warned.append)), warned

    @pytest.fixture(scope="class")
    @staticmethod
    def whole(tmp_path_factory) -> Path:
        rng = np.random.default_rng(0)
        pictures = [np.uint8(p // 2 + rng.integers(0, 40, p.shape)) for p in ramp(100)]
        folder = tmp_path_factory.mktemp("video")
        return write_video(folder / "whole.mp4", pictures, options=SHORT_GROUPS, container_options=INDEX_FIRST)

    def test_a_whole_file_warns_of_nothing(self, whole):
        frames, warned = self.read(whole)
        assert len(frames) == 100
        assert warned == []

    def test_cut_off_file_gives_its_beginning_and_names_the_time(self, whole, tmp_path):
        content = whole.read_bytes()
        video = flush_to_disk(tmp_path / "cut.mp4", content[: len(content) // 2])
        frames, warned = self.read(video)
        assert 30 < len(frames) < 70
        assert [f.index for f in frames] == list(range(len(frames)))
        assert warned[-1].time_s == frames[-1].time_s
        declared_s = open_video(whole).duration_s
        assert f"nothing can be read after {frames[-1].time_s:.3f} s; it should last {declared_s:.3f} s" in str(
            warned[-1]
        )
        assert str(video) in str(warned[-1])

    def test_without_a_callback_python_warns(self, whole, tmp_path):
        video = flush_to_disk(tmp_path / "cut.mp4", whole.read_bytes()[:-3000])
        with pytest.warns(UserWarning, match="cut off or damaged"):
            list(read_frames(video))

    def test_frames_behind_a_hole_keep_index_and_time(self, whole, tmp_path):
        content = bytearray(whole.read_bytes())
        n = len(content)
        content[n // 2 : n // 2 + n // 20] = bytes(n // 20)
        frames, warned = self.read(flush_to_disk(tmp_path / "hole.mp4", bytes(content)))
        assert 80 < len(frames) < 100
        assert frames[-1].index == 99
        times_s = frame_times(whole)
        assert all(f.time_s == times_s[f.index] for f in frames)
        (warning,) = warned
        missing = sorted(set(range(100)) - {f.index for f in frames})
        assert warning.time_s == pytest.approx(times_s[missing[0] - 1])
        assert f"damaged between {warning.time_s:.3f} s" in warning.message

    def test_joined_files_end_at_the_joint(self, tmp_path):
        part = write_video(tmp_path / "part.ts", ramp(50)).read_bytes()
        video = flush_to_disk(tmp_path / "joined.ts", part + part)
        frames, warned = self.read(video)
        assert len(frames) >= 49
        assert f"time stamps jump back, at last after {frames[-1].time_s:.3f} s" in str(warned[-1])

    def test_cut_off_before_its_index(self, whole, tmp_path):
        late_index = write_video(tmp_path / "late.mp4", ramp(50))
        video = flush_to_disk(tmp_path / "cut.mp4", late_index.read_bytes()[:1500])
        with pytest.raises(InputError, match="has no index"):
            open_video(video)


class TestRefusals:
    @pytest.mark.parametrize("read", [open_video, frame_times, lambda p: list(read_frames(p))])
    def test_every_function_refuses_the_same(self, read, tmp_path):
        sound = write_sound(tmp_path / "sound.m4a")
        text = flush_to_disk(tmp_path / "notes.txt", b"frame x y\n1 2 3\n" * 50)
        noise = flush_to_disk(tmp_path / "noise.mp4", np.random.default_rng(0).bytes(3000))
        empty = flush_to_disk(tmp_path / "empty.mp4", b"")
        for path, words in (
            (tmp_path / "absent.mp4", "no such video file"),
            (tmp_path, "is not a file"),
            (sound, "holds only sound"),
            (text, "is not a video"),
            (noise, "is not a video"),
            (empty, "is empty"),
        ):
            with pytest.raises(InputError, match=words) as caught:
                read(path)
            assert str(path) in str(caught.value)

    def test_a_photograph(self, tmp_path):
        photograph = write_video(
            tmp_path / "photo.png", [np.zeros((16, 16), np.uint8)], codec="png", pixel_format="gray"
        )
        with pytest.raises(InputError, match="photograph"):
            open_video(photograph)

    def test_a_video_without_frames(self, tmp_path):
        content = write_video(tmp_path / "v.mp4", ramp(20), container_options=INDEX_FIRST).read_bytes()
        head = flush_to_disk(tmp_path / "head.mp4", content[: content.index(b"mdat") + 12])
        for read in (open_video, lambda p: list(read_frames(p))):
            with pytest.raises(InputError, match="no frame of its video can be decoded"):
                read(head)
        with pytest.raises(InputError, match="holds no video"):
            open_video(write_empty(tmp_path / "empty.mp4"))


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs Linux to ask for the memory in use")
def test_memory_does_not_grow_with_the_length(tmp_path):
    pictures = [np.full((480, 640), k % 200, np.uint8) for k in range(300)]
    video = write_video(tmp_path / "long.mp4", pictures, options={"preset": "ultrafast"})

    def resident_bytes() -> int:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    used = [resident_bytes() for _ in read_frames(video)]
    assert len(used) == 300
    # One picture is half a megabyte: keeping them would take 100 MB.
    assert used[-1] - used[40] < 20e6
