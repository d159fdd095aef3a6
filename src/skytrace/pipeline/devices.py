"""Which cameras of several flights are one device, filming through one lens in one mode.

A camera is told by the `device` that its flight gives, else by its calibration. Either way its lens is shared only
where the calibrations are the same: another size, zoom or stabilisation needs another one. Without a name the frame
rates must agree as well, since a mode with another one often shows another part of the sensor.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass

from skytrace.model.camera import Intrinsics
from skytrace.model.track import Recording

_SAME_RATE = 0.02  # phones miss their nominal rate by this; the closest modes, 24 and 25 frames/s, are further apart


@dataclass(frozen=True, eq=False, slots=True)
class Device:
    """One device that filmed several flights."""

    name: str
    camera_ids: Mapping[str, str]  # by flight
    same_readout: bool  # it filmed at one frame rate


def shared_devices(
    flights: Mapping[str, Mapping[str, Recording]], names: Mapping[str, Mapping[str, str]]
) -> tuple[list[Device], list[str]]:
    """The devices that filmed more than one of the flights, and in words what kept others from being told.

    `flights` holds the recordings of each by camera id, `names` the devices that are given.
    """
    groups: dict[Hashable, list[tuple[str, str]]] = {}
    for flight, recordings in flights.items():
        for camera_id, recording in recordings.items():
            key = (names.get(flight, {}).get(camera_id), _calibration(recording.intrinsics))
            groups.setdefault(key, []).append((flight, camera_id))
    devices, warnings = [], _of_two_calibrations(groups)
    for (name, _), cameras in groups.items():  # type: ignore[misc]
        rates = {camera: flights[camera[0]][camera[1]].frame_rate_hz for camera in cameras}
        for mode in [cameras] if name is not None else _modes(rates):
            if len({flight for flight, _ in mode}) < 2:
                continue
            if len(mode) > len({flight for flight, _ in mode}):
                warnings.append(_alike(mode))
                continue
            camera_ids = dict(mode)
            alike = len(_modes({camera: rates[camera] for camera in mode})) == 1
            devices.append(Device(name or "/".join(dict.fromkeys(camera_ids.values())), camera_ids, alike))
    return devices, warnings


def _calibration(lens: Intrinsics) -> Hashable:
    values = (*lens.focal_px.tolist(), *lens.principal_px.tolist(), *lens.distortion.tolist())
    return lens.model, lens.size_px, values


def _modes(rates_hz: Mapping[tuple[str, str], float]) -> list[list[tuple[str, str]]]:
    """The cameras by frame rate, those together whose rates are close."""
    modes: list[list[tuple[str, str]]] = []
    for camera in sorted(rates_hz, key=lambda c: rates_hz[c]):
        if modes and rates_hz[camera] <= (1 + _SAME_RATE) * rates_hz[modes[-1][0]]:
            modes[-1].append(camera)
        else:
            modes.append([camera])
    return [sorted(mode) for mode in modes]


def _alike(cameras: list[tuple[str, str]]) -> str:
    flights = [flight for flight, _ in cameras]
    several = next(flight for flight in flights if flights.count(flight) > 1)
    ids = [camera_id for flight, camera_id in cameras if flight == several]
    return (
        f"Cameras {' and '.join(ids)} of {several} have the same calibration, so that it does not tell which of them "
        'filmed the other flights: nothing is shared. Give device = "NAME" to the cameras of each flight.'
    )


def _of_two_calibrations(groups: Mapping[Hashable, list[tuple[str, str]]]) -> list[str]:
    """What to say of named devices that are calibrated differently from flight to flight."""
    found: dict[str, list[list[tuple[str, str]]]] = {}
    for (name, _), cameras in groups.items():  # type: ignore[misc]
        if name is not None:
            found.setdefault(name, []).append(cameras)
    out = []
    for name, parts in found.items():
        if len(parts) > 1:
            each = "; ".join(", ".join(f"{camera_id} of {flight}" for flight, camera_id in part) for part in parts)
            out.append(
                f"Device {name} has different calibrations: {each}. Nothing is shared between these; give the same "
                "calibration where lens, zoom and mode were the same."
            )
    return out
