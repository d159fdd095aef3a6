"""Two cameras: correspondences in time, and the recovery of pose, offset and clock rate."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from skytrace.estimation import two_view
from skytrace.estimation.clean import CleanSettings, clean_detections
from skytrace.estimation.correspond import ImagePath, image_path
from skytrace.geometry.epipolar import essential_matrix, sampson_error
from skytrace.geometry.rigid import Rigid, so3_exp, so3_log
from skytrace.simulation import Scenario, simulate

EXACT = Scenario(
    duration_s=40.0, n_cameras=2, frame_rates_hz=(60.0,), speed_m_s=4.0, noise_px=0.0, focal_error=0.0,
    readout_fraction=0.0, clock_drift=3e-4, offset_range_s=30.0,
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Pair:
    path0: ImagePath
    path1: ImagePath
    pose: Rigid
    offset_s: float
    rate: float


def simulated_pair(seed, scenario=EXACT):
    flight = simulate(scenario, np.random.default_rng(seed))
    paths = []
    for r in flight.recordings:
        (track,) = r.tracks
        cleaned = clean_detections(track.frame, track.xy_px, r.frame_rate_hz, r.intrinsics.size_px, CleanSettings())
        paths.append(image_path(dataclasses.replace(r, tracks=cleaned.tracklets), 0.0))
    camera0, camera1 = flight.truth.cameras.values()
    pose = camera1.camera_from_world @ camera0.camera_from_world.inverse()
    pose = Rigid(pose.rotation, pose.translation / np.linalg.norm(pose.translation))
    # World time offset + period frame, camera time frame / nominal rate.
    period0 = camera0.clock.period_s * camera0.frame_rate_hz
    period1 = camera1.clock.period_s * camera1.frame_rate_hz
    offset = (camera0.clock.offset_s - camera1.clock.offset_s) / period1
    return Pair(paths[0], paths[1], pose, offset, period0 / period1)


def pose_error(found, true):
    turn = np.linalg.norm(so3_log(found.rotation @ true.rotation.T))
    return max(turn, np.linalg.norm(found.translation - true.translation))


def disturbed(pose, rng, size=0.03):
    baseline = pose.translation + rng.normal(0, size, 3)
    return Rigid(so3_exp(rng.normal(0, size, 3)) @ pose.rotation, baseline / np.linalg.norm(baseline))


def refine(pair, pose, offset_s, rate=1.0, **options):
    given = {"rate_hz": 15.0, "thresholds": (0.02, 0.006, 0.003), "rate_prior": 1.0, "iterations": 25}
    return two_view.refine(pair.path0, pair.path1, pose, offset_s, rate, **{**given, **options})


@pytest.fixture(scope="module")
def pair():
    return simulated_pair(1)


def test_correspondences_obey_the_true_geometry(pair):
    pairs = two_view.correspond(pair.path0, pair.path1, 15.0, pair.offset_s, pair.rate)
    t = np.arange(-5000, 5000) / 15
    both = np.isfinite(pair.path0.evaluate(t)[:, 0] + pair.path1.evaluate(pair.offset_s + pair.rate * t)[:, 0])
    np.testing.assert_allclose(pairs.time0_s, t[both], rtol=0, atol=1e-9)
    assert len(pairs) > 500
    np.testing.assert_allclose(pairs.time1_s, pair.offset_s + pair.rate * pairs.time0_s, rtol=0, atol=1e-12)
    np.testing.assert_allclose(pairs.time0_s * 15, np.rint(pairs.time0_s * 15), rtol=0, atol=1e-7)
    error = sampson_error(essential_matrix(pair.pose), pairs.xy0, pairs.xy1)
    assert np.abs(error).max() < 1e-7
    np.testing.assert_array_equal(pairs.velocity1, pair.path1.evaluate(pairs.time1_s, 1))
    assert two_view.support(pair.pose, pairs, 0.003).min() > 0.999
    assert two_view.inliers(pair.pose, pairs, 0.003).all()
    late = two_view.correspond(pair.path0, pair.path1, 15.0, pair.offset_s + 25.0, pair.rate)
    assert 180 < len(late) < 240  # some 15 s of common view are left


def test_no_overlap_no_correspondences(pair):
    pairs = two_view.correspond(pair.path0, pair.path1, 15.0, pair.offset_s + 1000.0, 1.0)
    assert len(pairs) == 0
    assert two_view.five_point_pose(pairs, 0.01, seed=0) is None
    assert refine(pair, pair.pose, pair.offset_s + 1000.0) is None


def test_thinning_keeps_the_ends_and_the_pairing(pair):
    pairs = two_view.correspond(pair.path0, pair.path1, 15.0, pair.offset_s, pair.rate)
    few = two_view.thin(pairs, 50)
    assert len(few) == 50
    rows = np.searchsorted(pairs.time0_s, few.time0_s)
    assert (rows[0], rows[-1]) == (0, len(pairs) - 1)
    assert np.ptp(np.diff(rows)) <= 1
    for name in ("time1_s", "xy0", "xy1", "velocity1"):
        np.testing.assert_array_equal(getattr(few, name), getattr(pairs, name)[rows])
    assert two_view.thin(few, 50) is few


@pytest.mark.parametrize("seed", range(4))
def test_refinement_recovers_pose_offset_and_rate_of_exact_tracks(seed):
    rng = np.random.default_rng(seed)
    pair = simulated_pair(seed)
    found = refine(pair, disturbed(pair.pose, rng), pair.offset_s + rng.uniform(-0.5, 0.5))
    assert found is not None
    assert pose_error(found.camera1_from_camera0, pair.pose) < 1e-6
    assert np.linalg.norm(found.camera1_from_camera0.translation) == pytest.approx(1)
    assert found.rate == pytest.approx(pair.rate, abs=1e-7)
    at_centre = found.offset_s + found.rate * found.centre_s
    assert at_centre == pytest.approx(pair.offset_s + pair.rate * found.centre_s, abs=1e-6)
    assert found.support_s == pytest.approx(found.overlap_s, rel=1e-6)


def test_refinement_is_not_misled_by_outliers(pair, rng):
    """A fifth of camera 1's path is replaced by another place."""
    broken = np.array(pair.path1.coefficients)
    breaks = pair.path1.breaks_s
    wrong = (np.floor(breaks[:-1] / 2) % 5) == 0
    broken[3, wrong] += rng.uniform(0.05, 0.2, 2)
    path1 = dataclasses.replace(pair.path1, coefficients=broken)
    found = refine(dataclasses.replace(pair, path1=path1), disturbed(pair.pose, rng, 0.01), pair.offset_s + 0.1)
    assert pose_error(found.camera1_from_camera0, pair.pose) < 0.01
    assert found.offset_s + found.rate * found.centre_s == pytest.approx(
        pair.offset_s + pair.rate * found.centre_s, abs=0.02
    )
    assert 0.7 < found.support_s / found.overlap_s < 0.9


def test_the_rate_prior_pulls_towards_the_nominal_rate(pair):
    held = refine(pair, pair.pose, pair.offset_s, rate_prior=1e-7)
    free = refine(pair, pair.pose, pair.offset_s)
    assert abs(held.rate - 1) < 0.05 * abs(pair.rate - 1)
    assert free.rate == pytest.approx(pair.rate, abs=1e-7)
    assert held.rate_sigma < 2e-7


def objective(pair, geometry, threshold, rate_prior, offset_s=0.0, rate=0.0):
    """Half the sum of Cauchy losses, the prior among them, the offset at the centre and the rate moved a little."""
    r = geometry.rate + rate
    o = geometry.offset_s + offset_s - rate * geometry.centre_s
    pairs = two_view.correspond(pair.path0, pair.path1, 15.0, o, r)
    error = sampson_error(essential_matrix(geometry.camera1_from_camera0), pairs.xy0, pairs.xy1)
    return 0.5 * np.log1p((error / threshold) ** 2).sum() + 0.5 * np.log1p(((r - 1) / rate_prior) ** 2)


def test_refinement_ends_where_data_and_prior_balance(pair):
    rate_prior = 2e-3  # about as strong as the data
    found = refine(pair, pair.pose, pair.offset_s, thresholds=(0.003,), rate_prior=rate_prior, iterations=100)
    assert 0.1 < (found.rate - 1) / (pair.rate - 1) < 0.9
    least = objective(pair, found, 0.003, rate_prior)
    for offset_s, rate in ((1e-4, 0), (0, 1e-6)):
        ahead, behind = (objective(pair, found, 0.003, rate_prior, s * offset_s, s * rate) - least for s in (1, -1))
        assert min(ahead, behind) > 0
        assert ahead == pytest.approx(behind, rel=0.01)  # the slope vanishes


@pytest.mark.parametrize("seed", range(6))
def test_no_iteration_of_the_refinement_makes_it_worse(pair, seed):
    rng = np.random.default_rng(seed)
    start, offset_s = disturbed(pair.pose, rng, 0.3), pair.offset_s + rng.uniform(-3, 3)
    time0 = two_view.common_times(pair.path0, pair.path1, 15.0, offset_s, 1.0)  # those of the whole pass
    costs = []
    for n in range(8):
        found = refine(pair, start, offset_s, thresholds=(0.003,), iterations=n)
        essential = essential_matrix(found.camera1_from_camera0)
        xy1 = pair.path1.evaluate(found.offset_s + found.rate * time0)
        error = sampson_error(essential, pair.path0.evaluate(time0), xy1)
        seen = np.isfinite(error)
        costs.append(np.log1p((error[seen] / 0.003) ** 2).mean() + (found.rate - 1) ** 2 / seen.sum())
    assert (np.diff(costs) <= 1e-15).all()  # but for rounding at the minimum
    assert costs[-1] < costs[0]


def test_formal_deviations_match_the_scatter_of_noisy_repeats(pair):
    flight = simulate(EXACT, np.random.default_rng(1))  # one flight, seen with fresh noise again and again
    errors, sigmas = [], []
    for seed in range(30):
        noise, paths = np.random.default_rng(seed), []
        for r in flight.recordings:
            (track,) = r.tracks
            moved = dataclasses.replace(track, xy_px=track.xy_px + noise.normal(0, 0.5, track.xy_px.shape))
            paths.append(image_path(dataclasses.replace(r, tracks=(moved,)), 0.0))
        noisy = dataclasses.replace(pair, path0=paths[0], path1=paths[1])
        found = refine(noisy, pair.pose, pair.offset_s, thresholds=(0.003,))
        errors.append(found.offset_s - pair.offset_s + (found.rate - pair.rate) * found.centre_s)
        sigmas.append(found.offset_sigma_s)
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) / np.mean(sigmas) < 2.0


def test_sampson_jacobian_equals_difference_quotients(rng):
    pair = simulated_pair(2)
    pose, centre = disturbed(pair.pose, rng, 0.1), 20.0
    offset, rate = pair.offset_s + 0.2, pair.rate
    pairs = two_view.correspond(pair.path0, pair.path1, 15.0, offset, rate)
    error, J = two_view._sampson_jacobian(pose, pairs, centre)
    np.testing.assert_allclose(error, sampson_error(essential_matrix(pose), pairs.xy0, pairs.xy1), rtol=0, atol=1e-14)
    assert np.abs(error).max() > 0.01  # far from a solution, where second-order terms of a Jacobian would show
    h = 1e-6
    for k in range(7):
        sides = []
        for sign in (h, -h):
            moved, o, r = two_view._step(pose, offset, rate, centre, sign * np.eye(7)[k])
            xy1 = pair.path1.evaluate(o + r * pairs.time0_s)
            sides.append(sampson_error(essential_matrix(moved), pairs.xy0, xy1))
        numeric = (sides[0] - sides[1]) / (2 * h)
        np.testing.assert_allclose(J[:, k], numeric, rtol=0, atol=1e-6 * max(1.0, np.abs(numeric).max()))


def test_a_step_of_the_rate_leaves_the_offset_at_the_centre(pair):
    moved, offset, rate = two_view._step(pair.pose, 5.0, 1.0, 30.0, np.r_[np.zeros(5), 0.01, 1e-3])
    assert rate == 1.001
    assert offset + rate * 30.0 == pytest.approx(35.01)
    assert pose_error(moved, pair.pose) < 1e-14


def test_five_points_give_the_pose_where_the_offset_is_known(pair, rng):
    pairs = two_view.thin(two_view.correspond(pair.path0, pair.path1, 15.0, pair.offset_s, pair.rate), 200)
    xy1 = pairs.xy1.copy()
    wrong = rng.permutation(len(xy1))[:60]
    xy1[wrong] += rng.uniform(0.05, 0.3, (60, 2))
    found = two_view.five_point_pose(dataclasses.replace(pairs, xy1=xy1), 0.002, seed=0)
    assert pose_error(found, pair.pose) < 0.01
    few = two_view.thin(pairs, 9)
    assert two_view.five_point_pose(few, 0.002, seed=0) is None


def test_noise_without_a_scene_gives_no_five_point_pose(rng):
    n = 30
    t = np.arange(float(n))
    xy0, xy1 = rng.uniform(-0.5, 0.5, (2, n, 2))
    noise = two_view.Correspondences(t, t, xy0, xy1, np.zeros((n, 2)))
    assert two_view.five_point_pose(noise, 1e-5, seed=0) is None


@pytest.mark.parametrize("shift_s", [-0.2, 0.13])
def test_eight_points_find_the_pose_and_what_the_offset_lacks(pair, shift_s):
    rng = np.random.default_rng(5)
    pairs = two_view.thin(two_view.correspond(pair.path0, pair.path1, 15.0, pair.offset_s - shift_s, pair.rate), 300)
    pose, correction_s = two_view.time_shift_pose(pairs, 0.005, 0.5, rng)
    assert correction_s == pytest.approx(shift_s, abs=0.03)
    assert pose_error(pose, pair.pose) < 0.2
    assert two_view.time_shift_pose(two_view.thin(pairs, 7), 0.005, 0.5, rng) is None


def test_support_counts_only_points_in_front(pair):
    pairs = two_view.correspond(pair.path0, pair.path1, 15.0, pair.offset_s, pair.rate)
    behind = Rigid(pair.pose.rotation, -pair.pose.translation)
    assert (two_view.support(behind, pairs, 0.003) == 0).all()
    off = dataclasses.replace(pairs, xy1=pairs.xy1 + 0.002)
    error = sampson_error(essential_matrix(pair.pose), off.xy0, off.xy1)
    expected = np.maximum(0, 1 - (error / 0.003) ** 2)
    np.testing.assert_allclose(two_view.support(pair.pose, off, 0.003), expected, rtol=0, atol=1e-12)
