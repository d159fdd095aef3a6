"""What flights that were joined tell about it, in plain values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from skytrace.pipeline.joint import DeviceResult, Estimate, Joint


def joint_summary(
    joint: Joint,
    summaries: Mapping[str, Mapping[str, Any]],
    failures: Mapping[str, str],
    timings_s: Mapping[str, float],
) -> dict[str, Any]:
    """The content of the summary.json beside the runs. `summaries` are those of the runs, `failures` in words."""
    return {
        "flights": {
            **{
                name: {
                    "reconstructed": True,
                    "covered_s": own["covered_s"],
                    "cameras_registered": sum(c["registered"] for c in own["cameras"].values()),
                }
                for name, own in summaries.items()
            },
            **{name: {"reconstructed": False, "reason": why} for name, why in failures.items()},
        },
        "devices": [_device(result) for result in joint.devices],
        "rounds": joint.rounds,
        "agreed": joint.agreed,
        "warnings": list(joint.warnings),
        "timings_s": dict(timings_s),
    }


def shared_of_flight(joint: Joint, flight: str) -> tuple[dict[str, Any], list[str]]:
    """Which cameras of a flight share what with which others, by camera id; and what was not shared, in words."""
    shared: dict[str, Any] = {}
    warnings: list[str] = []
    for result in joint.devices:
        camera_id = result.device.camera_ids.get(flight)
        if camera_id is None:
            continue
        warnings += result.left_out.values()
        parameters = {name: s.alone for name, s in result.parameters.items() if flight in s.alone}
        if parameters:
            others = sorted({f for alone in parameters.values() for f in alone} - {flight})
            cameras = {f: result.device.camera_ids[f] for f in others}
            shared[camera_id] = {"device": result.device.name, "with": cameras, "parameters": list(parameters)}
    return shared, list(dict.fromkeys(warnings))


def _device(result: DeviceResult) -> dict[str, Any]:
    return {
        "name": result.device.name,
        "cameras": dict(result.device.camera_ids),
        "parameters": {
            name: {"alone": {f: _estimate(e) for f, e in shared.alone.items()}, "joint": _estimate(shared.joint)}
            for name, shared in result.parameters.items()
        },
        "left_out": dict(result.left_out),
    }


def _estimate(estimate: Estimate) -> dict[str, float]:
    return {"value": estimate.value, "sd": estimate.deviation}
