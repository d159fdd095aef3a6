"""The adjustment of everything at once, lenses and rolling shutter included, on a trajectory triangulated with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from skytrace.estimation.adjust.camera_priors import CameraTerm
from skytrace.estimation.adjust.driver import Adjusted, adjust
from skytrace.estimation.adjust.settings import AdjustSettings, Freedom
from skytrace.estimation.correspond import ImagePath, image_path
from skytrace.estimation.known import Known
from skytrace.estimation.scene import CameraState, Scene
from skytrace.estimation.structure import StructureSettings, fit_structure, triangulate_scene
from skytrace.model.track import Recording


@dataclass(frozen=True, slots=True)
class FinishSettings:
    rounds: int = 4  # of estimating the noise within an adjustment
    iterations: int = 12
    last_iterations: int = 40  # of the last round, which is to settle
    min_cameras_for_lens: int = 3  # with fewer, a free focal length ruins the geometry


def finish(
    adjusted: Adjusted,
    recordings: Mapping[str, Recording],
    structure: StructureSettings,
    adjustment: AdjustSettings,
    freedom: Freedom,
    settings: FinishSettings,
    *,
    retriangulate: bool,
    terms: tuple[CameraTerm, ...] = (),
    known: Known | None = None,
) -> Adjusted:
    """Adjust all parameters that `freedom` allows and the number of cameras supports.

    With `retriangulate` the trajectory is first built anew from the refined lenses and clocks, which reaches where the
    calibrated ones did not agree. `known` is what is known of the cameras, by default what the scene was adjusted to
    already.
    """
    # The gauge is the first camera listed, so that results do not depend on how the growth went.
    scene = replace(adjusted.scene, reference=next(c for c in recordings if c in adjusted.scene.cameras))
    if len(scene.cameras) < settings.min_cameras_for_lens:
        freedom = replace(freedom, focal=False, lens=False)
    if retriangulate:
        found = triangulate_scene(scene, refined_paths(scene, recordings), structure)
        scene = fit_structure(scene, found, structure)
    return adjust(
        scene,
        recordings,
        adjustment,
        freedom,
        rounds=settings.rounds,
        iterations=settings.iterations,
        last_iterations=settings.last_iterations,
        previous=adjusted,
        terms=terms,
        known=adjusted.known if known is None else known,
    )


def refined_paths(scene: Scene, recordings: Mapping[str, Recording]) -> dict[str, ImagePath]:
    """Image paths of the registered cameras with the lenses and readouts found so far."""
    return {c: refined_path(camera, recordings[c]) for c, camera in scene.cameras.items()}


def refined_path(camera: CameraState, recording: Recording) -> ImagePath:
    """One camera's image path with its lens and readout found so far."""
    readout_fraction = camera.readout_s / camera.rate * recording.frame_rate_hz
    return image_path(replace(recording, intrinsics=camera.intrinsics(recording.intrinsics)), readout_fraction)
