"""Uniform cubic B-splines: partition of unity, smoothness, derivatives, energies and the cubics they contain."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from law_strategies import law, seeds
from scipy.integrate import quad
from scipy.interpolate import BSpline

from skytrace.solvers import bspline

inside = arrays(np.float64, st.integers(1, 6), elements=st.floats(0, 1))
orders = st.integers(1, 3)


@law
@given(u=inside)
def test_weights_are_a_partition_of_unity(u):
    weights = bspline.basis(u)
    np.testing.assert_allclose(weights.sum(axis=1), 1, rtol=0, atol=1e-14)
    assert (weights >= -1e-15).all()
    for order in (1, 2, 3):
        np.testing.assert_allclose(bspline.basis(u, order).sum(axis=1), 0, rtol=0, atol=1e-14)


@law
@given(u=arrays(np.float64, 4, elements=st.floats(0.01, 0.99)), order=orders)
def test_each_derivative_is_the_slope_of_the_one_before(u, order):
    h = 1e-5
    numeric = (bspline.basis(u + h, order - 1) - bspline.basis(u - h, order - 1)) / (2 * h)
    np.testing.assert_allclose(bspline.basis(u, order), numeric, rtol=0, atol=1e-8)


@law
@given(seed=seeds, spacing=st.floats(0.05, 2.0), start=st.floats(-100, 100), order=st.integers(0, 3))
def test_evaluation_agrees_with_scipy(seed, spacing, start, order):
    rng = np.random.default_rng(seed)
    control = rng.normal(size=(9, 3))
    knots = start + spacing * np.arange(-3, 10)
    t = start + spacing * rng.uniform(0, 6, 40)
    interval, u = bspline.locate(t, start, spacing, 6)
    value = bspline.evaluate(control, interval, u, spacing, order)
    expected = BSpline(knots, control, 3).derivative(order)(t) if order else BSpline(knots, control, 3)(t)
    # Times near 100 s are rounded to 1e-14, which the spacing and the order of the derivative magnify.
    np.testing.assert_allclose(value, expected, rtol=0, atol=1e-9 / spacing**order)


@law
@given(seed=seeds, order=st.integers(0, 2))
def test_pieces_join_smoothly(seed, order):
    control = np.random.default_rng(seed).normal(size=(5, 2))
    ends, starts = np.array([0]), np.array([1])
    before = bspline.evaluate(control, ends, np.array([1.0]), 0.3, order)
    after = bspline.evaluate(control, starts, np.array([0.0]), 0.3, order)
    np.testing.assert_allclose(before, after, rtol=0, atol=1e-11)


@law
@given(
    coefficients=arrays(np.float64, 4, elements=st.floats(-3, 3)), spacing=st.floats(0.1, 1.0), order=st.integers(0, 3)
)
def test_every_cubic_is_reproduced(coefficients, spacing, order):
    cubic = np.polynomial.Polynomial(coefficients)
    # Marsden's identity: the control value of t^3 at knots a, b, c is their elementary symmetric function a b c, etc.
    middle = spacing * np.arange(-1, 7)
    a, b, c = middle - spacing, middle, middle + spacing
    c0, c1, c2, c3 = coefficients
    control = c0 + c1 * (a + b + c) / 3 + c2 * (a * b + a * c + b * c) / 3 + c3 * a * b * c
    t = np.linspace(0, 5 * spacing, 41)
    interval, u = bspline.locate(t, 0.0, spacing, 5)
    value = bspline.evaluate(control[:, None], interval, u, spacing, order)[:, 0]
    expected = cubic.deriv(order)(t) if order else cubic(t)
    np.testing.assert_allclose(value, expected, rtol=0, atol=1e-8)


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_energy_matrix_is_the_integral_of_products(order):
    matrix = bspline.energy_matrix(order)
    for i in range(4):
        for j in range(4):
            product = quad(lambda u, i=i, j=j: np.prod(bspline.basis(np.array([u]), order)[0][[i, j]]), 0, 1)[0]
            assert matrix[i, j] == pytest.approx(product, abs=1e-12)
    assert not matrix.flags.writeable


@law
@given(t=arrays(np.float64, 5, elements=st.floats(-10, 10)), start=st.floats(-5, 5), spacing=st.floats(0.1, 2))
def test_location_is_exact_inside_and_extends_the_end_intervals_outside(t, start, spacing):
    n = 4
    interval, u = bspline.locate(t, start, spacing, n)
    np.testing.assert_allclose(start + spacing * (interval + u), t, rtol=0, atol=1e-12)
    assert ((interval >= 0) & (interval < n)).all()
    within = (t >= start) & (t < start + n * spacing)
    assert ((u[within] >= -1e-9) & (u[within] <= 1 + 1e-9)).all()
    assert (interval[t < start] == 0).all()
    assert (interval[t >= start + n * spacing] == n - 1).all()
