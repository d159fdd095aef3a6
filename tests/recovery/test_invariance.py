"""Results do not depend on what has no meaning: the order of cameras, the reference, where time begins, the unit.

All is computed with cameras by name and time counted from first detections (`pipeline.canonical`), so differences are
those of rounding: to a billionth of the claimed deviations where the order or the reference changes, to a hundredth of
a millionth where times do, which are not exact binary fractions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from skytrace.estimation.hints import Hints, OffsetHint
from skytrace.estimation.initialize import InitialPair
from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import Similarity, align_similarity
from skytrace.model.reconstruction import Reconstruction
from skytrace.model.track import Recording
from skytrace.pipeline import offline
from skytrace.pipeline.config import Config
from skytrace.pipeline.offline import Outcome, outcome, run
from skytrace.pipeline.prepare import prepare_recordings
from skytrace.simulation import presets, simulate

FLIGHT = replace(presets["realistic"], n_cameras=4, duration_s=45.0)
STAMPED = replace(FLIGHT, timestamps=True, variable_frame_rate=0.1)


def reconstruct(recordings, hints: Hints | None = None) -> Outcome:
    config = Config()
    return outcome(run(prepare_recordings(recordings, config.clean).recordings, config, hints=hints))


@pytest.fixture(scope="module", params=[FLIGHT, STAMPED], ids=["frames", "time stamps"])
def flight(request):
    recordings = simulate(request.param, np.random.default_rng(2)).recordings
    return recordings, reconstruct(recordings)


def assert_same(
    one: Reconstruction, other: Reconstruction, time_s: Callable[[FloatArray], FloatArray], tolerance: float
) -> None:
    """Trajectory, centres and lenses agree to a share of the claimed deviations; `time_s` maps one's times."""
    at = one.trajectory.sample_times(10.0)
    ours, theirs = one.trajectory.position(at), other.trajectory.position(time_s(at))
    both = np.isfinite(theirs[:, 0])
    assert (~both).sum() <= 2 * len(one.trajectory.segments)  # their very ends, by rounding
    move = align_similarity(theirs[both], ours[both])
    sigma = one.trajectory.sigma(at)[both]
    error = np.linalg.norm(move.apply(theirs[both]) - ours[both], axis=1)
    assert (error / sigma).max() <= tolerance
    np.testing.assert_allclose(move.scale * other.trajectory.sigma(time_s(at))[both], sigma, rtol=tolerance)
    assert set(one.cameras) == set(other.cameras)
    for camera_id, camera in one.cameras.items():
        twin = other.cameras[camera_id]
        away = move.apply(twin.camera_from_world.centre) - camera.camera_from_world.centre
        assert np.abs(away / camera.centre_deviation).max() <= tolerance
        np.testing.assert_allclose(twin.refined.focal_px, camera.refined.focal_px, rtol=1e-8)
        np.testing.assert_allclose(twin.refined.distortion, camera.refined.distortion, atol=1e-8)


def told_by(camera_id: str, one: Reconstruction, other: Reconstruction) -> Callable[[FloatArray], FloatArray]:
    """The map of one's times to the other's that shows the same on a camera's clock."""
    ours, theirs = one.cameras[camera_id].clock, other.cameras[camera_id].clock
    return lambda t: theirs.offset_s + (t - ours.offset_s) / ours.period_s * theirs.period_s


@pytest.mark.parametrize("order", [(3, 2, 1, 0), (1, 2, 3, 0), (0, 3, 1, 2)])
def test_the_order_of_cameras_and_the_reference_do_not_matter(flight, order):
    recordings, found = flight
    turned = reconstruct([recordings[k] for k in order]).reconstruction
    one = found.reconstruction
    assert list(turned.cameras) == [recordings[k].camera_id for k in order]
    assert turned.reference == recordings[order[0]].camera_id
    reference = turned.cameras[turned.reference]
    np.testing.assert_allclose(reference.camera_from_world.centre, 0, atol=1e-12)
    assert reference.clock_deviation.offset_s == 0
    assert_same(one, turned, told_by("cam2", one, turned), 1e-8)


def shifted(recording: Recording, frames: int, time_s: float) -> Recording:
    """The recording with other frame numbers and time stamps."""
    return replace(
        recording,
        tracks=tuple(
            replace(t, frame=t.frame + frames, time_s=None if t.time_s is None else t.time_s + time_s)
            for t in recording.tracks
        ),
    )


def test_where_frames_and_time_begin_does_not_matter(flight):
    recordings, found = flight
    one = found.reconstruction
    frames = {"cam0": 1_000_000, "cam1": 123_457, "cam2": 0, "cam3": 999_983}
    stamps_s = {"cam0": 3.7e4, "cam1": -1.1e5, "cam2": 86_400.0, "cam3": 0.3}
    moved = [shifted(r, frames[r.camera_id], stamps_s[r.camera_id]) for r in recordings]
    other = reconstruct(moved)
    begin_s = {
        r.camera_id: stamps_s[r.camera_id] if r.stamped else frames[r.camera_id] / r.frame_rate_hz for r in recordings
    }
    assert_same(one, other.reconstruction, lambda t: t + begin_s["cam0"], 1e-6)
    for camera_id, camera in one.cameras.items():
        twin = other.reconstruction.cameras[camera_id]
        for frame in (0, 500):
            late = twin.clock.world_time(frame + frames[camera_id], 0.0) - begin_s["cam0"]
            assert late == pytest.approx(camera.clock.world_time(frame, 0.0), abs=1e-9)
        assert twin.clock_deviation.period_s == pytest.approx(camera.clock_deviation.period_s, rel=1e-6)
        np.testing.assert_array_equal(twin.residuals.frame, camera.residuals.frame + frames[camera_id])
        np.testing.assert_allclose(twin.residuals.time_s - begin_s["cam0"], camera.residuals.time_s, atol=1e-9)
        offset_s, rate = found.synchronisation.clocks[camera_id]
        shifted_s, twin_rate = other.synchronisation.clocks[camera_id]
        assert twin_rate == pytest.approx(rate, abs=1e-9)
        assert shifted_s + rate * begin_s[camera_id] - begin_s["cam0"] == pytest.approx(offset_s, abs=1e-6)
    for pair, twin in zip(found.synchronisation.evidence, other.synchronisation.evidence, strict=True):
        moved_s = twin.offset_s + twin.rate * begin_s[twin.camera0] - begin_s[twin.camera1]
        assert moved_s == pytest.approx(pair.offset_s, abs=1e-6)


def test_hints_mean_the_same_wherever_time_begins():
    """Offsets refer to the clocks as they were given."""
    recordings = simulate(FLIGHT, np.random.default_rng(2)).recordings
    clocks = reconstruct(recordings).synchronisation.clocks
    moved = [shifted(r, 10_000, 0.0) for r in recordings]
    begin_s = {r.camera_id: 10_000 / r.frame_rate_hz for r in recordings}
    true = Hints(tuple(OffsetHint(c, clocks[c][0] - begin_s[c], 0.5) for c in clocks))
    verdicts = reconstruct(moved, true).synchronisation.hints
    assert {v.verdict for v in verdicts} == {"agrees"}
    assert max(abs(v.error_s) for v in verdicts if v.error_s is not None) < 0.3


@pytest.mark.parametrize("unit", [1e-3, 4096.0])
def test_the_world_unit_does_not_matter(monkeypatch, flight, unit):
    """The first pair has a unit baseline: with any other all lengths scale, and nothing else changes."""
    recordings, found = flight
    plain = offline.initial_pairs

    def in_another_unit(*arguments) -> list[InitialPair]:
        return [replace(pair, scene=scaled(pair.scene, unit)) for pair in plain(*arguments)]

    monkeypatch.setattr(offline, "initial_pairs", in_another_unit)
    other = reconstruct(recordings)
    spread = [np.ptp(o.adjusted.state.centre, axis=0).max() for o in (found, other)]
    assert spread[1] / spread[0] == pytest.approx(unit, rel=1e-6)
    assert_same(found.reconstruction, other.reconstruction, lambda t: t, 1e-6)


def scaled(scene, unit: float):
    """The scene in another unit."""
    move = Similarity(unit, np.eye(3), np.zeros(3))
    cameras = {
        c: replace(k, camera_from_world=move.apply_to_pose(k.camera_from_world)) for c, k in scene.cameras.items()
    }
    control = None if scene.control is None else unit * scene.control
    return replace(scene, cameras=cameras, control=control)
