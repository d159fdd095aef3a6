"""The search over all offsets: exact against brute force, and right on simulated pairs."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.estimation.correspond import common_grid, image_path
from skytrace.estimation.offset_search import peaks, score_shifts, turn_rate_correlation
from skytrace.simulation import Scenario, simulate

RATE_HZ = 10.0


def wandering(rng, n):
    """A smooth image path (n, 2) sampled at 10 Hz."""
    t = np.arange(n)[:, None] / RATE_HZ
    return 0.1 * sum(rng.normal(size=2) * np.sin(rng.uniform(0.2, 1.0, 2) * t + rng.uniform(0, 6, 2)) for _ in range(4))


@pytest.fixture
def tracks(rng):
    """Two unrelated tracks of different lengths with gaps, looking away from the image centre."""
    xy0, xy1 = wandering(rng, 500), wandering(rng, 420) + [0.2, -0.1]
    xy0[100:130], xy1[300:310], xy1[17] = np.nan, np.nan, np.nan
    return xy0, xy1


def paired(xy0, xy1, shift):
    """The rows of both tracks that a shift pairs, where both are seen."""
    k = np.arange(max(0, -shift), min(len(xy0), len(xy1) - shift))
    k = k[np.isfinite(xy0[k, 0]) & np.isfinite(xy1[k + shift, 0])]
    return k, k + shift


def whitened(xy, rows):
    """Homogeneous coordinates with unit second moments over the rows."""
    seen = xy[np.isfinite(xy[:, 0])]
    y = np.column_stack([(xy[rows] - seen.mean(0)) / seen.std(), np.ones(len(rows))])
    moments = y.T @ y / len(rows)
    return y @ np.linalg.inv(np.linalg.cholesky(moments + 1e-6 * np.trace(moments) * np.eye(3))).T


@pytest.mark.parametrize("shift", [-340, -100, 0, 57, 220])
def test_scores_equal_brute_force_least_squares(tracks, shift):
    xy0, xy1 = tracks
    scores = score_shifts(xy0, xy1, RATE_HZ, 15.0, free_parameters_s=8.0)
    at = int(np.flatnonzero(scores.shift == shift)[0])
    rows0, rows1 = paired(xy0, xy1, shift)
    equations = np.einsum("ni,nj->nij", whitened(xy1, rows1), whitened(xy0, rows0)).reshape(len(rows0), 9)
    rho = np.linalg.svd(equations)[1][8] ** 2 / len(rows0)
    assert scores.overlap[at] == len(rows0)
    assert scores.rho[at] == pytest.approx(rho, rel=1e-8)
    assert scores.score[at] == pytest.approx(-(len(rows0) / RATE_HZ - 8) * np.log(rho), rel=1e-8)


def test_exactly_the_shifts_with_enough_overlap_are_scored(tracks):
    xy0, xy1 = tracks
    enough = [s for s in range(-499, 420) if len(paired(xy0, xy1, s)[0]) >= 150]
    for search in (score_shifts, turn_rate_correlation):
        scores = search(xy0, xy1, RATE_HZ, 15.0)
        assert (np.diff(scores.shift) > 0).all()
        assert len(scores.shift) == len(scores.overlap) == len(scores.rho) == len(scores.score)
        assert (scores.overlap >= 150).all()
    np.testing.assert_array_equal(score_shifts(xy0, xy1, RATE_HZ, 15.0).shift, enough)


def test_tracks_shorter_than_the_overlap_have_no_shift(rng):
    for search in (score_shifts, turn_rate_correlation):
        assert len(search(wandering(rng, 100), wandering(rng, 300), RATE_HZ, 15.0).shift) == 0
        assert len(search(wandering(rng, 1), wandering(rng, 1), RATE_HZ, 15.0).shift) == 0


def test_a_track_without_samples_is_a_mistake(rng):
    with pytest.raises(ValueError, match="at least one sample"):
        score_shifts(np.full((300, 2), np.nan), wandering(rng, 300), RATE_HZ, 15.0)


def test_where_the_cameras_look_does_not_matter(tracks):
    xy0, xy1 = tracks
    turned = xy1 @ np.array([[0.6, -0.8], [0.8, 0.6]]) * 3 + [0.4, 0.7]
    a, b = score_shifts(xy0, xy1, RATE_HZ, 15.0), score_shifts(xy0, turned, RATE_HZ, 15.0)
    np.testing.assert_allclose(a.rho, b.rho, rtol=1e-3)


def test_a_target_that_stands_still_is_scored_without_failure(rng):
    still = np.full((300, 2), 0.3)
    for search in (score_shifts, turn_rate_correlation):
        assert np.isfinite(search(still, wandering(rng, 300), RATE_HZ, 15.0).score).all()


@pytest.mark.parametrize("seed", range(4))
def test_the_offset_of_a_simulated_pair_is_found(seed):
    flight = simulate(Scenario(duration_s=60.0, n_cameras=2), np.random.default_rng(seed))
    paths = [image_path(r, 0.6) for r in flight.recordings]
    (start0, xy0), (start1, xy1) = common_grid(paths, RATE_HZ)
    scores = score_shifts(xy0, xy1, RATE_HZ, 15.0)
    best = peaks(scores.score, scores.shift, 1, 5)[0]
    clock0, clock1 = (c.clock for c in flight.truth.cameras.values())
    offset_s = scores.shift[best] / RATE_HZ + start1 - start0
    assert offset_s == pytest.approx(clock0.offset_s - clock1.offset_s, abs=0.1)
    assert scores.rho[best] < 0.01


@pytest.mark.parametrize("shift", [-200, 31, 180])
def test_turn_rates_are_correlated_over_the_overlap(tracks, shift):
    """Against a plain loop: log of the second difference over 0.2 s, Pearson's r, Fisher's z times root seconds."""
    logs = []
    for xy in tracks:
        second = np.full(len(xy), np.nan)
        for i in range(2, len(xy) - 2):
            second[i] = np.linalg.norm(xy[i + 2] - 2 * xy[i] + xy[i - 2])
        logs.append(np.log(second + 0.1 * np.nanmedian(second)))
    k = np.arange(max(0, -shift), min(len(logs[0]), len(logs[1]) - shift))
    k = k[np.isfinite(logs[0][k]) & np.isfinite(logs[1][k + shift])]
    r = np.corrcoef(logs[0][k], logs[1][k + shift])[0, 1]
    scores = turn_rate_correlation(*tracks, RATE_HZ, 15.0)
    at = int(np.flatnonzero(scores.shift == shift)[0])
    assert scores.overlap[at] == len(k)
    assert scores.rho[at] == pytest.approx(1 - r, rel=1e-6)
    assert scores.score[at] == pytest.approx(np.arctanh(r) * np.sqrt(len(k) / RATE_HZ), rel=1e-6)


def test_a_track_turns_when_its_own_copy_turns(rng):
    xy = wandering(rng, 600)
    scores = turn_rate_correlation(xy[:400], xy[100:] @ np.array([[0.5, 0.2], [-0.3, 0.9]]), RATE_HZ, 15.0)
    assert scores.shift[peaks(scores.score, scores.shift, 1, 5)[0]] == -100


def test_peaks_are_apart_and_in_order():
    shift = np.arange(-50, 51)
    score = np.zeros(101)
    score[[10, 12, 40, 90]] = [5.0, 4.0, 3.0, 9.0]
    np.testing.assert_array_equal(shift[peaks(score, shift, 3, 5)], [40, -40, -10])
    np.testing.assert_array_equal(shift[peaks(score, shift, 3, 2)], [40, -40, -38])
    assert len(peaks(np.zeros(0), np.zeros(0, int), 3, 5)) == 0
    assert len(peaks(score, shift, 1000, 50)) <= 3
    gaps = np.array([0, 1, 2, 30, 31])  # shifts that lack overlap are left out in between
    np.testing.assert_array_equal(peaks(np.array([3.0, 2, 1, 2, 1]), gaps, 2, 5), [0, 3])


def test_the_flanks_of_a_broad_maximum_are_no_peaks():
    shift = np.arange(-50, 51)
    score = -((shift / 30.0) ** 2)
    score[90] = -0.5
    np.testing.assert_array_equal(shift[peaks(score, shift, 2, 5)], [0, 40])
