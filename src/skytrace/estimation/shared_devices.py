"""What several flights say together about the devices that filmed them all.

Lens and readout belong to a device, poses and clocks to a flight. Given the shared parameters, flights know nothing of
each other, so their joint optimum is found by messages (Pearl, "Probabilistic reasoning in intelligent systems", 1988,
on a star): each flight's likelihood of the shared parameters, everything of its own eliminated, is a Gaussian about
its estimate, and enters the others as a prior. Where the estimates no longer change, the gradient of the sum of all
flights' objectives vanishes, whatever the Gaussians' widths.

The objective of a flight overstates its detections by its inflation (`estimation.adjust.driver`); messages do not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from skytrace.estimation.adjust import normal, solve
from skytrace.estimation.adjust.camera_priors import GaussianTerm
from skytrace.estimation.adjust.driver import Adjusted
from skytrace.estimation.influence import influence
from skytrace.geometry.arrays import FloatArray, IntArray

_NOTHING = 1e-9  # of the largest eigenvalue of a precision: directions that are not known at all
_FAINT = 1e-6  # of a prior: it decides nothing, but keeps matrices invertible


@dataclass(frozen=True, eq=False, slots=True)
class Ties:
    """Which of a flight's camera parameters are which of the shared ones."""

    index: IntArray  # (k,) into its flattened camera parameters (c, 16)
    slot: IntArray  # (k,) into the shared parameters

    def without(self, slots: IntArray) -> Ties:
        kept = ~np.isin(self.slot, slots)
        return Ties(self.index[kept], self.slot[kept])


@dataclass(frozen=True, eq=False, slots=True)
class Gaussian:
    """A Gaussian in information form: exp(-x^T precision x / 2 + shift^T x), precision possibly singular."""

    precision: FloatArray  # (n, n)
    shift: FloatArray  # (n,)

    @property
    def mean(self) -> FloatArray:
        """The mean (n,), zero along directions that are not known."""
        return _pseudo_inverse(self.precision) @ self.shift

    def at(self, slot: IntArray, n: int) -> Gaussian:
        """The same among n parameters, of which these are `slot`."""
        precision, shift = np.zeros((n, n)), np.zeros(n)
        precision[np.ix_(slot, slot)], shift[slot] = self.precision, self.shift
        return Gaussian(precision, shift)

    def marginal(self, kept: IntArray) -> Gaussian:
        """That of the parameters `kept`, the others integrated out; they must be determined, given those kept."""
        gone = np.setdiff1d(np.arange(len(self.shift)), kept)
        cross = self.precision[np.ix_(kept, gone)]
        solved = np.linalg.solve(self.precision[np.ix_(gone, gone)], np.column_stack([cross.T, self.shift[gone]]))
        return Gaussian(
            _symmetric(self.precision[np.ix_(kept, kept)] - cross @ solved[:, :-1]),
            self.shift[kept] - cross @ solved[:, -1],
        )

    def __add__(self, other: Gaussian) -> Gaussian:
        return Gaussian(self.precision + other.precision, self.shift + other.shift)


@dataclass(frozen=True, slots=True)
class Contradiction:
    """A flight's value of a shared parameter against that of the others."""

    flight: str
    slot: int
    difference: float
    deviations: float  # of the difference


def likelihood(adjusted: Adjusted, ties: Ties, received: GaussianTerm | None) -> Gaussian:
    """What a flight's own detections say of its shared parameters (k,): without their priors and what was `received`.

    The flight's other unknowns are eliminated with their priors.
    """
    moves, state, index = influence(adjusted), adjusted.state, ties.index
    unknown = moves.column.ravel()[index]
    if (unknown < 0).any():
        raise ValueError("ties: expected parameters that the adjustment may move")
    # The marginal objective of the shared parameters: its matrix and its gradient, priors included.
    precision = np.linalg.inv(moves.response[np.ix_(unknown, unknown)])
    equations = solve.assemble(adjusted.problem, state, adjusted.priors, adjusted.weights, adjusted.motion)
    reduced = normal.eliminate(equations, 0.0).reduced_gradient
    gradient = precision @ (moves.response @ reduced)[unknown]
    # Less what was known beforehand.
    gradient -= (adjusted.priors.pull(state) * adjusted.priors.precision).ravel()[index]
    precision -= np.diag(adjusted.priors.precision.ravel()[index] ** 2)
    if received is not None:
        term_gradient, term = received.tightened(adjusted.inflation).linearised(state)
        gradient, precision = gradient - term_gradient[index], precision - term[np.ix_(index, index)]
    precision = _positive(precision)
    return Gaussian(
        precision / adjusted.inflation, (precision @ state.parameters().ravel()[index] - gradient) / adjusted.inflation
    )


def priors_of(flights: Sequence[tuple[Adjusted, Ties]], n: int) -> Gaussian:
    """What was known of the n shared parameters beforehand, by the first flight that has each."""
    precision, shift = np.zeros(n), np.zeros(n)
    for adjusted, ties in reversed(flights):
        own = adjusted.priors.precision.ravel()[ties.index] ** 2 / adjusted.inflation
        precision[ties.slot], shift[ties.slot] = own, own * adjusted.priors.mean.ravel()[ties.index]
    return Gaussian(np.diag(precision), shift)


def total(likelihoods: Mapping[str, Gaussian], ties: Mapping[str, Ties], start: Gaussian) -> Gaussian:
    """The product of `start` with all likelihoods; these are of each flight's own parameters (k,)."""
    for flight, own in likelihoods.items():
        start = start + own.at(ties[flight].slot, len(start.shift))
    return start


def message(
    flight: str, likelihoods: Mapping[str, Gaussian], ties: Mapping[str, Ties], prior: Gaussian
) -> GaussianTerm:
    """What all other flights say of the parameters that a flight shares. `prior` is that of all shared parameters."""
    own = ties[flight]
    elsewhere = np.ones(len(prior.shift))
    elsewhere[own.slot] = 0.0  # the flight has the priors of its own parameters already
    outside = Gaussian(prior.precision * elsewhere * elsewhere[:, None], prior.shift * elsewhere)
    others = total({f: g for f, g in likelihoods.items() if f != flight}, ties, outside)
    known = np.flatnonzero(np.diag(others.precision) > 0)
    kept = np.union1d(own.slot, known)
    place = np.searchsorted(kept, own.slot)
    found = Gaussian(others.precision[np.ix_(kept, kept)], others.shift[kept]).marginal(place)
    precision = _positive(found.precision)
    return GaussianTerm(own.index, Gaussian(precision, found.shift).mean, precision)


def worst_contradiction(
    likelihoods: Mapping[str, Gaussian],
    ties: Mapping[str, Ties],
    prior: Gaussian,
    device: IntArray,
    tested: IntArray,
) -> Contradiction | None:
    """The flight and parameter among the slots `tested` that speak most against their being shared, if any is.

    A flight's device, which slots (n,) belong to, is given a lens and a readout of its own, all others being shared
    (data snooping: Baarda, "A testing procedure for use in geodetic networks", 1968). That tells which one changed
    where several depend on each other, and is not misled by what the lens model misses, which differs with the part of
    the image that the target crossed. What was known of the parameter itself stays out: it may be wrong for all alike.
    """
    flights_of = np.bincount(np.concatenate([ties[f].slot for f in likelihoods]), minlength=len(prior.shift))
    worst: Contradiction | None = None
    for flight in sorted(likelihoods):
        for slot in tested[(flights_of[tested] > 1) & np.isin(tested, ties[flight].slot)]:
            found = _contradiction(flight, int(slot), likelihoods, ties, prior, device)
            if worst is None or found.deviations > worst.deviations:
                worst = found
    return worst


def _contradiction(
    flight: str,
    slot: int,
    likelihoods: Mapping[str, Gaussian],
    ties: Mapping[str, Ties],
    prior: Gaussian,
    device: IntArray,
) -> Contradiction:
    n, slots = len(prior.shift), ties[flight].slot
    apart = device[slots] == device[slot]
    own = np.where(apart, n + np.cumsum(apart) - 1, slots)  # beyond the shared ones
    place, of = np.r_[np.arange(n), own[apart]], np.r_[np.arange(n), slots[apart]]
    known = np.where(of == slot, _FAINT, 1.0) * np.diag(prior.precision)[of]
    start = Gaussian(np.diag(known), known * _means(prior)[of]).at(place, len(place))
    everything = total(likelihoods, {**ties, flight: Ties(ties[flight].index, own)}, start)
    kept = np.flatnonzero(np.diag(everything.precision) > 0)
    covariance = np.linalg.inv(everything.precision[np.ix_(kept, kept)])
    value = covariance @ everything.shift[kept]
    here, elsewhere = np.searchsorted(kept, [own[slots == slot][0], slot])
    variance = covariance[here, here] + covariance[elsewhere, elsewhere] - 2 * covariance[here, elsewhere]
    difference = float(value[here] - value[elsewhere])
    return Contradiction(flight, slot, difference, abs(difference) / float(np.sqrt(variance)))


def _means(prior: Gaussian) -> FloatArray:
    """Means (n,) of independent parameters, 0 where nothing is known."""
    precision = np.diag(prior.precision)
    return np.where(precision > 0, prior.shift / np.where(precision > 0, precision, 1.0), 0.0)


def _symmetric(matrix: np.ndarray) -> np.ndarray:
    return 0.5 * (matrix + matrix.T)


def _positive(matrix: np.ndarray) -> FloatArray:
    """The closest positive semi-definite matrix, in units in which its diagonal is alike."""
    scale = np.sqrt(np.maximum(np.abs(np.diag(matrix)), 1e-300))
    values, vectors = np.linalg.eigh(_symmetric(matrix) / scale / scale[:, None])
    vectors = vectors * np.sqrt(np.maximum(values, 0.0)) * scale[:, None]
    return vectors @ vectors.T


def _pseudo_inverse(matrix: FloatArray) -> FloatArray:
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    return np.linalg.pinv(matrix * scale * scale[:, None], rcond=_NOTHING, hermitian=True) * scale * scale[:, None]
