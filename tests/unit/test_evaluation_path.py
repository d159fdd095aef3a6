"""The sampled path: exact where it must be, silent where nothing was reconstructed."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.evaluation.path import SampledPath
from skytrace.model.trajectory import Segment, Trajectory


def cubic(time_s: np.ndarray) -> np.ndarray:
    return np.column_stack([time_s**3 - 2 * time_s, 5 - time_s**2, 0.5 * time_s + 1])


def cubic_velocity(time_s: np.ndarray) -> np.ndarray:
    return np.column_stack([3 * time_s**2 - 2, -2 * time_s, np.full(len(time_s), 0.5)])


def cubic_path(time_s: list[float], segment: list[int], **more: list[float]) -> SampledPath:
    t = np.array(time_s)
    return SampledPath(t, cubic(t), cubic_velocity(t), np.array(segment), **{k: np.array(v) for k, v in more.items()})


def test_a_cubic_is_reproduced_between_its_samples():
    path = cubic_path([0.0, 0.5, 0.7, 2.0], [0, 0, 0, 0])
    t = np.linspace(0, 2, 41)
    position, velocity = path.evaluate(t)
    np.testing.assert_allclose(position, cubic(t), atol=1e-12)
    np.testing.assert_allclose(velocity, cubic_velocity(t), atol=1e-11)


def test_nothing_is_claimed_outside_segments_but_their_ends_belong_to_them():
    path = cubic_path([0.0, 1.0, 3.0, 4.0], [0, 0, 1, 1])
    t = np.array([-1e-9, 0.0, 1.0, 1.0 + 1e-9, 2.0, 3.0 - 1e-9, 3.0, 4.0, 4.0 + 1e-9])
    inside = [False, True, True, False, False, False, True, True, False]
    position, velocity = path.evaluate(t)
    np.testing.assert_array_equal(np.isfinite(position).all(axis=1), inside)
    np.testing.assert_array_equal(np.isfinite(velocity).all(axis=1), inside)
    np.testing.assert_allclose(position[inside], cubic(t[inside]), atol=1e-12)
    assert path.covered_s == pytest.approx(2.0)


def test_segments_may_touch_and_a_lone_sample_covers_nothing():
    path = cubic_path([0.0, 1.0, 1.0, 2.0, 2.5], [0, 0, 1, 1, 2])
    position, _ = path.evaluate(np.array([0.999, 1.0, 1.001, 2.0, 2.5]))
    np.testing.assert_array_equal(np.isfinite(position[:, 0]), [True, True, True, True, False])


def test_even_times_lie_inside_segments():
    path = cubic_path([0.0, 1.0, 3.0, 4.0], [0, 0, 1, 1])
    np.testing.assert_allclose(path.even_times(2.0), [0, 0.5, 1, 3, 3.5, 4])
    np.testing.assert_allclose(cubic_path([7.0, 8.0], [0, 1]).even_times(0.1), [7.0])


def test_cameras_are_those_of_the_nearest_sample_and_deviation_is_interpolated():
    path = cubic_path([0.0, 1.0, 2.0], [0, 0, 0], n_cameras=[2, 3, 5], sigma=[1.0, 3.0, np.nan])
    t = np.array([0.0, 0.4, 0.6, 1.4, 1.9, 2.0])
    n_cameras, sigma = path.n_cameras_at(t), path.sigma_at(t)
    assert n_cameras is not None
    assert sigma is not None
    np.testing.assert_array_equal(n_cameras, [2, 2, 3, 3, 5, 5])
    np.testing.assert_allclose(sigma[:3], [1.0, 1.8, 2.2])
    assert np.isnan(sigma[3:]).all()
    assert cubic_path([0.0, 1.0], [0, 0]).n_cameras_at(t[:1]) is None


def test_samples_of_a_spline_trajectory_give_the_spline_back():
    rng = np.random.default_rng(3)
    control = rng.normal(size=(14, 3)).cumsum(axis=0)
    first = Segment(0.0, 0.2, control, 0.1, 2.0, np.linspace(1, 2, 12))
    trajectory = Trajectory((first, Segment(2.0, 0.2, control, 2.0, 4.2)))
    path = SampledPath.from_trajectory(trajectory, 50.0)
    t = np.linspace(0.1, 4.2, 400)
    np.testing.assert_allclose(path.evaluate(t)[0], trajectory.position(t), atol=1e-12)
    assert path.covered_s == pytest.approx(trajectory.covered_s)
    sigma = path.sigma_at(np.array([1.0, 3.0]))
    assert sigma is not None
    np.testing.assert_allclose(sigma, [first.sigma(np.array([1.0]))[0], np.nan])


def test_points_thrown_to_the_horizon_break_the_segment():
    t = np.arange(40) / 10
    position = np.column_stack([t, np.sin(t), np.zeros(40)])
    position[20] += 1e4
    path = SampledPath(t, position, np.zeros((40, 3)), np.zeros(40, int), np.arange(40))
    clean = path.without_far_samples()
    np.testing.assert_array_equal(clean.n_cameras, np.delete(np.arange(40), 20))
    inside = np.isfinite(clean.evaluate(np.array([1.85, 1.9, 1.95, 2.0, 2.05, 2.1, 2.15]))[0][:, 0])
    np.testing.assert_array_equal(inside, [True, True, False, False, False, True, True])
    assert clean.without_far_samples() is clean


@pytest.mark.parametrize(
    ("time_s", "segment", "message"),
    [
        ([0.0, 2.0, 1.0], [0, 0, 0], "sample 2 does not follow its predecessor"),
        ([0.0, 1.0, 1.0], [0, 0, 0], "sample 2 does not follow its predecessor"),
        ([0.0, 2.0, 1.0], [0, 0, 1], "sample 2 does not follow its predecessor"),
        ([0.0], [0], "at least 2 samples, got 1"),
    ],
)
def test_times_that_do_not_increase_are_refused(time_s: list[float], segment: list[int], message: str):
    with pytest.raises(ValueError, match=message):
        cubic_path(time_s, segment)
