"""Robust losses: what they are near and far, that weights are their slopes, and that compiled loops use the same."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skytrace.estimation.adjust.kernel import loss_value, loss_weight
from skytrace.estimation.adjust.losses import LOSSES, LossKind

KINDS = get_args(LossKind)
squared = st.floats(0, 1e8)
scales = st.floats(0.1, 100)


def test_every_kind_has_its_loss_and_its_number():
    assert set(LOSSES) == set(KINDS)
    assert len({loss.code for loss in LOSSES.values()}) == len(KINDS)


@pytest.mark.parametrize("kind", KINDS)
@given(s=squared, scale=scales)
def test_weights_are_the_slopes_of_the_loss(kind, s, scale):
    loss, c2 = LOSSES[kind], scale**2
    h = 1e-5 * (1e-3 * c2 + s)
    value = loss.value(np.array([s, s + h, s + 2 * h]), c2)
    # Three-point forward difference, so that the point itself may be 0; Huber's slope has a kink in its own slope.
    slope = (-3 * value[0] + 4 * value[1] - value[2]) / (2 * h)
    rounding = 1e-14 * value[0] / h
    assert loss.weight(np.array([s]), c2)[0] == pytest.approx(slope, rel=1e-4, abs=1e-7 + 10 * rounding)


@pytest.mark.parametrize("kind", KINDS)
def test_small_errors_are_squares_and_large_ones_count_less_and_less(kind):
    loss, c2 = LOSSES[kind], 4.0
    s = np.array([1e-9, 1e-3, 1.0, 4.0, 100.0, 1e6])
    assert loss.value(s, c2)[0] == pytest.approx(1e-9, rel=1e-6)
    assert loss.weight(np.zeros(1), c2)[0] == 1
    value, weight = loss.value(s, c2), loss.weight(s, c2)
    assert (np.diff(value) > 0).all()
    assert (np.diff(weight) <= 0).all()
    assert (value <= s * (1 + 1e-12)).all()
    if kind == "none":
        np.testing.assert_array_equal(value, s)
    else:
        assert weight[-1] < 0.01


@pytest.mark.parametrize(
    ("kind", "value", "weight"),
    [
        ("cauchy", 4 * np.log(26), 1 / 26),
        ("huber", 2 * 2 * 10 - 4, 2 / 10),
        ("geman-mcclure", 100 / 26, 1 / 26**2),
        ("none", 100.0, 1.0),
    ],
)
def test_an_error_of_five_scales(kind, value, weight):
    s = np.array([100.0])
    assert LOSSES[kind].value(s, 4.0)[0] == pytest.approx(value)
    assert LOSSES[kind].weight(s, 4.0)[0] == pytest.approx(weight)


@pytest.mark.parametrize("kind", KINDS)
@settings(deadline=None)  # the first call compiles
@given(s=squared, scale=scales)
def test_compiled_losses_are_the_same(kind, s, scale):
    loss, c2 = LOSSES[kind], scale**2
    assert loss_value(loss.code, s, c2) == pytest.approx(loss.value(np.array([s]), c2)[0], rel=1e-13, abs=1e-300)
    assert loss_weight(loss.code, s, c2) == pytest.approx(loss.weight(np.array([s]), c2)[0], rel=1e-13)
