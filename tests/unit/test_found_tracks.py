"""What is left of a track when it has ended, and which tracks are the target's."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.vision.choose import choose_target
from skytrace.vision.found import (
    CHANGE,
    FRAME,
    ISOLATED,
    N_COLUMNS,
    SIGMA,
    FoundTrack,
    Rows,
    X,
    Y,
    count_followed,
    count_moving,
    with_rests,
)


def rows_at(frames, xy_px, change=0.0, isolated=1.0):
    rows = np.zeros((len(frames), N_COLUMNS))
    rows[:, FRAME], rows[:, [X, Y]] = frames, xy_px
    rows[:, SIGMA], rows[:, CHANGE], rows[:, ISOLATED] = 0.1, change, isolated
    return rows


def track(number, frames, begin=(100.0, 100.0), step=(1.0, 0.0), **looks):
    frames = np.asarray(frames)
    xy_px = np.array(begin) + (frames - frames[0])[:, None] * np.array(step)
    looks = {"contrast": -40.0, "size_px": 5.0, "strength": 10.0, **looks}
    return FoundTrack(number, frames, xy_px, np.full(len(frames), 0.1), **looks)


class TestRows:
    def test_all_that_was_appended(self):
        rows = Rows(limit=10**9)
        for k in range(1000):
            rows.append((float(k), *np.arange(N_COLUMNS - 1.0)), keep_all=False)
        assert rows.array()[:, 0].tolist() == list(range(1000))
        assert rows.array().shape == (1000, N_COLUMNS)

    def test_no_more_than_needed_until_they_count(self):
        rows = Rows(limit=600)
        for k in range(10_000):
            rows.append((float(k),) * N_COLUMNS, keep_all=False)
        kept = rows.array()[:, 0]
        assert 600 <= len(kept) < 1200
        assert kept.tolist() == list(range(10_000 - len(kept), 10_000))

    def test_a_short_one(self):
        rows = Rows(limit=5)
        assert rows.array().shape == (0, N_COLUMNS)


class TestRests:
    def test_frames_between_measurements_of_what_stood_still(self):
        filled = with_rests(rows_at([0, 8, 16, 17], [[10, 20], [10.8, 20], [11.2, 20], [12, 20]]))
        assert filled[:, FRAME].tolist() == list(range(18))
        assert filled[4, X] == pytest.approx(10.4)
        assert filled[4, SIGMA] == pytest.approx(0.1 + 0.25 * 0.8)
        assert filled[[0, 8, 16, 17], SIGMA].tolist() == [0.1] * 4

    @pytest.mark.parametrize(
        ("frames", "second", "change"),
        [([0, 12], [10, 20], 0.0), ([0, 8], [15, 20], 0.0), ([0, 8], [10, 20], 1.2)],
        ids=["too long", "moved", "changed"],
    )
    def test_other_gaps_stay(self, frames, second, change):
        rows = rows_at(frames, [[10, 20], second], change)
        assert with_rests(rows) is rows


class TestEnds:
    def test_what_does_not_even_tremble_is_a_leftover(self):
        rng = np.random.default_rng(0)
        moving = np.cumsum(rng.normal(1, 0.1, (50, 2)), axis=0)
        stuck = np.tile(moving[-1], (30, 1))
        assert count_moving(rows_at(range(80), np.vstack([moving, stuck])), 5.0, 30.0) == 50
        trembling = stuck + 0.05 * rng.normal(size=stuck.shape)
        assert count_moving(rows_at(range(80), np.vstack([moving, trembling])), 5.0, 30.0) == 80

    def test_hanging_against_trees(self):
        rng = np.random.default_rng(0)
        moving = np.cumsum(rng.normal(2, 0.1, (50, 2)), axis=0)
        xy_px = np.vstack([moving, moving[-1] + 0.3 * rng.normal(size=(60, 2))])
        rows = rows_at(range(110), xy_px)
        assert count_moving(rows, 3.0, 30.0) == 110
        rows[50:, ISOLATED] = 0
        assert 49 <= count_moving(rows, 3.0, 30.0) <= 53

    def test_a_tail_of_chance_is_cut_off(self):
        assert count_followed(np.arange(100.0)) == 100
        assert count_followed(np.arange(0, 200, 1.5)) == len(np.arange(0, 200, 1.5))
        sparse = np.concatenate([np.arange(100), np.arange(100, 300, 5)]).astype(float)
        assert count_followed(sparse) in (100, 101)
        # A gap with the target found again behind it stays.
        again = np.concatenate([np.arange(100), np.arange(120, 200)]).astype(float)
        assert count_followed(again) == len(again)
        assert count_followed(np.array([7.0])) == 1


class TestTarget:
    def choose(self, *tracks):
        return set(choose_target(tracks, 1000, 30.0))

    def test_none_of_none(self):
        assert self.choose() == set()

    def test_pieces_of_one(self):
        pieces = track(1, range(100)), track(2, range(110, 200), (212, 100)), track(3, range(400, 450), (900, 10))
        assert self.choose(*pieces) == {1, 2, 3}
        assert self.choose(*reversed(pieces)) == {1, 2, 3}

    def test_the_longer_of_two_at_once(self):
        assert self.choose(track(1, range(100)), track(2, range(150), (700, 300))) == {2}

    def test_quality_counts(self):
        faint = track(1, range(0, 300, 2), strength=1.0)
        assert faint.quality == pytest.approx(150 / 299 / 3)
        assert self.choose(faint, track(2, range(100), (700, 300))) == {2}

    def test_what_cannot_be_the_same(self):
        first = track(1, range(100))
        far = track(2, range(103, 150), (900, 100))
        large = track(3, range(110, 150), (205, 100), size_px=30.0)
        bright = track(4, range(110, 150), (205, 100), contrast=200.0)
        for other in (far, large, bright):
            assert self.choose(first, other) == {1}

    def test_two_parts_of_one_thing(self):
        assert self.choose(track(1, range(100)), track(2, range(80, 160), (182, 103))) == {1, 2}


def test_tracks_are_checked():
    with pytest.raises(ValueError, match="xy_px"):
        FoundTrack(1, np.arange(3), np.zeros((2, 2)), np.ones(3), 1.0, 1.0, 1.0)
