"""The curves behind a synchronisation: the search's maximum at the truth, errors that the refinement lowers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skytrace.estimation import two_view
from skytrace.estimation.correspond import ImagePath, image_path
from skytrace.estimation.sync_curves import epipolar_errors, score_curve, sight, sync_curves
from skytrace.estimation.sync_settings import SyncSettings
from skytrace.estimation.synchronize import Synchronisation, weigh_offsets
from skytrace.geometry import epipolar
from skytrace.simulation import Scenario, simulate

SETTINGS = SyncSettings()
IDS = ("cam0", "cam1", "cam2")


@pytest.fixture(scope="module")
def flight():
    return simulate(Scenario(duration_s=60.0, n_cameras=3, clock_drift=4e-4), np.random.default_rng(5))


@pytest.fixture(scope="module")
def paths(flight):
    return {r.camera_id: image_path(r, 0.6) for r in flight.recordings}


@pytest.fixture(scope="module")
def found(paths) -> Synchronisation:
    found = weigh_offsets(paths, SETTINGS, np.random.default_rng(0))
    assert set(found.clocks) == set(IDS)
    return found


@pytest.fixture(scope="module")
def curves(paths, found):
    return sync_curves(paths, found, SETTINGS)


def true_offset_s(flight, a: int, b: int) -> float:
    """Nominal camera time of b less that of a in the middle of the flight."""
    middle_s = 0.5 * (flight.truth.motion.begin_s + flight.truth.motion.end_s)
    times = []
    for recording in (flight.recordings[a], flight.recordings[b]):
        clock = flight.truth.cameras[recording.camera_id].clock
        times.append((middle_s - clock.offset_s) / clock.period_s / recording.frame_rate_hz)
    return times[1] - times[0]


def constant_path(begin_s: float, end_s: float) -> ImagePath:
    return ImagePath(np.array([begin_s, end_s]), np.array([0.0, 0.0, 0.0, 0.2])[:, None, None] * np.ones((4, 1, 2)))


def test_every_pair_has_its_curves_and_every_camera_its_sight(curves):
    assert [(p.camera0, p.camera1) for p in curves.pairs] == [("cam0", "cam1"), ("cam0", "cam2"), ("cam1", "cam2")]
    assert set(curves.sights) == set(IDS)


def test_the_highest_score_is_at_the_true_offset(flight, curves):
    for pair in curves.pairs:
        truth_s = true_offset_s(flight, IDS.index(pair.camera0), IDS.index(pair.camera1))
        curve = pair.curve
        assert curve.offset_s[np.argmax(curve.score)] == pytest.approx(truth_s, abs=0.15)
        assert pair.chosen_s == pytest.approx(truth_s, abs=0.02)
        assert pair.rank == 1
        assert curve.chance < 0.6 * curve.score.max()
        assert (np.diff(curve.offset_s) > 0).all()
        assert curve.overlap_s.min() >= SETTINGS.min_overlap_s


def test_the_joint_clocks_agree_with_every_pair(curves):
    for pair in curves.pairs:
        assert pair.joint_s == pytest.approx(pair.chosen_s, abs=0.01)


def test_the_refinement_lowers_the_errors(curves):
    for pair in curves.pairs:
        errors = pair.errors
        assert errors is not None
        assert np.nanmedian(errors.after) <= np.nanmedian(errors.before)
        assert np.nanpercentile(errors.after, 90) < 1.5e-3
        assert (np.diff(errors.time_s) > 0).all()
        assert np.isfinite(errors.before).mean() > 0.95


def test_the_errors_after_are_those_of_the_geometry_found(curves, paths, found):
    """The pose fitted again at the offset found is the one that was found there."""
    for pair, view in zip(curves.pairs, found.pairs, strict=True):
        errors = pair.errors
        assert errors is not None
        xy0 = paths[pair.camera0].evaluate(errors.time_s)
        xy1 = paths[pair.camera1].evaluate(view.offset_s + view.rate * errors.time_s)
        expected = np.abs(epipolar.sampson_error(epipolar.essential_matrix(view.camera1_from_camera0), xy0, xy1))
        assert np.median(errors.after) == pytest.approx(np.median(expected), rel=0.1)


def test_a_wrong_offset_leaves_larger_errors(paths, found):
    right = found.evidence[0]
    path0, path1 = paths[right.camera0], paths[right.camera1]
    errors = epipolar_errors(path0, path1, right.offset_s, right.rate, right.offset_s + 1.0, right.rate, SETTINGS, 200)
    assert errors is not None
    assert len(errors.time_s) == 200
    assert np.nanmedian(errors.before) > 5 * np.median(errors.after)


def test_clocks_of_another_rate_are_compared_at_that_rate(paths):
    """Camera 1's time runs a quarter faster than it says."""
    path0, path1 = paths["cam0"], paths["cam1"]
    plain, stretched = score_curve(path0, path1, SETTINGS), score_curve(path0, path1.stretched(1.25), SETTINGS, 1.25)
    np.testing.assert_allclose(stretched.offset_s, 1.25 * plain.offset_s, atol=1e-9)
    np.testing.assert_allclose(stretched.score, plain.score, rtol=1e-6)


def test_a_stretched_camera_is_drawn_where_it_was_found(paths, found, curves):
    """A pair whose rate is 1.25 has the same curve and errors as the same pair at 1."""
    wrong = {**paths, "cam1": paths["cam1"].stretched(1.25)}
    pair = found.evidence[0]
    moved = replace(pair, offset_s=1.25 * pair.offset_s, rate=1.25 * pair.rate)
    clocks = {c: (offset_s, rate / 1.25 if c == "cam1" else rate) for c, (offset_s, rate) in found.clocks.items()}
    again = sync_curves(wrong, replace(found, evidence=(moved,), clocks=clocks, groups=(clocks,)), SETTINGS).pairs[0]
    before = curves.pairs[0]
    assert again.chosen_s == pytest.approx(1.25 * before.chosen_s, abs=0.1)
    assert again.joint_s == pytest.approx(again.chosen_s, abs=0.02)
    assert again.rank == 1
    assert again.errors is not None
    assert np.median(again.errors.after) == pytest.approx(np.median(before.errors.after), rel=0.2)


def test_without_evidence_the_joint_clocks_still_say_where_a_pair_is(paths, found, curves):
    bare = sync_curves(paths, replace(found, evidence=()), SETTINGS).pairs
    for pair, full in zip(bare, curves.pairs, strict=True):
        assert (pair.chosen_s, pair.rank, pair.errors) == (None, None, None)
        assert pair.joint_s == pytest.approx(full.joint_s, abs=1e-3)
        np.testing.assert_array_equal(pair.curve.score, full.curve.score)


def test_without_clocks_there_is_only_the_pairs_own_evidence(paths, found, curves):
    loose = replace(found, clocks={}, groups=(), pairs=(), disagreement_s=np.zeros(0))
    pair = sync_curves(paths, loose, SETTINGS).pairs[0]
    assert pair.joint_s is None
    assert pair.chosen_s == curves.pairs[0].chosen_s


def test_an_offset_off_every_summit_has_no_rank(paths, found):
    pair = found.evidence[0]
    curve = score_curve(paths["cam0"], paths["cam1"], SETTINGS)
    end_s = float(curve.offset_s[-1])
    odd = sync_curves(paths, replace(found, evidence=(replace(pair, offset_s=end_s + 5.0, rate=1.0),)), SETTINGS).pairs
    assert odd[0].rank is None


def test_paths_that_share_too_little_have_an_empty_curve(paths):
    short = constant_path(0.0, 4.0)
    for path in (short, constant_path(0.01, 0.09)):  # the second holds no sample of the search's grid
        curve = score_curve(paths["cam0"], path, SETTINGS)
        assert len(curve.offset_s) == len(curve.score) == len(curve.overlap_s) == 0
        assert np.isnan(curve.chance)
    nothing = Synchronisation("cam0", {}, (), np.zeros(0), {})
    (pair,) = sync_curves({"cam0": paths["cam0"], "short": short}, nothing, SETTINGS).pairs
    assert (pair.chosen_s, pair.joint_s, pair.errors) == (None, None, None)


def test_scores_are_looked_up_where_there_are_any(paths):
    curve = score_curve(paths["cam0"], paths["cam1"], SETTINGS)
    assert curve.step_s == pytest.approx(0.1)
    assert curve.score_at(float(curve.offset_s[7]) + 0.04) == curve.score[7]
    assert curve.score_at(float(curve.offset_s[-1]) + 5.0) is None


def test_sight_closes_short_gaps_only():
    seen = np.array([True, False, True, False, True])
    breaks = np.array([0.0, 10.0, 10.4, 20.0, 21.0, 30.0])
    path = ImagePath(breaks, np.where(seen, 0.1, np.nan)[None, :, None] * np.ones((4, 1, 2)))
    found = sight(path)
    assert found.filmed_s == (0.0, 30.0)
    np.testing.assert_allclose(found.seen_s, [[0.0, 20.0], [21.0, 30.0]])
    np.testing.assert_allclose(sight(path, 0.1).seen_s, [[0.0, 10.0], [10.4, 20.0], [21.0, 30.0]])
    np.testing.assert_allclose(sight(constant_path(1.0, 2.0)).seen_s, [[1.0, 2.0]])


def test_errors_without_a_pose_are_none(paths):
    apart = two_view.common_times(paths["cam0"], paths["cam1"], 10.0, 1e4, 1.0)
    assert len(apart) == 0
    assert epipolar_errors(paths["cam0"], paths["cam1"], 1e4, 1.0, 1e4, 1.0, SETTINGS) is None
