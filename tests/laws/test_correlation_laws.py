"""Correlations by FFT are the plain sums."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from law_strategies import law, seeds

from skytrace.solvers.correlation import autocorrelation, cross_correlations, fast_length


@law
@given(seed=seeds, n=st.integers(1, 20), m=st.integers(1, 20), k=st.integers(1, 3))
def test_cross_correlations_are_the_sums_at_every_lag(seed, n, m, k):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(k, n)), rng.normal(size=(2, m))
    c = cross_correlations(a, b)
    assert c.shape == (k, 2, n + m - 1)
    for index, lag in enumerate(range(-(n - 1), m)):
        for i in range(k):
            for j in range(2):
                plain = sum(a[i, t] * b[j, t + lag] for t in range(n) if 0 <= t + lag < m)
                assert c[i, j, index] == pytest.approx(plain, abs=1e-10)


@law
@given(seed=seeds, n=st.integers(1, 30), lags=st.integers(1, 40))
def test_an_autocorrelation_is_the_sum_at_each_lag_without_wrapping_around(seed, n, lags):
    a = np.random.default_rng(seed).normal(size=(2, n))
    c = autocorrelation(a, lags)
    for i in range(2):
        for lag in range(lags):
            assert c[i, lag] == pytest.approx(float(a[i, : max(n - lag, 0)] @ a[i, lag:]), abs=1e-10)


@law
@given(n=st.integers(1, 10**6))
def test_fast_lengths_are_long_enough_and_not_wasteful(n):
    assert n <= fast_length(n) <= max(1.2 * n, n + 1)
