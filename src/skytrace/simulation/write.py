"""A simulated flight as a FLIGHT folder: what `skytrace reconstruct` reads, and the truth to judge its result by."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from skytrace.io.calibration_writer import calibration_text
from skytrace.model.track import Recording
from skytrace.simulation.simulator import SimulatedFlight, Truth

_DETECTIONS_COLUMNS = "frame x y"


def write_flight(
    simulated: SimulatedFlight,
    folder: str | Path,
    *,
    rate_hz: float = 5.0,
    name: str = "simulated",
    write_videos: Callable[[Path], None] | None = None,
) -> Path:
    """Write a simulated flight into a new folder, which appears only once it is complete; returns the folder.

    With `write_videos`, which is to write `video/ID.mp4` of every camera into the folder it is given, the flight
    consists of these and has no detections. The true trajectory is sampled at `rate_hz`, its first sample where the
    flight begins. Raises ValueError on a rate that is not positive, and InputError where the folder exists and is not
    empty, or cannot be made.
    """
    from skytrace.io.atomic import atomic_folder

    if not (np.isfinite(rate_hz) and rate_hz > 0):
        raise ValueError(f"rate_hz: expected a positive number, got {rate_hz}")
    with atomic_folder(folder, replace_run=False) as root:
        for part in ("calibration", "truth"):
            (root / part).mkdir(parents=True)
        for recording in simulated.recordings:
            _write_calibration(root / "calibration", recording)
        if write_videos is None:
            (root / "detections").mkdir()
            for recording in simulated.recordings:
                _write_detections(root / "detections", recording)
        else:
            write_videos(root)
        _write_truth(root / "truth", simulated, rate_hz)
        description = _flight_toml(simulated, rate_hz, name, videos=write_videos is not None)
        (root / "flight.toml").write_text(description, encoding="utf-8")
    return Path(folder)


def _flight_toml(simulated: SimulatedFlight, rate_hz: float, name: str, videos: bool) -> str:
    lines = [f"name = {json.dumps(name)}"]
    for recording in simulated.recordings:
        camera_id = recording.camera_id
        lines += [
            "",
            "[[camera]]",
            f'id = "{camera_id}"',
            f'calibration = "calibration/{camera_id}.json"',
        ]
        if videos:
            lines.append(f'video = "video/{camera_id}.mp4"')
            continue
        lines += [
            f'detections = "detections/{camera_id}.txt"',
            f'detections_columns = "{_DETECTIONS_COLUMNS}"',
        ]
        if recording.tracks[0].time_s is not None:
            lines.append(f'timestamps = "detections/{camera_id}_timestamps.txt"')
    lines += [
        "",
        "[truth]",
        'trajectory = "truth/trajectory.txt"',
        f"rate_hz = {float(rate_hz)!r}",
        'positions = "truth/positions.csv"',
        'synchronisation = "truth/synchronisation.csv"',
        'orientations = "truth/cameras.json"',
    ]
    return "\n".join(lines) + "\n"


def _write_calibration(folder: Path, recording: Recording) -> None:
    text = calibration_text(recording.intrinsics, recording.frame_rate_hz)
    (folder / f"{recording.camera_id}.json").write_text(text, encoding="utf-8")


def _write_detections(folder: Path, recording: Recording) -> None:
    camera_id, track = recording.camera_id, recording.tracks[0]
    whole = bool((track.xy_px == np.rint(track.xy_px)).all())
    pixel = "%d" if whole else "%.12g"
    np.savetxt(
        folder / f"{camera_id}.txt",
        np.column_stack([track.frame, track.xy_px]),
        fmt=f"%d {pixel} {pixel}",
    )
    if track.time_s is not None:
        stamps = np.column_stack([track.frame.astype(float), track.time_s])
        np.savetxt(folder / f"{camera_id}_timestamps.txt", stamps, fmt="%d %.9f")


def _write_truth(folder: Path, simulated: SimulatedFlight, rate_hz: float) -> None:
    truth = simulated.truth
    motion = truth.motion
    n = int(np.floor((motion.end_s - motion.begin_s) * rate_hz + 1e-9)) + 1
    time_s = motion.begin_s + np.arange(n) / rate_hz
    np.savetxt(folder / "trajectory.txt", motion.position(time_s), fmt="%.9f")
    positions, synchronisation = ["camera,x,y,z"], ["camera,slope,intercept"]
    for camera_id, camera in truth.cameras.items():
        x, y, z = camera.camera_from_world.centre.tolist()
        slope, intercept = truth.synchronisation(camera_id)
        positions.append(f"{camera_id},{x!r},{y!r},{z!r}")
        synchronisation.append(f"{camera_id},{slope!r},{intercept!r}")
    (folder / "positions.csv").write_text("\n".join(positions) + "\n", encoding="utf-8")
    (folder / "synchronisation.csv").write_text("\n".join(synchronisation) + "\n", encoding="utf-8")
    _write_json(folder / "cameras.json", _cameras(truth))
    _write_json(folder / "scenario.json", dataclasses.asdict(simulated.scenario))


def _cameras(truth: Truth) -> dict[str, object]:
    cameras = {}
    for camera_id, camera in truth.cameras.items():
        clock = camera.clock
        cameras[camera_id] = {
            "clock": {"offset_s": clock.offset_s, "period_s": clock.period_s, "readout_s": clock.readout_s},
            "rotation_camera_from_world": camera.camera_from_world.rotation.tolist(),
            "centre": camera.camera_from_world.centre.tolist(),
            "focal_px": camera.intrinsics.focal_px.tolist(),
            "focal_px_calibrated": camera.calibrated.focal_px.tolist(),
            "principal_px": camera.intrinsics.principal_px.tolist(),
            "distortion": camera.intrinsics.distortion.tolist(),
            "model": camera.intrinsics.model,
            "size_px": list(camera.intrinsics.size_px),
        }
    motion = truth.motion
    return {"reference": truth.reference, "begin_s": motion.begin_s, "end_s": motion.end_s, "cameras": cameras}


def _write_json(path: Path, content: object) -> None:
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
