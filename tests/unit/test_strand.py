"""Which tracklets belong to one target."""

from __future__ import annotations

import numpy as np

from skytrace.estimation.correspond import image_path
from skytrace.estimation.strand import best_sequence, main_strand, tracklet_pieces
from skytrace.geometry.arrays import FloatArray
from skytrace.model.camera import Intrinsics
from skytrace.model.track import Recording, Track

LENS = Intrinsics([1000.0, 1000.0], [960.0, 540.0], np.zeros(5), (1920, 1080))


def place(t: FloatArray) -> FloatArray:
    return np.column_stack([900 + 400 * np.sin(0.4 * t), 500 + 200 * np.cos(0.3 * t)])


def path_of(*pieces: tuple[int, int, tuple[float, float] | None]):
    """A path at 30 Hz from pieces (first frame, last frame, where a blob is stuck or None for the target)."""
    tracks = []
    for first, last, stuck in pieces:
        frame = np.arange(first, last)
        xy = place(frame / 30) if stuck is None else np.tile(stuck, (len(frame), 1)) + 0.01 * (frame[:, None] % 3)
        tracks.append(Track(frame, xy))
    return image_path(Recording("a", LENS, 30.0, tuple(tracks)), 0.0)


def test_a_blob_that_interrupts_the_target_is_left_out():
    path = path_of((0, 300, None), (301, 331, (300.0, 900.0)), (332, 600, None))
    strand = main_strand(path)
    assert strand.defined(np.array([5.0, 15.0])).all()
    assert path.defined(np.array([10.5])).all()
    assert not strand.defined(np.array([10.5])).any()


def test_gaps_and_reappearances_are_kept():
    path = path_of((0, 100, None), (160, 300, None), (900, 1100, None))
    np.testing.assert_array_equal(main_strand(path).coefficients, path.coefficients)


def test_what_lasts_longer_than_the_target_is_kept():
    path = path_of((0, 20, None), (21, 400, (300.0, 900.0)), (401, 420, None))
    assert main_strand(path).defined(np.array([6.0])).all()


def test_pieces_are_the_uninterrupted_stretches():
    first, last = tracklet_pieces(path_of((0, 100, None), (160, 300, None)))
    assert len(first) == len(last) == 2
    assert (last >= first).all()
    assert first[1] == last[0] + 2  # the gap between them is one piece


def test_the_best_sequence_weighs_seconds_against_jumps():
    time_s = np.array([[0, 10.0], [10.1, 11.1], [11.2, 20.0]])
    position = np.zeros((3, 2, 2))
    position[1] = [0.5, 0.5]
    still = np.zeros((3, 2, 2))
    np.testing.assert_array_equal(best_sequence(time_s, position, still, 0.1), [True, False, True])
    np.testing.assert_array_equal(best_sequence(time_s, position, still, 0.1, cost_s=0.01), [True, True, True])
