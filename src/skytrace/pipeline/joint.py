"""Flights filmed by the same devices: each reconstructed by itself, then adjusted with what the others say of them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from skytrace.errors import ReconstructionError
from skytrace.estimation.adjust.problem import FOCAL, N_PARAMETERS, READOUT
from skytrace.estimation.shared_devices import Contradiction, Ties
from skytrace.model.track import Recording
from skytrace.pipeline.config import Config
from skytrace.pipeline.devices import Device, shared_devices
from skytrace.pipeline.exchange import NAMES, SHARED, Exchange, Slot, tied
from skytrace.pipeline.offline import Outcome

_ROUNDS = 6  # of messages at most


@dataclass(frozen=True, eq=False, slots=True)
class Estimate:
    """A parameter's value and standard deviation."""

    value: float
    deviation: float


@dataclass(frozen=True, eq=False, slots=True)
class Shared:
    """A parameter of a device before and after the flights were joined."""

    alone: Mapping[str, Estimate]  # by flight
    joint: Estimate


@dataclass(frozen=True, eq=False, slots=True)
class DeviceResult:
    """What became of a device; `parameters` by their names in summary.json, none where nothing is shared."""

    device: Device
    parameters: Mapping[str, Shared]
    left_out: Mapping[str, str]  # flights that do not take part, and why


@dataclass(frozen=True, eq=False, slots=True)
class Joint:
    """The flights joined. Where nothing is shared, outcomes are those given."""

    outcomes: Mapping[str, Outcome]  # by flight
    devices: tuple[DeviceResult, ...]
    rounds: int
    agreed: bool
    warnings: tuple[str, ...]


def join(
    outcomes: Mapping[str, Outcome],
    names: Mapping[str, Mapping[str, str]],
    config: Config,
    progress: Callable[[int, int], None] = lambda done, total: None,
    *,
    parameters: Collection[str] = SHARED,
) -> Joint:
    """Share lenses and readouts between flights that were reconstructed by themselves.

    `names` are the devices given, by flight and camera id; `parameters` those of a device that its flights share.
    """
    flights = {f: outcomes[f] for f in sorted(outcomes)}  # so that the order they are given in does not matter
    devices, warnings = shared_devices({f: _registered(o) for f, o in flights.items()}, names)
    slots, ties = tied(flights, devices, parameters)
    exchange = Exchange(flights, config, slots, ties)
    rounds = 0
    left_out: list[dict[str, str]] = [{} for _ in devices]
    while True:
        likelihoods = exchange.likelihoods()
        while (found := exchange.contradiction(likelihoods)) is not None:
            words, device = _contradiction_words(found, slots, devices), slots[found.slot].device
            left_out[device][found.flight] = words
            warnings.append(words)
            exchange.separate(found.flight, device)
            likelihoods = exchange.likelihoods()
        progress(rounds, _ROUNDS)
        if rounds == _ROUNDS or exchange.agreed(likelihoods):
            break
        exchange.pass_on(likelihoods, settled=rounds > 0)
        rounds += 1
    agreed = exchange.agreed(likelihoods)
    if not agreed:
        warnings.append("The flights had not come to agree on the devices they share when the exchange was stopped.")
    progress(max(rounds, 1), max(rounds, 1))
    joined: dict[str, Outcome] = {}
    for flight, alone in flights.items():
        try:
            joined[flight] = exchange.concluded(flight)
        except ReconstructionError as error:
            joined[flight] = alone
            warnings.append(f"{flight} is left as it was reconstructed by itself: joined with the others, {error}.")
    results = [
        DeviceResult(device, _shared(k, slots, exchange.ties, flights, joined), left_out[k])
        for k, device in enumerate(devices)
    ]
    return Joint({f: joined[f] for f in outcomes}, tuple(results), rounds, agreed, tuple(warnings))


def _registered(outcome: Outcome) -> dict[str, Recording]:
    return {c: outcome.recordings[c] for c in outcome.adjusted.camera_ids}


def _shared(
    device: int,
    slots: Sequence[Slot],
    ties: Mapping[str, Ties],
    alone: Mapping[str, Outcome],
    joined: Mapping[str, Outcome],
) -> dict[str, Shared]:
    """What flights said of a device by themselves and say together; of their claims the least cautious is taken."""
    out = {}
    for k, slot in enumerate(slots):
        holders = {f: own.index[own.slot == k][0] for f, own in ties.items() if k in own.slot}
        if slot.device == device and holders:
            before = {f: _estimate(alone[f], index) for f, index in holders.items()}
            surest = min((_estimate(joined[f], index) for f, index in holders.items()), key=lambda e: e.deviation)
            out[NAMES[slot.column]] = Shared(before, surest)
    return out


def _estimate(outcome: Outcome, index: int) -> Estimate:
    camera, column = divmod(int(index), N_PARAMETERS)
    found = outcome.posterior
    deviation = found.clock[camera, 2] if column == READOUT else found.lens[camera, column - FOCAL]
    return Estimate(float(outcome.adjusted.state.parameters()[camera, column]), float(deviation))


def _contradiction_words(found: Contradiction, slots: Sequence[Slot], devices: Sequence[Device]) -> str:
    slot = slots[found.slot]
    device, name = devices[slot.device], NAMES[slot.column]
    others = " and ".join(f for f in device.camera_ids if f != found.flight)
    if name == "focal_scale":
        what = f"its focal length is {100 * np.expm1(found.difference):+.1f} % off (was the zoom changed?)"
    else:
        what = f"its {name} is off by {found.difference:+.2g} (another mode, or stabilisation?)"
    return (
        f"Device {device.name} ({device.camera_ids[found.flight]} of {found.flight}) is not shared: against {others} "
        f"{what}, {found.deviations:.1f} deviations."
    )
