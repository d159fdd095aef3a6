"""Which cameras of several flights are one device."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skytrace.model.camera import Intrinsics
from skytrace.model.track import Recording
from skytrace.pipeline.devices import shared_devices


def lens(focal_px: float = 1000.0, size_px: tuple[int, int] = (1920, 1080)) -> Intrinsics:
    return Intrinsics(np.full(2, focal_px), np.array([960.0, 540.0]), np.zeros(5), size_px)


def flight(**cameras: tuple[Intrinsics, float]) -> dict[str, Recording]:
    return {c: Recording(c, own, rate_hz, ()) for c, (own, rate_hz) in cameras.items()}


def told(flights, names=None):
    devices, warnings = shared_devices(flights, names or {})
    return {d.name: (dict(d.camera_ids), d.same_readout) for d in devices}, warnings


def test_a_calibration_tells_a_device_whatever_its_camera_is_called() -> None:
    flights = {
        "one": flight(a=(lens(1000), 30.0), b=(lens(1100), 25.0)),
        "two": flight(x=(lens(1100), 25.0), y=(lens(1200), 30.0)),
    }
    assert told(flights) == ({"b/x": ({"one": "b", "two": "x"}, True)}, [])


def test_another_size_model_or_coefficient_is_another_lens() -> None:
    base = lens()
    others = [
        lens(size_px=(1280, 720)),
        replace(base, distortion=np.array([1e-9, 0, 0, 0, 0])),
        Intrinsics(base.focal_px, base.principal_px, np.zeros(4), base.size_px, "fisheye"),
    ]
    for other in others:
        assert told({"one": flight(a=(base, 30.0)), "two": flight(a=(other, 30.0))}) == ({}, [])


def test_frame_rates_that_phones_miss_are_one_mode_and_others_are_not() -> None:
    def rates(*rates_hz: float):
        return told({str(k): flight(a=(lens(), rate_hz)) for k, rate_hz in enumerate(rates_hz)})[0]

    assert rates(30.0, 29.73) == {"a": ({"0": "a", "1": "a"}, True)}
    assert rates(24.0, 25.0) == {}
    assert rates(59.94, 29.97, 60.0) == {"a": ({"0": "a", "2": "a"}, True)}


def test_a_name_tells_a_device_and_keeps_others_apart() -> None:
    flights = {"one": flight(a=(lens(), 30.0), b=(lens(), 30.0)), "two": flight(a=(lens(), 60.0), b=(lens(), 30.0))}
    names = {"one": {"a": "left", "b": "right"}, "two": {"a": "left", "b": "right"}}
    assert told(flights, names) == (
        {"left": ({"one": "a", "two": "a"}, False), "right": ({"one": "b", "two": "b"}, True)},
        [],
    )
    assert told(flights, {"one": names["one"], "two": {"a": "other", "b": "another"}}) == ({}, [])


def test_a_named_device_is_shared_only_where_its_calibrations_agree() -> None:
    flights = {"one": flight(a=(lens(1000), 30.0)), "two": flight(a=(lens(1001), 30.0))}
    devices, (warning,) = told(flights, {"one": {"a": "phone"}, "two": {"a": "phone"}})
    assert devices == {}
    assert "phone" in warning
    assert "a of one; a of two" in warning


def test_two_cameras_with_one_calibration_are_not_told_apart() -> None:
    flights = {"one": flight(a=(lens(), 30.0), b=(lens(), 30.0)), "two": flight(c=(lens(), 30.0))}
    devices, (warning,) = told(flights)
    assert devices == {}
    assert "Cameras a and b of one" in warning
    assert "device = " in warning
    assert told({"one": flights["one"], "two": flight(c=(lens(999), 30.0))}) == ({}, [])  # nothing to share anyway
