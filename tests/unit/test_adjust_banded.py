"""Compiled banded algebra against dense algebra."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.estimation.adjust import banded

SIZES = [(1, 1), (1, 4), (7, 4), (30, 4), (40, 12), (5, 12)]


def banded_matrix(n, width, rng):
    """A positive definite matrix (n, n), its band (n, width) and its lower Cholesky factor."""
    L = np.tril(0.3 * rng.normal(size=(n, n)))
    L[np.subtract.outer(np.arange(n), np.arange(n)) >= width] = 0
    L[np.diag_indices(n)] = rng.uniform(1, 2, n)
    return L @ L.T, band_of(L @ L.T, width), L


def band_of(matrix, width):
    n = len(matrix)
    band = np.zeros((n, width))
    for d in range(min(width, n)):
        band[: n - d, d] = np.diag(matrix, -d)
    return band


@pytest.mark.parametrize(("n", "width"), SIZES)
def test_the_factor_is_cholesky_s(n, width, rng):
    _, band, L = banded_matrix(n, width, rng)
    assert banded.factorise(band)
    np.testing.assert_allclose(band, band_of(L, width), rtol=0, atol=1e-12)


@pytest.mark.parametrize("spoil", [-1.0, 0.0, np.nan, np.inf])
def test_what_has_no_factor_is_told(spoil, rng):
    _, band, _ = banded_matrix(20, 4, rng)
    band[11, 0] = spoil
    assert not banded.factorise(band)


def test_a_matrix_that_turns_indefinite_late_has_no_factor(rng):
    A, _, _ = banded_matrix(20, 4, rng)
    A[-1, -1] = 0.9 * (A[-1, :-1] @ np.linalg.solve(A[:-1, :-1], A[:-1, -1]))
    assert not banded.factorise(band_of(A, 4))


@pytest.mark.parametrize(("n", "width"), SIZES)
def test_half_and_back_solve_are_the_triangular_solves(n, width, rng):
    A, band, L = banded_matrix(n, width, rng)
    C, g = rng.normal(size=(n, 7)), rng.normal(size=n)
    assert banded.factorise(band)
    half = banded.half_solve(band, C, np.arange(7), 7, g)
    np.testing.assert_allclose(half, np.linalg.solve(L, np.column_stack([C, g])), rtol=0, atol=1e-9)
    banded.back_solve(band, half)
    np.testing.assert_allclose(half, np.linalg.solve(A, np.column_stack([C, g])), rtol=0, atol=1e-8)


def test_columns_are_dropped_and_shared_as_told(rng):
    _, band, L = banded_matrix(20, 4, rng)
    C, g = rng.normal(size=(20, 5)), rng.normal(size=20)
    assert banded.factorise(band)
    half = banded.half_solve(band, C, np.array([1, -1, 0, 1, -1]), 2, g)
    expected = np.linalg.solve(L, np.column_stack([C[:, 2], C[:, 0] + C[:, 3], g]))
    np.testing.assert_allclose(half, expected, rtol=0, atol=1e-10)
    np.testing.assert_allclose(
        banded.half_solve(band, C, np.full(5, -1), 0, g), np.linalg.solve(L, g)[:, None], rtol=0, atol=1e-10
    )


@pytest.mark.parametrize(("n", "width"), SIZES)
def test_the_inverse_band_is_that_of_the_dense_inverse(n, width, rng):
    A, band, _ = banded_matrix(n, width, rng)
    assert banded.factorise(band)
    inverse = np.linalg.inv(A)
    np.testing.assert_allclose(
        banded.inverse_band(band), band_of(inverse, width), rtol=0, atol=1e-9 * np.abs(inverse).max()
    )
