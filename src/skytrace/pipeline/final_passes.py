"""The adjustments of everything at once that end a reconstruction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from skytrace.estimation.adjust.driver import Adjusted
from skytrace.estimation.clock_wander import Wander, find_wander, retimed
from skytrace.estimation.coverage import CoverageSettings
from skytrace.estimation.finish import finish, refined_paths
from skytrace.estimation.grow import Grown, Growth, complete
from skytrace.estimation.known import Known
from skytrace.estimation.known_placement import Placed, place
from skytrace.estimation.posterior import posterior
from skytrace.model.track import Recording
from skytrace.pipeline.assemble import supported_knots
from skytrace.pipeline.config import Config


@dataclass(frozen=True, eq=False, slots=True)
class Finished:
    """The scene after a final pass, with the recordings as retimed so far."""

    adjusted: Adjusted
    missing: Mapping[str, str]
    recordings: Mapping[str, Recording]
    wander: Mapping[str, Wander]
    passes_done: int
    passes: int
    placed: Placed | None


def final_passes(grown: Grown, growth: Growth, config: Config, known: Known | None) -> Iterator[Finished]:
    """Adjust everything, the second time on even clocks and with cameras that failed before; once more if any did.

    From the second time on the scene lies in the frame of what is known.
    """
    recordings, paths = dict(growth.recordings), growth.paths
    wander: dict[str, Wander] = {}
    passes, k, placed = config.passes, 0, None
    while k < passes:
        if known is not None and placed is None and (k > 0 or passes == 1):
            placed = _placed(grown.adjusted, known, config.coverage)
            grown = replace(grown, adjusted=placed.adjusted)
        adjusted = finish(
            grown.adjusted,
            recordings,
            config.structure,
            config.adjust,
            config.freedom,
            config.finish,
            retriangulate=k > 0,
            known=known if placed is None else placed.known,
        )
        grown = replace(grown, adjusted=adjusted)
        if k == 0:
            wander = find_wander(adjusted, config.wander) if config.freedom.clocks else {}
            recordings |= {c: retimed(recordings[c], w, adjusted.scene.cameras[c].rate) for c, w in wander.items()}
            refined = {**paths, **refined_paths(adjusted.scene, recordings)}
            before = len(adjusted.camera_ids)
            for further in complete(grown, replace(growth, recordings=recordings, paths=refined)):
                grown = further
            passes += bool(wander) or len(grown.adjusted.camera_ids) > before
        k += 1
        yield Finished(grown.adjusted, grown.missing, recordings, wander, k, passes, placed)


def _placed(adjusted: Adjusted, known: Known, coverage: CoverageSettings) -> Placed:
    """The scene where what is known puts it."""
    own_time_s = np.zeros(len(adjusted.camera_ids))
    shape = posterior(adjusted, own_time_s, supported_knots(adjusted, coverage)).centre_covariance
    return place(adjusted, known, shape)
