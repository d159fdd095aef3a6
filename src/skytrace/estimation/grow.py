"""From the initial pair to all cameras: register, triangulate, adjust, one camera at a time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from skytrace.estimation.adjust.driver import Adjusted, AdjustSettings, Freedom, adjust
from skytrace.estimation.correspond import ImagePath
from skytrace.estimation.initialize import InitialPair
from skytrace.estimation.register import Registration, RegisterSettings, register
from skytrace.estimation.scene import N_LENS, CameraState, Scene
from skytrace.estimation.structure import StructureSettings, fit_structure, triangulate_scene
from skytrace.model.track import Recording


@dataclass(frozen=True, slots=True)
class GrowSettings:
    rounds: int = 2
    iterations: int = 6


@dataclass(frozen=True, eq=False, slots=True)
class Grown:
    """A scene after one more camera, with its adjustment, and why cameras still missing could not be added."""

    adjusted: Adjusted
    added: str | None
    missing: Mapping[str, str]


def grow(
    start: InitialPair,
    clocks: Mapping[str, tuple[float, float]],
    paths: Mapping[str, ImagePath],
    recordings: Mapping[str, Recording],
    *,
    structure: StructureSettings,
    registration: RegisterSettings,
    adjustment: AdjustSettings,
    settings: GrowSettings,
    seed: int,
) -> Iterator[Grown]:
    """Yield the scene of the initial pair and then after each camera added.

    Lenses stay at their calibration meanwhile: with two cameras a free focal length ruins the geometry. A camera that
    fails is tried again whenever another has been added.
    """
    fixed = Freedom(rolling_shutter=False, focal=False, lens=False)

    def settle(scene: Scene) -> Adjusted:
        found = triangulate_scene(scene, paths, structure)
        scene = fit_structure(scene, found, structure)
        return adjust(scene, recordings, adjustment, fixed, rounds=settings.rounds, iterations=settings.iterations)

    adjusted = settle(start.scene)
    waiting = [c for c in clocks if c not in start.scene.cameras]
    yield Grown(adjusted, None, dict.fromkeys(waiting, "not tried yet"))
    while waiting:
        scene = adjusted.scene
        supported = triangulate_scene(scene, paths, structure).time_s
        tried = {
            c: register(scene, supported, paths[c], *clocks[c], structure.rate_hz, registration, seed) for c in waiting
        }
        best = max(waiting, key=lambda c: (tried[c].camera_from_world is not None, tried[c].inlier_s))
        missing = {c: t.reason for c, t in tried.items() if c != best}
        pose = tried[best].camera_from_world
        if pose is None:
            yield Grown(adjusted, None, {c: t.reason for c, t in tried.items()})
            return
        readout = adjustment.readout_fraction / recordings[best].frame_rate_hz
        scene = scene.with_camera(best, CameraState(pose, *clocks[best], readout, np.zeros(N_LENS)))
        adjusted = settle(scene)
        waiting.remove(best)
        yield Grown(adjusted, best, missing)


