"""Known clocks, similarities and errors are found again, blind."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from skytrace.evaluation.path import SampledPath
from skytrace.evaluation.trajectory import TrajectoryEvaluation, evaluate_trajectory
from skytrace.geometry.rigid import Similarity, align_similarity, so3_exp


@dataclass(frozen=True)
class Case:
    path: SampledPath
    truth: np.ndarray
    rate_hz: float
    offset_s: float
    scale: float
    truth_from_world: Similarity

    def clock_error_s(self, evaluation: TrajectoryEvaluation) -> float:
        """Error of the fitted clock at the middle of the overlap."""
        errors = evaluation.complete
        middle_s = errors.truth_index.mean() / self.rate_hz
        return float(errors.clock.time_s(np.array(middle_s)) - self.offset_s - self.scale * middle_s)


def wandering(rng: np.random.Generator, duration_s: float) -> CubicSpline:
    """A smooth flight that does not repeat itself: tens of metres wide, turning every few seconds."""
    knots = np.arange(-5.0, duration_s + 5.0, 2.5)
    target = rng.normal(size=(len(knots), 3)) * [20, 20, 6]
    return CubicSpline(knots, np.cumsum(0.5 * target, axis=0) * 0.3 + target * 0.5)


def make_case(
    rng: np.random.Generator,
    truth_s: float = 150.0,
    begin_s: float = 40.0,
    covered_s: float = 80.0,
    rate_hz: float = 5.0,
    scale: float | None = None,
    flight: CubicSpline | None = None,
) -> Case:
    """The truth's samples and a faultless reconstruction of the stretch from begin_s on, with two gaps."""
    flight = wandering(rng, truth_s) if flight is None else flight
    truth = flight(np.arange(int(truth_s * rate_hz)) / rate_hz)
    scale = 1 + rng.uniform(-0.009, 0.009) if scale is None else scale
    offset_s = rng.uniform(-1000, 1000)
    elapsed_s = begin_s + np.arange(int(covered_s * 50)) / 50
    s = Similarity(np.exp(rng.normal()), so3_exp(2 * rng.normal(size=3)), 50 * rng.normal(size=3))
    velocity_scale = scale * s.scale
    position = s.inverse().apply(flight(elapsed_s))
    velocity = flight(elapsed_s, 1) @ s.rotation / velocity_scale
    share = (elapsed_s - begin_s) / covered_s
    segment = np.searchsorted([0.3, 0.6], share)
    keep = (np.abs(share - 0.3) > 0.01) & (np.abs(share - 0.6) > 0.01)
    time_s = offset_s + scale * elapsed_s
    path = SampledPath(time_s[keep], position[keep], velocity[keep], segment[keep])
    return Case(path, truth, rate_hz, offset_s, scale, s)


def with_noise(case: Case, rng: np.random.Generator, sigma: float, knot_s: float = 1.0) -> tuple[Case, CubicSpline]:
    """The case with smooth errors of `sigma` per axis in the truth's unit, and these errors over time."""
    t = case.path.time_s
    knots = np.arange(t[0] - 2 * knot_s, t[-1] + 3 * knot_s, knot_s)
    noise = CubicSpline(knots, sigma * rng.normal(size=(len(knots), 3)))
    back = case.truth_from_world.rotation / case.truth_from_world.scale
    position, velocity = case.path.position + noise(t) @ back, case.path.velocity + noise(t, 1) @ back
    return replace(case, path=replace(case.path, position=position, velocity=velocity)), noise


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1.0, 5.0, 23.7]))
def test_a_faultless_reconstruction_has_no_error(seed: int, rate_hz: float):
    case = make_case(np.random.default_rng(seed), rate_hz=rate_hz)
    evaluation = evaluate_trajectory(case.path, case.truth, rate_hz)
    errors = evaluation.complete
    assert errors.statistics.max < 1e-6
    assert errors.clock.offset_s == pytest.approx(case.offset_s, abs=1e-6)
    assert errors.clock.scale == pytest.approx(case.scale, abs=1e-8)
    assert errors.truth_from_world.scale == pytest.approx(case.truth_from_world.scale, rel=1e-6)
    np.testing.assert_allclose(errors.truth_from_world.rotation, case.truth_from_world.rotation, atol=1e-6)
    np.testing.assert_allclose(errors.truth_from_world.translation, case.truth_from_world.translation, atol=1e-4)
    elapsed_s = np.arange(float(len(case.truth))) / rate_hz
    covered = case.path.locate(case.offset_s + case.scale * elapsed_s)[1]
    assert abs(errors.statistics.n - covered.sum()) <= 6  # a sample within rounding of one of six segment ends
    assert errors.n_total == len(case.truth)
    assert evaluation.rival_score < 0.9


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_injected_errors_come_out_as_they_went_in(seed: int):
    rng = np.random.default_rng(seed)
    case, noise = with_noise(make_case(rng), rng, 0.03)
    evaluation = evaluate_trajectory(case.path, case.truth, case.rate_hz)
    errors = evaluation.complete
    injected = np.linalg.norm(noise(errors.time_s), axis=1)
    assert errors.statistics.mean == pytest.approx(injected.mean(), rel=0.1)  # nine parameters absorb a few per cent
    assert errors.statistics.mean <= errors.statistics.rmse <= np.sqrt((injected**2).mean())
    assert abs(case.clock_error_s(evaluation)) < 6 * np.sqrt(5) * errors.clock.shift_sd_s
    np.testing.assert_allclose(errors.error, np.linalg.norm(errors.error_vector, axis=1))
    np.testing.assert_allclose(errors.time_s, errors.clock.time_s(errors.truth_index / case.rate_hz))


def test_the_fit_is_a_minimum():
    """No other clock leaves a smaller sum of squares on the same samples."""
    rng = np.random.default_rng(5)
    case, _ = with_noise(make_case(rng), rng, 0.5)
    errors = evaluate_trajectory(case.path, case.truth, case.rate_hz).complete
    elapsed_s = errors.truth_index[5:-5] / case.rate_hz  # away from the ends, so that the set of samples stays
    inner = np.isin(errors.truth_index, errors.truth_index[5:-5])

    def mean_square(shift_s: float, stretch: float) -> float:
        t = errors.clock.time_s(elapsed_s) + shift_s + stretch * (elapsed_s - elapsed_s.mean())
        points = case.path.evaluate(t)[0]
        seen = np.isfinite(points[:, 0])
        truth = case.truth[errors.truth_index[inner]][seen]
        residual = truth - align_similarity(points[seen], truth).apply(points[seen])
        return float((residual**2).sum(1).mean())

    best = mean_square(0.0, 0.0)
    assert all(mean_square(shift, 0.0) > best for shift in (-0.05, 0.05))
    assert all(mean_square(0.0, stretch) > best for stretch in (-2e-3, 2e-3))


def test_a_truth_that_stands_still_before_and_after_is_aligned_by_its_flight():
    rng = np.random.default_rng(8)
    case = make_case(rng, scale=1.0003)
    still = np.repeat(case.truth[:1], 600, axis=0), np.repeat(case.truth[-1:], 900, axis=0)
    truth = np.concatenate([still[0], case.truth, still[1]]) + 0.01 * rng.normal(size=(2250, 3))
    evaluation = evaluate_trajectory(case.path, truth, case.rate_hz)
    clock = evaluation.complete.clock
    assert clock.time_s(np.array(160.0)) == pytest.approx(case.offset_s + case.scale * 40.0, abs=0.005)
    assert evaluation.complete.n_total == 2250


def test_truth_samples_without_a_position_are_left_out():
    case = make_case(np.random.default_rng(9))
    truth = case.truth.copy()
    truth[210:240] = np.nan
    whole = evaluate_trajectory(case.path, case.truth, case.rate_hz).complete
    errors = evaluate_trajectory(case.path, truth, case.rate_hz).complete
    assert errors.clock.offset_s == pytest.approx(case.offset_s, abs=1e-6)
    assert errors.n_total == len(truth) - 30
    expected = np.setdiff1d(whole.truth_index, np.arange(210, 240))
    np.testing.assert_array_equal(errors.truth_index, expected)


def test_errors_above_ten_means_are_dropped_and_the_rest_fitted_again():
    rng = np.random.default_rng(10)
    case = make_case(rng)
    truth = case.truth + 0.01 * rng.normal(size=case.truth.shape)
    clean = evaluate_trajectory(case.path, truth, case.rate_hz)
    assert clean.without_large.n_dropped == 0
    assert clean.without_large.statistics == clean.complete.statistics
    wrong = clean.complete.truth_index[[50, 51, 200]]
    spoilt = truth.copy()
    # The third stands out only once the first two are gone; the fourth, at seven times the mean, never does.
    spoilt[wrong] += [[8.0, 0, 0], [0, 8.0, 0], [0, 0, -0.6]]
    tolerated = clean.complete.truth_index[250]
    spoilt[tolerated] = case.truth[tolerated] + np.array([0, 0.11, 0])
    evaluation = evaluate_trajectory(case.path, spoilt, case.rate_hz)
    assert abs(evaluation.complete.statistics.n - clean.complete.statistics.n) <= 1  # a sample at a segment's end
    assert evaluation.complete.statistics.max > 7.5
    assert evaluation.complete.n_dropped == 0
    kept = evaluation.without_large
    assert kept.n_dropped == 3
    assert not set(kept.truth_index) & set(wrong)
    assert tolerated in kept.truth_index
    assert abs(kept.statistics.n - (clean.complete.statistics.n - 3)) <= 1
    assert kept.statistics.mean == pytest.approx(clean.complete.statistics.mean, rel=0.03)
    assert kept.clock.offset_s == pytest.approx(clean.complete.clock.offset_s, abs=1e-3)


def test_points_thrown_to_the_horizon_do_not_hide_the_match():
    rng = np.random.default_rng(11)
    case, _ = with_noise(make_case(rng), rng, 0.02)
    position = case.path.position.copy()
    position[500:560] += 3000 / case.truth_from_world.scale
    position[2000] += 1e6 / case.truth_from_world.scale
    path = replace(case.path, position=position)
    evaluation = evaluate_trajectory(path, case.truth, case.rate_hz)
    assert evaluation.without_large.statistics.mean < 0.05
    assert evaluation.without_large.clock.offset_s == pytest.approx(case.offset_s, abs=0.02)
    assert 5 <= evaluation.without_large.n_dropped <= 10


def test_a_mirror_image_keeps_its_error():
    case = make_case(np.random.default_rng(12))
    mirror = np.array([1.0, 1.0, -1.0])
    path = replace(case.path, position=case.path.position * mirror, velocity=case.path.velocity * mirror)
    errors = evaluate_trajectory(path, case.truth, case.rate_hz).complete
    assert np.linalg.det(errors.truth_from_world.rotation) == pytest.approx(1.0)
    assert errors.unexplained > 0.005


def test_the_scale_of_the_clock_stays_inside_its_limit():
    case = make_case(np.random.default_rng(13), scale=1.02)
    clock = evaluate_trajectory(case.path, case.truth, case.rate_hz).complete.clock
    assert clock.scale == pytest.approx(1.01, abs=1e-12)
    wider = evaluate_trajectory(case.path, case.truth, case.rate_hz, max_scale_error=0.03).complete
    assert wider.clock.scale == pytest.approx(1.02, abs=1e-8)


def test_a_circle_at_constant_speed_determines_no_clock():
    t = np.arange(-100, 100 * 50) / 50

    def circle(time_s: np.ndarray) -> np.ndarray:
        return np.column_stack([10 * np.cos(0.3 * time_s), 10 * np.sin(0.3 * time_s), np.zeros(len(time_s))])

    velocity = 0.3 * circle(t + np.pi / 0.6)
    path = SampledPath(t, circle(t), velocity, np.zeros(len(t), int))
    evaluation = evaluate_trajectory(path, circle(np.arange(300) / 5), 5.0)
    assert evaluation.complete.clock.shift_sd_s == float("inf")
    assert evaluation.rival_score > 0.9
    assert evaluation.complete.statistics.mean < 1e-6


def test_breakdowns_cover_every_sample():
    rng = np.random.default_rng(14)
    case, _ = with_noise(make_case(rng), rng, 0.05)
    n = len(case.path.time_s)
    n_cameras = np.where(np.arange(n) < n // 2, 2, 4)
    sigma = np.linspace(1, 3, n) / case.truth_from_world.scale
    path = replace(case.path, n_cameras=n_cameras, sigma=sigma)
    errors = evaluate_trajectory(path, case.truth, case.rate_hz).complete
    assert [group.low for group in errors.by_n_cameras] == [2, 4]
    assert sum(group.statistics.n for group in errors.by_n_cameras) == errors.statistics.n
    groups = errors.by_sigma
    assert sum(group.statistics.n for group in groups) == errors.statistics.n
    assert 1.0 <= groups[0].low < groups[0].high < groups[-1].low < groups[-1].high == pytest.approx(3.0, abs=0.1)
    bare = evaluate_trajectory(case.path, case.truth, case.rate_hz).complete
    assert bare.by_n_cameras == ()
    assert bare.by_sigma == ()


@pytest.mark.parametrize("covered_s", [1.5, 6.0])
def test_short_overlaps_are_refused_or_matched(covered_s: float):
    case = make_case(np.random.default_rng(15), covered_s=covered_s, scale=1.0)
    if covered_s < 2.0:
        with pytest.raises(ValueError, match=r"covers 1\.\d s and the truth 150\.0 s: at least 2\.0 s"):
            evaluate_trajectory(case.path, case.truth, case.rate_hz)
    else:
        errors = evaluate_trajectory(case.path, case.truth, case.rate_hz).complete
        assert errors.statistics.n <= 30


def test_input_that_cannot_be_judged_is_refused():
    case = make_case(np.random.default_rng(16))
    with pytest.raises(ValueError, match="at least 10 positions, got 9"):
        evaluate_trajectory(case.path, case.truth[:9], case.rate_hz)
    with pytest.raises(ValueError, match="rate_hz: expected a positive number"):
        evaluate_trajectory(case.path, case.truth, 0.0)
    with pytest.raises(ValueError, match=r"truth: expected shape \(n, 3\)"):
        evaluate_trajectory(case.path, case.truth[:, :2], case.rate_hz)
    hovering = replace(case.path, position=np.ones_like(case.path.position), velocity=0 * case.path.velocity)
    with pytest.raises(ValueError, match="no offset of the truth's clock"):
        evaluate_trajectory(hovering, case.truth, case.rate_hz)


def test_ten_minutes_are_evaluated_in_well_under_two_seconds():
    rng = np.random.default_rng(17)
    case, _ = with_noise(make_case(rng, truth_s=660.0, begin_s=30.0, covered_s=600.0), rng, 0.05)
    begin_s = time.process_time()
    evaluation = evaluate_trajectory(case.path, case.truth, case.rate_hz)
    assert time.process_time() - begin_s < 1.5
    assert evaluation.complete.statistics.mean < 0.12


@pytest.mark.real
@pytest.mark.parametrize("dataset", [1, 3])
def test_a_stretch_of_a_real_flight_is_found_in_its_own_truth(data_dir: Path, dataset: int):
    truth = np.loadtxt(data_dir / f"drone-tracking/dataset{dataset}/trajectory/rtk.txt")
    rate_hz, rng = 5.0, np.random.default_rng(dataset)
    speed = rate_hz * np.linalg.norm(np.diff(truth, axis=0), axis=1)
    window = int(150 * rate_hz)
    first = int(np.argmax(np.convolve(np.minimum(speed, 10.0), np.ones(window), "valid")))
    flight = CubicSpline(np.arange(len(truth)) / rate_hz, truth)
    stretch = make_case(
        rng, len(truth) / rate_hz, first / rate_hz, window / rate_hz, rate_hz, scale=1.0003, flight=flight
    )
    case, noise = with_noise(replace(stretch, truth=truth), rng, 0.03)
    evaluation = evaluate_trajectory(case.path, truth, rate_hz)
    errors = evaluation.complete
    injected = np.linalg.norm(noise(errors.time_s), axis=1)
    assert abs(case.clock_error_s(evaluation)) < 0.005
    assert errors.clock.scale == pytest.approx(1.0003, abs=2e-4)
    assert errors.statistics.mean == pytest.approx(injected.mean(), rel=0.03)
    assert evaluation.rival_score < 0.5
