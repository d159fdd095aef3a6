"""Random rotations, transforms, points and lenses for the laws."""

from __future__ import annotations

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from skytrace.geometry.rigid import Rigid, Similarity, so3_exp

# The same examples on every run: a law that fails, fails for everybody.
law = settings(max_examples=60, deadline=None, derandomize=True, database=None)


def vectors(limit: float) -> st.SearchStrategy:
    return arrays(np.float64, 3, elements=st.floats(-limit, limit))


def points(limit: float = 100.0, least: int = 1, most: int = 8) -> st.SearchStrategy:
    return arrays(np.float64, st.tuples(st.integers(least, most), st.just(3)), elements=st.floats(-limit, limit))


def spread_points(count: int) -> st.SearchStrategy:
    """Points (count, 3) about the origin that lie in no plane."""
    return seeds.map(lambda seed: np.random.default_rng(seed).normal(size=(count, 3)))


directions = vectors(1.0).filter(lambda v: np.linalg.norm(v) > 0.1).map(lambda v: v / np.linalg.norm(v))
rotations = st.builds(lambda axis, angle: so3_exp(axis * angle), directions, st.floats(0, np.pi))
rigids = st.builds(Rigid, rotations, vectors(100.0))
similarities = st.builds(Similarity, st.floats(0.01, 100.0), rotations, vectors(100.0))
seeds = st.integers(0, 2**32 - 1)

# Lenses like those of phones, action and compact cameras, all one-to-one within a radius of 0.75 on the plane z = 1.
_MILD = st.tuples(
    st.floats(-0.15, 0.2), st.floats(-0.05, 0.1), st.floats(-2e-3, 2e-3), st.floats(-2e-3, 2e-3), st.floats(-0.02, 0.05)
)
_CALIBRATED = st.sampled_from(
    [
        (0.19, -0.76, 0.0006, -0.0004, 0.94),
        (-0.13, 0.12, -0.0004, 0.0008, 0.0),
        (-0.25, 0.08, 0.0003, -0.001, 0.0),
        (0.03, -0.1, 0.002, 0.001, 0.06),
        (0.0, 0.0, 0.0, 0.0, 0.0),
    ]
)
lenses = st.one_of(_MILD, _CALIBRATED).map(np.array)
