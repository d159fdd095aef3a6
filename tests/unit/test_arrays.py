"""Arrays are checked, copied and locked."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.geometry.arrays import frozen_array


def test_a_copy_that_cannot_be_written():
    given = np.arange(6.0).reshape(3, 2)
    array = frozen_array(given, (None, 2), "xy")
    given[0, 0] = 99.0
    assert array[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        array[0, 0] = 1.0


def test_lists_become_arrays_of_the_wanted_type():
    assert frozen_array([[1, 2]], (1, 2), "a").dtype == np.float64
    assert frozen_array([1, 2], (2,), "a", np.int64).dtype == np.int64
    assert frozen_array([True, False], (None,), "a", np.bool_).dtype == np.bool_
    assert frozen_array([], (None,), "a").shape == (0,)


@pytest.mark.parametrize(
    ("values", "shape", "expected"),
    [
        ([1.0, 2.0], (3,), r"xy: expected shape \(3\), got \(2,\)"),
        ([[1.0, 2.0, 3.0]], (None, 2), r"xy: expected shape \(n, 2\), got \(1, 3\)"),
        (1.0, (None,), r"xy: expected shape \(n\), got \(\)"),
        ([[1.0, 2.0]], (2,), r"xy: expected shape \(2\), got \(1, 2\)"),
    ],
)
def test_a_wrong_shape_is_named(values, shape, expected):
    with pytest.raises(ValueError, match=expected):
        frozen_array(values, shape, "xy")


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_values_must_be_finite_unless_allowed(bad):
    with pytest.raises(ValueError, match="time_s: contains values that are not finite"):
        frozen_array([0.0, bad], (None,), "time_s")
    np.testing.assert_array_equal(frozen_array([0.0, bad], (None,), "time_s", finite=False), [0.0, bad])
