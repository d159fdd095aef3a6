"""Epipolar geometry with an unknown time shift: the minimal solver, and RANSAC around it."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.geometry.epipolar import essential_matrix, homogeneous, sampson_error
from skytrace.geometry.rigid import Rigid, so3_exp
from skytrace.solvers.ransac import ransac
from skytrace.solvers.time_shift import TimeShiftProblem, eight_point, eight_point_time_shift

MAX_SHIFT_S = 0.5


def shifted_pair(rng, n, max_shift_s=MAX_SHIFT_S):
    """Unit-norm matrix, shift, positions in both views and velocities, with x1 + shift v1 where the truth has it."""
    centre = rng.normal(size=3) * [1, 1, 0.3]
    pose = Rigid.from_centre(so3_exp(rng.normal(0, 0.25, 3)), centre / np.linalg.norm(centre))
    point = np.column_stack([rng.uniform(-2, 2, (n, 2)), rng.uniform(4, 8, n)])
    moved = pose.apply(point)
    velocity1 = rng.normal(0, 0.1, (n, 2))
    shift_s = rng.uniform(-0.95, 0.95) * max_shift_s
    E = essential_matrix(pose)
    xy1 = moved[:, :2] / moved[:, 2:] - shift_s * velocity1
    return E / np.linalg.norm(E), shift_s, point[:, :2] / point[:, 2:], xy1, velocity1


def same_up_to_sign(F, E):
    return min(np.abs(F - E).max(), np.abs(F + E).max())


def test_minimal_samples_contain_the_truth(rng):
    found = 0
    for _ in range(200):
        E, shift_s, xy0, xy1, velocity1 = shifted_pair(rng, 8)
        F, shift = eight_point_time_shift(xy0[None], xy1[None], velocity1[None], MAX_SHIFT_S)
        found += any(same_up_to_sign(f, E) < 1e-6 and abs(s - shift_s) < 1e-6 for f, s in zip(F, shift, strict=True))
    assert found >= 196


def test_every_solution_satisfies_its_equations(rng):
    count = 0
    for _ in range(100):
        xy0, xy1 = rng.uniform(-0.5, 0.5, (2, 8, 2))  # no scene behind it at all
        velocity1 = rng.normal(0, 0.3, (8, 2))
        F, shift = eight_point_time_shift(xy0[None], xy1[None], velocity1[None], MAX_SHIFT_S)
        assert len(F) == len(shift) <= 16
        for f, s in zip(F, shift, strict=True):
            x1 = homogeneous(xy1 + s * velocity1)
            assert np.abs(np.einsum("ni,ij,nj->n", x1, f, homogeneous(xy0))).max() < 1e-8
            assert abs(np.linalg.det(f)) < 1e-8
            assert np.linalg.norm(f) == pytest.approx(1)
            assert abs(s) <= MAX_SHIFT_S
            count += 1
    assert count > 100


def test_samples_are_solved_independently(rng):
    pairs = [shifted_pair(rng, 8) for _ in range(6)]
    stacks = [np.stack([p[i] for p in pairs]) for i in (2, 3, 4)]
    together = eight_point_time_shift(*stacks, MAX_SHIFT_S)[1]
    alone = [eight_point_time_shift(*(s[i : i + 1] for s in stacks), MAX_SHIFT_S)[1] for i in range(6)]
    np.testing.assert_allclose(np.sort(together), np.sort(np.concatenate(alone)), rtol=0, atol=1e-8)


def test_shifts_beyond_the_limit_are_not_reported(rng):
    for _ in range(20):
        _, shift_s, xy0, xy1, velocity1 = shifted_pair(rng, 8)
        for limit in (0.5 * abs(shift_s), 0.9995 * abs(shift_s)):
            shift = eight_point_time_shift(xy0[None], xy1[None], velocity1[None], limit)[1]
            assert (np.abs(shift) <= limit).all()


def test_degenerate_samples_give_no_nonsense(rng):
    _, _, xy0, xy1, velocity1 = shifted_pair(rng, 8)
    xy0[:], xy1[:] = xy0[0], xy1[0]  # one correspondence eight times
    still = np.zeros_like(velocity1)
    for v in (velocity1, still):
        F, shift = eight_point_time_shift(xy0[None], xy1[None], v[None], MAX_SHIFT_S)
        assert np.isfinite(F).all()
        assert np.isfinite(shift).all()
    empty = np.zeros((0, 8, 2))
    F, shift = eight_point_time_shift(empty, empty, empty, MAX_SHIFT_S)
    assert F.shape == (0, 3, 3)
    assert shift.shape == (0,)


@pytest.mark.parametrize("seed", range(5))
def test_ransac_finds_geometry_and_shift_among_forty_percent_outliers(seed):
    rng = np.random.default_rng(seed)
    n = 150
    E, shift_s, xy0, xy1, velocity1 = shifted_pair(rng, n)
    xy0, xy1 = xy0 + rng.normal(0, 3e-4, (n, 2)), xy1 + rng.normal(0, 3e-4, (n, 2))
    wrong = rng.permutation(n)[:60]
    xy1[wrong] = rng.uniform(-0.5, 0.5, (60, 2))
    found = ransac(TimeShiftProblem(xy0, xy1, velocity1, MAX_SHIFT_S), 2e-3, rng, max_samples=1500)
    assert found is not None
    assert found.model[9] == pytest.approx(shift_s, abs=0.01)
    assert same_up_to_sign(found.model[:9].reshape(3, 3), E) < 0.02
    good = np.ones(n, bool)
    good[wrong] = False
    assert found.inlier[good].mean() > 0.98
    assert found.inlier[wrong].mean() < 0.1


def test_too_few_correspondences_give_no_model(rng):
    _, _, xy0, xy1, velocity1 = shifted_pair(rng, 7)
    assert ransac(TimeShiftProblem(xy0, xy1, velocity1, MAX_SHIFT_S), 1e-3, rng) is None


def test_refinement_uses_all_inliers_and_stays_within_the_limit(rng):
    E, shift_s, xy0, xy1, velocity1 = shifted_pair(rng, 80)
    problem = TimeShiftProblem(xy0, xy1, velocity1, MAX_SHIFT_S)
    truth = np.append(E.ravel(), shift_s)
    np.testing.assert_allclose(problem.residuals(truth[None]), 0, rtol=0, atol=1e-12)
    started_near = np.append(E.ravel(), shift_s + 0.02)
    refined = problem.refine(started_near, np.ones(80, bool))
    assert abs(refined[9] - shift_s) < 0.004  # alternation closes in, a few steps at a time
    assert abs(np.linalg.det(refined[:9].reshape(3, 3))) < 1e-12
    assert problem.refine(truth, np.arange(80) < 15) is None
    tight = TimeShiftProblem(xy0, xy1, velocity1, 0.01)
    assert abs(tight.refine(np.append(E.ravel(), 0.0), np.ones(80, bool))[9]) <= 0.01


def test_residuals_are_sampson_errors_of_shifted_positions(rng):
    _, _, xy0, xy1, velocity1 = shifted_pair(rng, 10)
    models = rng.normal(size=(3, 10))
    residuals = TimeShiftProblem(xy0, xy1, velocity1, MAX_SHIFT_S).residuals(models)
    assert residuals.shape == (3, 10)
    expected = sampson_error(models[1, :9].reshape(3, 3), xy0, xy1 + models[1, 9] * velocity1)
    np.testing.assert_allclose(residuals[1], expected, rtol=0, atol=1e-14)


def test_eight_point_is_exact_on_exact_data_and_of_rank_two_on_noisy_data(rng):
    E, shift_s, xy0, xy1, velocity1 = shifted_pair(rng, 20)
    exact = xy1 + shift_s * velocity1
    assert same_up_to_sign(eight_point(xy0, exact), E) < 1e-7
    F = eight_point(xy0, exact + rng.normal(0, 1e-3, exact.shape))
    assert np.linalg.svd(F)[1][2] < 1e-12
    assert np.linalg.norm(F) == pytest.approx(1)
    assert same_up_to_sign(F, E) < 0.1
