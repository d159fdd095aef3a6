"""Messages between flights, against the dense algebra of all flights' Gaussians together."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.estimation.shared_devices import Gaussian, Ties, message, total, worst_contradiction

# Three flights, three devices of two parameters each; no two flights share the same ones.
SLOTS = {"a": [0, 1, 2, 3], "b": [2, 3, 4, 5], "c": [0, 1, 4, 5]}
DEVICE = np.array([0, 0, 1, 1, 2, 2])
TESTED = np.array([0, 2, 4])
PRIOR_SD = np.array([0.02, 0.01, 0.03, 0.01, 0.02, 0.02])
TIES = {f: Ties(np.arange(4) + 10, np.array(slots)) for f, slots in SLOTS.items()}


def gaussian(precision, mean) -> Gaussian:
    return Gaussian(precision, precision @ mean)


PRIOR = gaussian(np.diag(PRIOR_SD**-2), np.linspace(-0.01, 0.01, 6))


def measured(rng, truth, sd=0.004):
    """Each flight's likelihood about the truth, its parameters correlated."""
    out = {}
    for flight, slots in SLOTS.items():
        root = np.eye(4) + 0.4 * rng.normal(size=(4, 4))
        covariance = sd**2 * root @ root.T
        mean = truth[flight][slots] + sd * root @ rng.normal(size=4)
        out[flight] = gaussian(np.linalg.inv(covariance), mean)
    return out


@pytest.fixture
def likelihoods(rng):
    return measured(rng, {f: np.zeros(6) for f in SLOTS})


def test_marginal(rng) -> None:
    root = rng.normal(size=(6, 6))
    covariance, mean = root @ root.T, rng.normal(size=6)
    kept = np.array([4, 1])
    found = gaussian(np.linalg.inv(covariance), mean).marginal(kept)
    np.testing.assert_allclose(np.linalg.inv(found.precision), covariance[np.ix_(kept, kept)], rtol=1e-8)
    np.testing.assert_allclose(found.mean, mean[kept], rtol=1e-8)


def test_mean_of_what_is_known_in_one_direction_only() -> None:
    direction = np.array([3.0, 4e-3])
    found = Gaussian(np.outer(direction, direction), direction * 10)
    assert direction @ found.mean == pytest.approx(10)


@pytest.mark.parametrize("flight", SLOTS)
def test_a_flight_with_its_own_priors_and_the_message_knows_what_all_know(flight, likelihoods) -> None:
    everything = total(likelihoods, TIES, PRIOR)
    term = message(flight, likelihoods, TIES, PRIOR)
    slots = TIES[flight].slot
    np.testing.assert_array_equal(term.index, TIES[flight].index)
    own_prior = Gaussian(PRIOR.precision[np.ix_(slots, slots)], PRIOR.shift[slots])
    together = gaussian(term.precision, term.mean) + own_prior + likelihoods[flight]
    expected = np.linalg.inv(everything.precision)
    np.testing.assert_allclose(np.linalg.inv(together.precision), expected[np.ix_(slots, slots)], rtol=1e-8)
    np.testing.assert_allclose(together.mean, (expected @ everything.shift)[slots], rtol=1e-8)


def test_the_device_that_changed_is_told_from_those_it_pulls_along(rng) -> None:
    for flight, slot in (("a", 2), ("b", 4), ("c", 0)):
        truth = {f: np.zeros(6) for f in SLOTS}
        truth[flight][slot] = 0.08
        found = worst_contradiction(measured(rng, truth), TIES, PRIOR, DEVICE, TESTED)
        assert found is not None
        assert found.slot == slot
        assert found.flight in (f for f in SLOTS if slot in SLOTS[f])
        assert abs(found.difference) == pytest.approx(0.08, abs=0.03)
        assert found.deviations > 4


def test_deviations_of_a_contradiction_are_those_of_chance(rng) -> None:
    found = []
    for _ in range(200):
        truth = {f: np.zeros(6) for f in SLOTS}
        worst = worst_contradiction(measured(rng, truth), TIES, PRIOR, DEVICE, TESTED[:1])
        assert worst is not None
        found.append(worst.deviations)
    assert 0.8 < np.sqrt(np.mean(np.square(found))) < 1.2


def test_a_wrong_calibration_is_no_contradiction(rng) -> None:
    truth = {f: np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0]) for f in SLOTS}
    found = worst_contradiction(measured(rng, truth), TIES, PRIOR, DEVICE, TESTED)
    assert found is not None
    assert found.deviations < 4


def test_nothing_shared_nothing_contradicted(likelihoods) -> None:
    alone = {"a": likelihoods["a"]}
    assert worst_contradiction(alone, TIES, PRIOR, DEVICE, TESTED) is None
