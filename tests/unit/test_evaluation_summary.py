"""Statistics, camera centres, clocks and the summary, on numbers made by hand."""

from __future__ import annotations

import json

import numpy as np
import pytest

from skytrace.evaluation.cameras import aligned_centre_errors, centre_errors, orientation_errors
from skytrace.evaluation.clocks import synchronisation_errors
from skytrace.evaluation.path import SampledPath
from skytrace.evaluation.statistics import ErrorStatistics, by_count, by_quantile, keep_within
from skytrace.evaluation.summary import evaluate
from skytrace.evaluation.table import format_table
from skytrace.geometry.rigid import Similarity, so3_exp
from skytrace.model.camera import Clock

SIMILARITY = Similarity(3.0, so3_exp(np.array([0.3, -0.2, 1.0])), np.array([5.0, -7.0, 1.0]))
CENTRES = {
    "a": np.array([0.0, 0, 0]),
    "b": np.array([10.0, 0, 0]),
    "c": np.array([0, 8.0, 1]),
    "d": np.array([9.0, 9, 0]),
}


def test_statistics_by_hand():
    statistics = ErrorStatistics.of(np.array([1.0] * 18 + [2.0, 10.0]))
    assert statistics.n == 20
    assert statistics.mean == pytest.approx(1.5)
    assert statistics.rmse == pytest.approx(np.sqrt((18 + 4 + 100) / 20))
    assert statistics.median == 1.0
    assert statistics.max == 10.0
    assert statistics.outlier_percent == pytest.approx(5.0)  # 3 RMSE are 7.4
    with pytest.raises(ValueError, match="n >= 1"):
        ErrorStatistics.of(np.zeros(0))


def test_the_dropping_rule_by_hand():
    error = np.array([1.0] * 99 + [120.0])  # the mean is 2.19, ten times that 21.9
    np.testing.assert_array_equal(keep_within(error, 10.0), [True] * 99 + [False])
    assert keep_within(np.array([1.0, 1.0, 2.9]), 10.0).all()
    assert keep_within(np.array([0.0] * 9 + [5.0]), 10.0).all()  # ten means exactly


def test_groups_by_hand():
    error = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    groups = by_count(error, np.array([3, 2, 3, 2, 6]))
    assert [(g.low, g.statistics.n, g.statistics.mean) for g in groups] == [(2, 2, 3.0), (3, 2, 2.0), (6, 1, 5.0)]
    quarters = by_quantile(error, np.array([0.4, np.nan, 0.1, 0.2, 0.3]), 2)
    assert [(g.low, g.high, g.statistics.mean) for g in quarters] == [(0.1, 0.2, 3.5), (0.3, 0.4, 3.0)]
    assert by_quantile(error, np.full(5, np.nan)) == ()
    assert [(g.low, g.statistics.n) for g in by_quantile(error, np.full(5, 0.7))] == [(0.7, 5)]


def test_camera_centres_are_aligned_before_they_are_compared():
    known = {camera: SIMILARITY.apply(centre) for camera, centre in CENTRES.items()}
    errors = aligned_centre_errors(CENTRES, {**known, "not there": np.zeros(3)})
    assert set(errors.error) == set(CENTRES)
    assert errors.max < 1e-9
    assert errors.known_from_world.scale == pytest.approx(3.0)


def test_camera_centre_errors_by_hand():
    identity = Similarity(1.0, np.eye(3), np.zeros(3))
    known = {"a": np.array([0, 0, 3.0]), "b": np.array([10.0, 4, 0]), "c": CENTRES["c"]}
    errors = centre_errors(CENTRES, known, identity)
    assert dict(errors.error) == {"a": 3.0, "b": 4.0, "c": 0.0}
    assert errors.mean == pytest.approx(7 / 3)
    assert errors.max == 4.0
    # A square that bulges by 0.1 at alternate corners: no similarity removes any of it.
    square = {name: np.array([x, y, 0.0]) for name, x, y in [("p", 1, 1), ("q", -1, 1), ("r", -1, -1), ("s", 1, -1)]}
    bent = {name: p + np.array([0, 0, 0.1 * p[0] * p[1]]) for name, p in square.items()}
    np.testing.assert_allclose(list(aligned_centre_errors(square, bent).error.values()), 0.1, atol=1e-9)


def test_two_cameras_align_to_anything():
    with pytest.raises(ValueError, match="at least 3 cameras with known positions, got 2"):
        aligned_centre_errors(CENTRES, {camera: CENTRES[camera] for camera in "ab"})
    with pytest.raises(ValueError, match="none of the reconstructed cameras"):
        centre_errors(CENTRES, {"x": np.zeros(3)}, SIMILARITY)


def test_orientations_are_aligned_before_they_are_compared():
    turns = {c: so3_exp(np.array([0.3 * k, 0.5 - k, 0.1])) for k, c in enumerate("abcd")}
    known = {c: turn @ SIMILARITY.rotation.T for c, turn in turns.items()}
    errors = orientation_errors(turns, {**known, "not there": np.eye(3)})
    assert set(errors.error_deg) == set("abcd")
    assert errors.max_deg < 1e-6
    np.testing.assert_allclose(errors.known_from_world, SIMILARITY.rotation, atol=1e-12)
    # Two cameras turned against each other by 2 degrees: the alignment takes half from each.
    two = {"a": np.eye(3), "b": so3_exp(np.array([0, 0, np.radians(2.0)]))}
    errors = orientation_errors(two, {"a": np.eye(3), "b": np.eye(3)})
    assert dict(errors.error_deg) == pytest.approx({"a": 1.0, "b": 1.0})
    assert errors.mean_deg == pytest.approx(1.0)
    with pytest.raises(ValueError, match="at least 2 cameras with a known orientation are needed, got 1"):
        orientation_errors({"a": np.eye(3)}, two)


def test_velocity_errors_are_those_between_samples():
    k = np.arange(250)
    truth = spiral(k / 5 + 4.0)
    # Off by 2 cm every fourth sample along x: every other one lies between neighbours that differ by 2 cm in 0.4 s.
    truth[::4, 0] += 0.02
    truth[100] = np.nan
    errors = evaluate(spiral_path(), truth=truth, rate_hz=5.0).trajectory.complete
    error = np.linalg.norm(errors.velocity_error_vector, axis=1)
    assert len(error) == 250 - 2 - 3  # neither at the ends nor beside the unknown sample
    low, high = np.split(np.sort(error), [len(error) // 2 - 2])
    assert low.max() < 0.002
    np.testing.assert_allclose(np.median(high), 0.02 / 0.4, rtol=0.05)
    assert errors.velocity.n == len(error)
    alone = evaluate(spiral_path(), truth=np.where(k[:, None] % 3 == 2, np.nan, truth), rate_hz=5.0)
    assert alone.trajectory.complete.velocity is None
    assert alone.as_dict()["trajectory"]["all"]["velocity"] is None


def test_exact_clocks_have_no_error_whatever_the_readout():
    """frame_b = 2 frame_a - 30 where the middle rows are exposed together."""
    a = Clock(10.0, 1 / 25, 0.01, 1080)
    b = Clock(10.0 + 30 / 50 + 0.005 - 0.009, 1 / 50, 0.018, 720)
    errors = synchronisation_errors({"a": a, "b": b}, {"a": (1.0, 0.0), "b": (2.0, -30.0)}, np.linspace(20, 80, 7))
    assert errors.base == "a"
    assert set(errors.error) == {"b"}
    assert errors.max_s < 1e-12
    top = synchronisation_errors({"a": a, "b": b}, {"a": (1.0, 0.0), "b": (2.0, -30.0)}, np.array([20.0]), 0.0)
    assert top.mean_s == pytest.approx(0.004)


def test_clock_errors_by_hand():
    clocks = {"a": Clock(0.0, 0.04), "b": Clock(0.01, 0.02), "c": Clock(0.0, 0.04 * 1.001), "lost": Clock(0, 1.0)}
    known = {"b": (2.0, 0.0), "a": (1.0 + 1e-12, 1e-12), "c": (1.0, 0.0), "unseen": (1.0, 5.0)}
    errors = synchronisation_errors(clocks, known, np.array([0.0, 10.0, 20.0, 50.0]))
    assert errors.base == "a"
    b, c = errors.error["b"], errors.error["c"]
    assert (b.mean_s, b.median_s, b.max_s) == pytest.approx((0.01, 0.01, 0.01))
    assert b.mean_own_frames == pytest.approx(0.5)
    assert b.mean_base_frames == pytest.approx(0.25)
    assert b.mean_frames_30fps == pytest.approx(0.3)
    # c ran slow by a thousandth: at 0, 10, 20 and 50 s it is off by 0, 10, 20 and 50 ms.
    assert (c.mean_s, c.median_s, c.max_s) == pytest.approx((0.02, 0.015, 0.05), rel=1e-8)
    assert errors.mean_s == pytest.approx(0.015)
    assert errors.max_s == pytest.approx(0.05)
    assert errors.mean_base_frames == pytest.approx(0.375)


def test_another_base_serves_where_the_reference_was_not_reconstructed():
    """frame_b = 2 ref + 6 and frame_c = 0.5 ref - 1 make frame_c = frame_b / 4 - 2.5."""
    known = {"ref": (1.0, 0.0), "b": (2.0, 6.0), "c": (0.5, -1.0)}
    clocks = {"b": Clock(0.0, 0.01), "c": Clock(0.1, 0.04)}
    errors = synchronisation_errors(clocks, known, np.array([1.0, 7.0]))
    assert errors.base == "b"
    assert errors.error["c"].max_s == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(ValueError, match="at least 2 cameras with known correspondence are needed, got 1"):
        synchronisation_errors({"b": clocks["b"]}, known, np.array([1.0]))
    with pytest.raises(ValueError, match="covered_time_s"):
        synchronisation_errors(clocks, known, np.zeros(0))


def spiral(time_s: np.ndarray) -> np.ndarray:
    angle = 0.2 * time_s + 0.004 * time_s**2
    return np.column_stack([(20 + 0.1 * time_s) * np.cos(angle), 15 * np.sin(angle), 8 * np.sin(0.13 * time_s)])


def spiral_path() -> SampledPath:
    t = np.arange(0, 60 * 50) / 50
    velocity = (spiral(t + 1e-5) - spiral(t - 1e-5)) / 2e-5
    world = SIMILARITY.inverse()
    position, velocity = world.apply(spiral(t)), velocity @ SIMILARITY.rotation / SIMILARITY.scale
    return SampledPath(t, position, velocity, np.zeros(len(t), int), np.full(len(t), 3), np.full(len(t), 0.01))


def test_everything_at_once_goes_to_json_and_to_text():
    truth = spiral(np.arange(250) / 5 + 4.0) + 0.02 * np.random.default_rng(0).normal(size=(250, 3))
    known = {camera: SIMILARITY.apply(centre) for camera, centre in CENTRES.items()}
    known["a"] = known["a"] + [0.5, 0, 0]
    clocks = {"a": Clock(0.0, 0.04), "b": Clock(0.01, 0.02)}
    evaluation = evaluate(
        spiral_path(),
        truth=truth,
        rate_hz=5.0,
        centres={camera: CENTRES[camera] for camera in "abc"},
        known_centres=known,
        centres_share_truth_frame=True,
        rotations={"a": np.eye(3), "b": so3_exp(np.array([0.0, 0.01, 0.0]))},
        known_rotations={"a": np.eye(3), "b": np.eye(3)},
        clocks=clocks,
        known_synchronisation={"a": (1.0, 0.0), "b": (2.0, 0.0)},
    )
    assert evaluation.trajectory is not None
    assert evaluation.trajectory.complete.clock.offset_s == pytest.approx(4.0, abs=0.005)
    assert evaluation.centres_in_truth_frame is not None
    assert evaluation.centres_in_truth_frame.error["a"] == pytest.approx(0.5, abs=0.05)
    assert evaluation.notes == ("cameras with known position that were not reconstructed: d",)
    out = json.loads(json.dumps(evaluation.as_dict(), allow_nan=False))
    assert out["trajectory"]["all"]["mean"] == pytest.approx(0.032, abs=0.003)
    assert out["trajectory"]["all"]["n"] == 250
    assert out["trajectory"]["all"]["by_n_cameras"][0]["low"] == 3
    assert out["trajectory"]["without_errors_above_10_means"]["n_dropped"] == 0
    assert out["camera_centres_in_truth_frame"]["by_camera"]["b"] < 0.05
    assert out["camera_centres_aligned"]["mean"] < out["camera_centres_in_truth_frame"]["max"]
    assert out["synchronisation"]["by_camera"]["b"]["mean_s"] == pytest.approx(0.01)
    assert out["camera_orientations_aligned"]["by_camera_deg"]["b"] == pytest.approx(np.degrees(0.005))
    assert out["trajectory"]["all"]["velocity"]["n"] == 248
    text = format_table(evaluation)
    assert "velocity (cm/s)" in text
    assert "Camera orientations after aligning them (degrees)" in text
    mean_cm = 100 * evaluation.trajectory.complete.statistics.mean
    assert "Trajectory error (cm)" in text
    assert any(line.startswith("all covered samples") and f"{mean_cm:.2f}" in line for line in text.splitlines())
    assert "Covered: 250 of 250 truth samples (100 %)" in text
    assert "seen by 3 cameras" in text
    assert "deviation 3 to 3 cm" in text
    assert "Synchronisation with a" in text
    assert "Note: cameras with known position that were not reconstructed: d" in text
    assert "Trajectory error (ft)" in format_table(evaluation, unit="ft")
    assert max(len(line) for line in text.splitlines()) <= 120


def test_what_cannot_be_judged_ends_in_a_note():
    path = spiral_path()
    evaluation = evaluate(path, centres={}, known_centres=CENTRES, clocks={}, known_synchronisation={"a": (1.0, 0.0)})
    assert evaluation.trajectory is None
    assert evaluation.centres_aligned is None
    assert evaluation.synchronisation is None
    assert any("at least 3 cameras" in note for note in evaluation.notes)
    assert any("at least 2 cameras" in note for note in evaluation.notes)
    assert format_table(evaluation).startswith("Note: ")
    with pytest.raises(ValueError, match="rate_hz"):
        evaluate(path, truth=np.zeros((50, 3)))


def test_a_truth_of_another_flight_is_suspected():
    other = np.random.default_rng(1).normal(size=(300, 3)).cumsum(axis=0)
    notes = evaluate(spiral_path(), truth=other, rate_hz=5.0).notes
    assert any("may not belong together" in note for note in notes)
    assert any("less than half of what could overlap" in note for note in notes)
    assert any("another offset" in note for note in notes)
