"""From the initial pair to all cameras: register, triangulate, adjust, one camera at a time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from skytrace.estimation.adjust.driver import Adjusted, adjust
from skytrace.estimation.adjust.settings import AdjustSettings, Freedom
from skytrace.estimation.correspond import ImagePath
from skytrace.estimation.initialize import InitialPair
from skytrace.estimation.register import RegisterSettings, register
from skytrace.estimation.scene import N_LENS, CameraState, Scene
from skytrace.estimation.structure import StructureSettings, fit_structure, triangulate_scene
from skytrace.model.track import Recording


@dataclass(frozen=True, slots=True)
class GrowSettings:
    rounds: int = 2
    iterations: int = 6


@dataclass(frozen=True, eq=False, slots=True)
class Growth:
    """What every step of the growth needs: the measurements, the clocks from synchronisation, and the settings.

    Of `freedom` only that of the clocks counts here.
    """

    recordings: Mapping[str, Recording]
    paths: Mapping[str, ImagePath]
    clocks: Mapping[str, tuple[float, float]]  # offset_s, rate
    structure: StructureSettings
    registration: RegisterSettings
    adjustment: AdjustSettings
    settings: GrowSettings
    seed: int
    freedom: Freedom = field(default_factory=Freedom)

    def settle(self, scene: Scene) -> Adjusted:
        """Triangulate with every camera there, fit the spline, adjust.

        Lenses stay at their calibration: with few cameras a free focal length ruins the geometry.
        """
        scene = fit_structure(scene, triangulate_scene(scene, self.paths, self.structure), self.structure)
        fixed = replace(self.freedom, rolling_shutter=False, focal=False, lens=False)
        rounds, iterations = self.settings.rounds, self.settings.iterations
        return adjust(scene, self.recordings, self.adjustment, fixed, rounds=rounds, iterations=iterations)


@dataclass(frozen=True, eq=False, slots=True)
class Grown:
    """A scene with its adjustment, the camera just added, and why cameras still missing could not be added."""

    adjusted: Adjusted
    added: str | None
    missing: Mapping[str, str]


def grow(start: InitialPair, growth: Growth) -> Iterator[Grown]:
    """Yield the scene of the initial pair and then after each camera added, until none can be."""
    waiting = [c for c in growth.clocks if c not in start.scene.cameras]
    grown = Grown(growth.settle(start.scene), None, dict.fromkeys(waiting, "not tried yet"))
    yield grown
    yield from complete(grown, growth)


def complete(grown: Grown, growth: Growth) -> Iterator[Grown]:
    """Add missing cameras one by one; those that fail are tried again whenever another has been added."""
    while grown.missing:
        grown = add_next(grown.adjusted, list(grown.missing), growth)
        yield grown
        if grown.added is None:
            return


def add_next(adjusted: Adjusted, waiting: Sequence[str], growth: Growth) -> Grown:
    """Register the waiting camera that agrees with most of the trajectory, and adjust."""
    scene, hz = adjusted.scene, growth.structure.rate_hz
    supported_s = triangulate_scene(scene, growth.paths, growth.structure).time_s
    tried = {
        c: register(scene, supported_s, growth.paths[c], *growth.clocks[c], hz, growth.registration, growth.seed)
        for c in waiting
    }
    best = max(waiting, key=lambda c: (tried[c].camera_from_world is not None, tried[c].inlier_s))
    pose = tried[best].camera_from_world
    if pose is None:
        return Grown(adjusted, None, {c: t.reason for c, t in tried.items()})
    readout_s = growth.adjustment.readout_fraction / growth.recordings[best].frame_rate_hz
    camera = CameraState(pose, *growth.clocks[best], readout_s, np.zeros(N_LENS))
    missing = {c: t.reason or "not tried yet" for c, t in tried.items() if c != best}
    return Grown(growth.settle(scene.with_camera(best, camera)), best, missing)
