"""The trajectory claims its segments and nothing between them."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.geometry.rigid import Similarity, so3_exp
from skytrace.model.trajectory import Segment, Trajectory


def random_segment(rng, start_s=10.0, begin_s=10.3, end_s=11.6, **fields):
    return Segment(start_s, 0.2, rng.normal(size=(12, 3)), begin_s, end_s, **fields)


def two_segments(rng):
    first = random_segment(rng, knot_sigma=np.linspace(0.1, 1.0, 10))
    return Trajectory((first, random_segment(rng, 20.0, 20.2, 21.0, knot_sigma=np.full(10, 0.5))))


def test_derivatives_are_difference_quotients(rng):
    path = two_segments(rng)
    t, h = np.array([10.43, 10.77, 11.1, 20.55]), 1e-5
    velocity = (path.position(t + h) - path.position(t - h)) / (2 * h)
    np.testing.assert_allclose(path.velocity(t), velocity, rtol=0, atol=1e-6)
    acceleration = (path.velocity(t + h) - path.velocity(t - h)) / (2 * h)
    np.testing.assert_allclose(path.acceleration(t), acceleration, rtol=0, atol=1e-5)


def test_segments_are_closed_and_gaps_are_nan(rng):
    path = two_segments(rng)
    t = np.array([10.29, 10.3, 11.6, 11.61, 15.0, 20.2, 21.0, 21.01])
    index = [-1, 0, 0, -1, -1, 1, 1, -1]
    np.testing.assert_array_equal(path.segment_index(t), index)
    for value in (path.position(t), path.velocity(t), path.acceleration(t)):
        np.testing.assert_array_equal(np.isfinite(value).all(axis=1), np.array(index) >= 0)
        np.testing.assert_array_equal(np.isnan(value).all(axis=1), np.array(index) < 0)
    np.testing.assert_array_equal(np.isfinite(path.sigma(t)), np.array(index) >= 0)
    np.testing.assert_array_equal(path.position(t)[1], path.segments[0].evaluate(np.array([10.3]))[0])
    assert path.covered_s == pytest.approx(1.3 + 0.8)


def test_sigma_is_interpolated_between_knots(rng):
    path = two_segments(rng)
    np.testing.assert_allclose(path.sigma(np.array([10.4, 10.5, 20.7])), [0.3, 0.35, 0.5])
    assert np.isnan(Trajectory((random_segment(rng),)).sigma(np.array([10.5]))).all()


def test_nothing_is_covered_by_no_segments():
    path = Trajectory(())
    assert path.covered_s == 0
    assert np.isnan(path.position(np.array([0.0]))).all()
    assert path.sample_times(25.0).shape == (0,)


def test_samples_lie_on_the_beat_and_on_the_ends(rng):
    path = two_segments(rng)
    t = path.sample_times(25.0)
    assert (path.segment_index(t) >= 0).all()
    assert (np.diff(t) > 0).all()
    inner = ~np.isin(t, [10.3, 11.6, 20.2, 21.0])
    np.testing.assert_allclose(t[inner] * 25, np.rint(t[inner] * 25), rtol=0, atol=1e-9)
    assert {10.3, 11.6, 20.2, 21.0} <= set(t)
    first = t[t < 15]
    assert len(first) == 2 + np.sum((np.arange(1000) / 25 > 10.3) & (np.arange(1000) / 25 < 11.6 - 1e-9))
    assert np.diff(t[t < 15]).max() <= 1 / 25 + 1e-9


def test_another_frame_and_unit(rng):
    path = two_segments(rng)
    s = Similarity(3.0, so3_exp(np.array([0.3, -0.2, 0.9])), np.array([1.0, 2.0, 3.0]))
    moved, t = path.transformed(s), np.array([10.5, 11.0, 20.9])
    np.testing.assert_allclose(moved.position(t), s.apply(path.position(t)), rtol=0, atol=1e-12)
    np.testing.assert_allclose(moved.sigma(t), 3 * path.sigma(t))
    speed = np.linalg.norm(path.velocity(t), axis=1)
    np.testing.assert_allclose(np.linalg.norm(moved.velocity(t), axis=1), 3 * speed)
    assert moved.covered_s == path.covered_s


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"control_in_world": np.zeros((3, 3))}, "expected at least 4 points, got 3"),
        ({"control_in_world": np.zeros((5, 2))}, r"control_in_world: expected shape \(n, 3\)"),
        ({"knot_spacing_s": 0.0}, "knot_spacing_s: expected a positive number"),
        ({"end_s": -1.0}, "ends .* before it begins"),
        ({"knot_sigma": np.ones(4)}, r"knot_sigma: expected shape \(3\)"),
    ],
)
def test_impossible_segments_are_refused(fields, message):
    given = {
        "knot_start_s": 0.0,
        "knot_spacing_s": 0.2,
        "control_in_world": np.zeros((5, 3)),
        "begin_s": 0.0,
        "end_s": 0.4,
    }
    with pytest.raises(ValueError, match=message):
        Segment(**{**given, **fields})
    assert Segment(**given).n_intervals == 2


def test_segments_must_not_overlap(rng):
    a, b = random_segment(rng, 10.0, 10.0, 11.0), random_segment(rng, 10.0, 10.9, 12.0)
    with pytest.raises(ValueError, match="without overlap"):
        Trajectory((a, b))
    with pytest.raises(ValueError, match="without overlap"):
        Trajectory((random_segment(rng, 20.0, 20.0, 21.0), a))
