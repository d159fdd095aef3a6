"""The search over every offset, against the definition: one alignment after another."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skytrace.evaluation.search import match_score, scales_to_try, unexplained_at_every_lag
from skytrace.geometry.rigid import align_similarity


def unexplained_by_definition(a: np.ndarray, covered_a: np.ndarray, b: np.ndarray, covered_b: np.ndarray, lag: int):
    j = np.arange(len(b))
    j = j[(j + lag >= 0) & (j + lag < len(a))]
    j = j[covered_b[j] & covered_a[j + lag]]
    if len(j) < 4:
        return len(j), None
    A, B = a[j + lag], b[j]
    residual = B - align_similarity(A, B).apply(A)
    return len(j), (residual**2).sum() / ((B - B.mean(0)) ** 2).sum()


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_every_lag_agrees_with_its_own_alignment(seed: int):
    rng = np.random.default_rng(seed)
    a = 100 + rng.normal(size=(rng.integers(8, 40), 3)).cumsum(axis=0)
    b = 1e-3 * rng.normal(size=(rng.integers(8, 40), 3)).cumsum(axis=0)
    covered_a, covered_b = rng.random(len(a)) < 0.8, rng.random(len(b)) < 0.8
    a[~covered_a], b[~covered_b] = np.nan, np.nan
    lags, counts, unexplained = unexplained_at_every_lag(a, covered_a, b, covered_b)
    np.testing.assert_array_equal(lags, np.arange(1 - len(b), len(a)))
    for lag, count, got in zip(lags, counts, unexplained, strict=True):
        expected_count, expected = unexplained_by_definition(a, covered_a, b, covered_b, int(lag))
        assert count == expected_count
        if expected is not None:
            assert got == pytest.approx(expected, abs=1e-7)


def test_a_mirror_image_is_no_match():
    points = np.random.default_rng(0).normal(size=(50, 3)).cumsum(axis=0)
    covered = np.ones(50, bool)
    lags, _, same = unexplained_at_every_lag(points, covered, points, covered)
    _, _, mirrored = unexplained_at_every_lag(points * [1, 1, -1], covered, points, covered)
    assert same[lags == 0] < 1e-9
    assert mirrored[lags == 0] > 0.02


def test_nothing_covered_matches_nothing():
    points = np.full((5, 3), np.nan)
    _, counts, unexplained = unexplained_at_every_lag(points, np.zeros(5, bool), np.eye(3), np.ones(3, bool))
    assert not counts.any()
    assert (unexplained == 1).all()


def test_a_long_good_match_beats_a_short_perfect_one_and_both_beat_a_long_bad_one():
    score = match_score(np.array([1e-3, 1e-6, 0.3, 0.9]), np.array([100.0, 20.0, 500.0, 15.0]), 20.0)
    assert list(np.argsort(-score)) == [0, 1, 2, 3]
    assert score[1] > 0 > score[2]


@given(st.floats(1, 10_000), st.floats(1e-4, 0.01))
def test_some_tried_scale_keeps_the_overlap_in_phase(overlap_s: float, max_scale_error: float):
    scales = scales_to_try(overlap_s, max_scale_error)
    assert 1.0 in scales
    within = np.linspace(1 - max_scale_error, 1 + max_scale_error, 101)
    drift_s = np.abs(within[:, None] - scales).min(axis=1) * overlap_s / 2
    assert drift_s.max() <= 0.6 + 1e-9
