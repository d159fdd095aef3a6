"""The robust score over offsets: it stands what spoils the least-squares one, and ignores hovering."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.estimation.correspond import common_grid, image_path
from skytrace.estimation.offset_search import score_shifts
from skytrace.estimation.robust_search import motion_weights, paired_rows, robust_scores
from skytrace.simulation import Scenario, simulate

RATE_HZ = 10.0


@pytest.fixture
def pair(rng):
    """Two sampled tracks of one flight and the shift that pairs them."""
    scenario = Scenario(n_cameras=2, duration_s=60.0, noise_px=0.3, readout_fraction=0.0, clock_drift=0.0)
    flight = simulate(scenario, rng)
    paths = [image_path(r, 0.0) for r in flight.recordings]
    (begin0, xy0), (begin1, xy1) = common_grid(paths, RATE_HZ)
    start0, start1 = (c.clock.offset_s for c in flight.truth.cameras.values())
    shift = round((start0 - start1 - (begin1 - begin0)) * RATE_HZ)
    return np.array(xy0), np.array(xy1), shift


def test_the_true_shift_scores_best_of_clean_tracks(pair):
    xy0, xy1, shift = pair
    shifts = np.arange(shift - 60, shift + 61, 4)
    scores = robust_scores(xy0, xy1, shifts, RATE_HZ)
    assert scores.shift[np.argmax(scores.score)] == shift


def test_seconds_of_false_detections_do_not_hide_the_true_shift(pair):
    xy0, xy1, shift = pair
    for begin in (100, 230, 400):  # stuck blobs of 1.5 s each
        xy0[begin : begin + 15] = [0.3, -0.25]
    shifts = np.arange(shift - 100, shift + 101, 4)
    robust = robust_scores(xy0, xy1, shifts, RATE_HZ)
    assert robust.shift[np.argmax(robust.score)] == shift
    plain = score_shifts(xy0, xy1, RATE_HZ, 15.0)
    loss = {name: s.rho[s.shift == shift][0] for name, s in (("plain", plain), ("robust", robust))}
    assert loss["robust"] < 0.1 * loss["plain"]


def test_rows_are_those_both_saw_and_spread_over_the_motion():
    seen0, seen1 = np.ones(100, bool), np.ones(80, bool)
    seen0[10:20], seen1[0:15] = False, False
    motion0, motion1 = np.ones(100), np.ones(80)
    motion0[50:] = 4.0
    rows, effective = paired_rows(seen0, seen1, motion0, motion1, -5, 40)
    assert seen0[rows].all()
    assert seen1[rows - 5].all()
    assert (np.diff(rows) >= 0).all()
    common = [k for k in range(5, 85) if seen0[k] and seen1[k - 5]]
    slow, fast = sum(k < 50 for k in common), sum(k >= 50 for k in common)
    assert effective == pytest.approx(slow + 2 * fast)
    assert (rows >= 50).mean() == pytest.approx(2 * fast / (slow + 2 * fast), abs=0.04)


def test_a_hovering_target_weighs_little():
    t = np.arange(200) / RATE_HZ
    xy = np.column_stack([0.02 * t, np.sin(t)])
    xy[100:150] = xy[100]
    weight = motion_weights(xy)
    assert weight[105:145].max() <= 0.05
    assert np.median(np.r_[weight[:95], weight[155:]]) > 0.8
    assert ((weight >= 0.02) & (weight <= 1.5)).all()
    np.testing.assert_array_equal(motion_weights(np.full((5, 2), np.nan)), np.ones(5))
