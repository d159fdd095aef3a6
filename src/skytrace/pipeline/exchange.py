"""Messages between flights of the same devices, until they agree on what they share."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from skytrace.estimation.adjust.camera_priors import GaussianTerm
from skytrace.estimation.adjust.driver import Adjusted
from skytrace.estimation.adjust.problem import ASPECT, FOCAL, N_PARAMETERS, PRINCIPAL, RADIAL, READOUT
from skytrace.estimation.finish import finish
from skytrace.estimation.shared_devices import (
    Contradiction,
    Gaussian,
    Ties,
    likelihood,
    message,
    priors_of,
    total,
    worst_contradiction,
)
from skytrace.geometry.arrays import FloatArray
from skytrace.pipeline.config import Config
from skytrace.pipeline.devices import Device
from skytrace.pipeline.offline import Outcome, concluded

_AGREED = 0.05  # deviations by which flights' values of a parameter may still differ
_CONTRADICTS = 3.0  # deviations between flights, cautious ones, from which on a device is taken to have changed
_TESTED = (READOUT, FOCAL)  # what a change of mode or of zoom moves

NAMES: Mapping[int, str] = MappingProxyType(
    {
        READOUT: "readout_s",
        FOCAL: "focal_scale",
        ASPECT: "aspect",
        PRINCIPAL.start: "principal_x",
        PRINCIPAL.start + 1: "principal_y",
        RADIAL.start: "k1",
        RADIAL.start + 1: "k2",
        RADIAL.start + 2: "k3",
    }
)
# Distortion coefficients take up what the lens model misses, each flight in the part of the image that it crossed.
SHARED = ("readout_s", "focal_scale", "aspect", "principal_x", "principal_y")


@dataclass(frozen=True, eq=False, slots=True)
class Slot:
    """A shared parameter."""

    device: int
    column: int


def tied(
    flights: Mapping[str, Outcome], devices: Sequence[Device], parameters: Collection[str]
) -> tuple[list[Slot], dict[str, Ties]]:
    """The shared parameters, and which of each flight's they are: those that may move in two flights and more."""
    slots: list[Slot] = []
    found: dict[str, list[tuple[int, int]]] = {f: [] for f in flights}
    for k, device in enumerate(devices):
        for column, name in NAMES.items():
            if name not in parameters or (column == READOUT and not device.same_readout):
                continue
            own = {f: _free_index(flights[f].adjusted, c, column) for f, c in device.camera_ids.items()}
            free = {f: index for f, index in own.items() if index is not None}
            if len(free) > 1:
                for flight, index in free.items():
                    found[flight].append((index, len(slots)))
                slots.append(Slot(k, column))
    pairs = {f: np.array(rows, np.int64).reshape(-1, 2) for f, rows in found.items()}
    return slots, {f: Ties(rows[:, 0], rows[:, 1]) for f, rows in pairs.items()}


def _free_index(adjusted: Adjusted, camera_id: str, column: int) -> int | None:
    camera = adjusted.camera_ids.index(camera_id)
    return camera * N_PARAMETERS + column if adjusted.priors.free[camera, column] else None


class Exchange:
    """The flights while messages go between them."""

    def __init__(
        self, flights: Mapping[str, Outcome], config: Config, slots: Sequence[Slot], ties: Mapping[str, Ties]
    ) -> None:
        self._flights, self._config, self._slots = flights, config, slots
        self.ties = dict(ties)
        self._adjusted = {f: outcome.adjusted for f, outcome in flights.items()}
        self._received: dict[str, GaussianTerm] = {}

    def _sharing(self) -> list[str]:
        return [f for f in self._flights if len(self.ties[f].slot)]

    def _prior(self) -> Gaussian:
        return priors_of([(self._adjusted[f], self.ties[f]) for f in self._sharing()], len(self._slots))

    def likelihoods(self) -> dict[str, Gaussian]:
        """What each flight that shares anything says of it."""
        out = {}
        for flight in self._sharing():
            received, own = self._received.get(flight), self.ties[flight]
            out[flight] = likelihood(self._adjusted[flight], own, received)
        return out

    def contradiction(self, likelihoods: Mapping[str, Gaussian]) -> Contradiction | None:
        """The worst contradiction, where it is too large for chance."""
        if not likelihoods:
            return None
        device = np.array([slot.device for slot in self._slots])
        tested = np.array([k for k, slot in enumerate(self._slots) if slot.column in _TESTED], np.int64)
        worst = worst_contradiction(likelihoods, self.ties, self._prior(), device, tested)
        return worst if worst is not None and worst.deviations > _CONTRADICTS else None

    def separate(self, flight: str, device: int) -> None:
        """A device is another one in this flight; where only one flight is left with it, in that one as well."""
        own = np.array([k for k, slot in enumerate(self._slots) if slot.device == device])
        self.ties[flight] = self.ties[flight].without(own)
        holders = [f for f in self._flights if np.isin(own, self.ties[f].slot).any()]
        if len(holders) == 1:
            self.ties[holders[0]] = self.ties[holders[0]].without(own)
        self._adjusted = {f: outcome.adjusted for f, outcome in self._flights.items()}
        self._received = {}

    def pass_on(self, likelihoods: Mapping[str, Gaussian], *, settled: bool) -> None:
        """Adjust each flight with what the others say; weights stay as they are once they are `settled`."""
        prior = self._prior()
        settings = self._config.finish
        if settled:
            settings = replace(settings, rounds=1)
        for flight in likelihoods:
            term = message(flight, likelihoods, self.ties, prior)
            self._adjusted[flight] = finish(
                self._adjusted[flight],
                self._flights[flight].recordings,
                self._config.structure,
                self._config.adjust,
                self._config.freedom,
                settings,
                retriangulate=False,
                terms=(term,),
            )
            self._received[flight] = term

    def _joint(self, likelihoods: Mapping[str, Gaussian]) -> tuple[FloatArray, FloatArray]:
        """Value and deviation (n,) of the shared parameters, all flights together."""
        n = len(self._slots)
        value, deviation = np.full(n, np.nan), np.full(n, np.nan)
        known = np.unique(np.concatenate([np.zeros(0, np.int64), *(self.ties[f].slot for f in likelihoods)]))
        everything = total(likelihoods, self.ties, self._prior())
        covariance = np.linalg.inv(everything.precision[np.ix_(known, known)])
        value[known], deviation[known] = covariance @ everything.shift[known], np.sqrt(np.diag(covariance))
        return value, deviation

    def agreed(self, likelihoods: Mapping[str, Gaussian]) -> bool:
        """Whether all flights have the same values, and those that all flights together want."""
        value, deviation = self._joint(likelihoods)
        return all(
            (np.abs(self._values(f) - value[self.ties[f].slot]) <= _AGREED * deviation[self.ties[f].slot]).all()
            for f in likelihoods
        )

    def _values(self, flight: str) -> FloatArray:
        return self._adjusted[flight].state.parameters().ravel()[self.ties[flight].index]

    def concluded(self, flight: str) -> Outcome:
        before = self._flights[flight]
        if flight not in self._received:
            return before
        return concluded(before, self._adjusted[flight], self._config)
