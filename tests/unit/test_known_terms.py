"""Terms that tie several camera parameters: derivatives against numeric ones, and what they hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_adjust_kernel import random_state

from skytrace.estimation.adjust.camera_priors import CameraTerm
from skytrace.estimation.adjust.distance_term import DistanceTerm
from skytrace.estimation.adjust.held_motion import HeldMotion
from skytrace.estimation.adjust.problem import N_PARAMETERS
from skytrace.estimation.adjust.up_term import UpTerm
from skytrace.geometry.rigid import so3_exp


def stepped(state, step):
    return state.moved(step.reshape(-1, N_PARAMETERS), np.zeros_like(state.control))


def numeric(function, state, h=1e-6):
    """Derivative (..., 16 c) of a function of the state by a step of the cameras, by central differences."""
    n = len(state.centre) * N_PARAMETERS
    return np.stack(
        [(function(stepped(state, h * e)) - function(stepped(state, -h * e))) / (2 * h) for e in np.eye(n)], axis=-1
    )


def terms(rng, state) -> dict[str, CameraTerm]:
    up = rng.normal(size=3)
    motions = rng.normal(size=(6, 3))
    before = stepped(state, 0.05 * rng.normal(size=state.centre.shape[0] * N_PARAMETERS))
    held = HeldMotion.at(before, motions)
    soft = HeldMotion(held.rotation, held.centre, 1e-5 * held.by_centre, 1e-5 * held.by_rotation)
    return {
        "distance": DistanceTerm(0, 2, 40.0, 0.7),
        "up": UpTerm(1, up / np.linalg.norm(up), 0.05),
        "held": soft,
    }


@pytest.mark.parametrize("name", ["distance", "up", "held"])
def test_derivatives_are_those_of_the_cost(rng, name):
    state = random_state(rng)
    term = terms(rng, state)[name]
    gradient, matrix = term.linearised(state)
    np.testing.assert_allclose(gradient, numeric(term.cost, state), rtol=1e-5, atol=1e-5 * np.abs(gradient).max())
    J = np.atleast_2d(numeric(term.residual, state))  # type: ignore[attr-defined]
    np.testing.assert_allclose(matrix, J.T @ J, rtol=1e-4, atol=1e-5 * np.abs(matrix).max())
    assert term.cost(state) == pytest.approx(0.5 * np.sum(np.square(term.residual(state))))  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", ["distance", "up"])
def test_tightened_knowledge_counts_more(rng, name):
    state = random_state(rng)
    term = terms(rng, state)[name]
    assert term.tightened(9.0).cost(state) == pytest.approx(9 * term.cost(state))


def test_what_is_held_does_not_tighten(rng):
    state = random_state(rng)
    term = terms(rng, state)["held"]
    assert term.tightened(9.0).cost(state) == term.cost(state)


def moved_world(state, translation, turn):
    R = so3_exp(np.asarray(turn, float))
    return replace(state, rotation=state.rotation @ R.T, centre=state.centre @ R.T + translation)


def test_only_the_motions_that_are_held_are_felt(rng):
    state = random_state(rng)
    about_z = np.zeros((6, 1))
    about_z[5] = 1
    held = HeldMotion.at(state, about_z)
    assert held.cost(state) == 0
    assert held.cost(moved_world(state, [0, 0, 0], [0, 0, 1e-3])) > 100
    # The ring of cameras is nearly symmetric: raising it turns nothing about z.
    up = held.residual(moved_world(state, [0, 0, 0.03], [0, 0, 0]))
    assert np.abs(up) < 1e-6 * np.abs(held.residual(moved_world(state, [0, 0, 0], [0, 0, 1e-3])))


def test_a_turn_about_the_line_through_two_cameras_is_felt(rng):
    """Their centres stay where they are: it shows only in how they look."""
    state = random_state(rng, n_cameras=2)
    axis = state.centre[1] - state.centre[0]
    axis /= np.linalg.norm(axis)
    about = np.concatenate([np.cross(state.centre[0], axis), axis])[:, None]
    held = HeldMotion.at(state, about)
    R = so3_exp(1e-3 * axis)
    turned = replace(state, rotation=state.rotation @ R.T)
    assert np.abs(held.residual(turned)).max() == pytest.approx(100 * np.sqrt(2), rel=1e-3)


def test_upside_down_is_the_furthest_from_up(rng):
    state = random_state(rng)
    up_now = state.rotation[0] @ [0, 0, 1.0]
    assert UpTerm(0, up_now, 0.1).cost(state) == pytest.approx(0, abs=1e-12)
    assert UpTerm(0, -up_now, 0.1).cost(state) == pytest.approx(0.5 * (2 / 0.1) ** 2)
