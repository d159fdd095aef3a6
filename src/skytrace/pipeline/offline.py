"""The offline reconstruction: each stage yields its product, so that callers save, show or test one stream."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from skytrace.errors import ReconstructionError
from skytrace.estimation.adjust.driver import Adjusted
from skytrace.estimation.clock_wander import Wander, find_wander, retimed
from skytrace.estimation.correspond import image_path
from skytrace.estimation.finish import finish, refined_paths
from skytrace.estimation.grow import Grown, Growth, complete, grow
from skytrace.estimation.initialize import initial_pairs
from skytrace.estimation.posterior import Posterior
from skytrace.estimation.synchronize import Synchronisation, synchronize
from skytrace.model.reconstruction import Reconstruction
from skytrace.model.track import Recording
from skytrace.pipeline.assemble import assemble
from skytrace.pipeline.config import Config


@dataclass(frozen=True, eq=False, slots=True)
class Stage:
    """One step of the stream: its name, how far it is, and what it produced (None while it is under way)."""

    name: str
    done: int
    total: int
    product: Any = None


@dataclass(frozen=True, eq=False, slots=True)
class Outcome:
    """The end of the stream."""

    reconstruction: Reconstruction
    adjusted: Adjusted
    posterior: Posterior
    synchronisation: Synchronisation
    wander: Mapping[str, Wander]  # of the cameras whose clocks run unevenly


_GROSS_RATE = 0.01

Progress = Callable[[str, int, int], None]


def run(
    recordings: Sequence[Recording],
    config: Config,
    *,
    hints_s: Mapping[str, float] | None = None,
    progress: Progress = lambda name, done, total: None,
) -> Iterator[Stage]:
    """Reconstruct a flight from cleaned recordings; the last stage's product is the Outcome.

    `hints_s` are rough clock offsets, never needed. Raises ReconstructionError where the data determine nothing.
    """
    given = {r.camera_id: r for r in recordings if r.n_detections}
    silent = {r.camera_id: "it has no usable detections" for r in recordings if not r.n_detections}
    if len(given) < 2:
        raise ReconstructionError(
            "synchronise",
            "fewer than two cameras have usable detections",
            counts={"cameras given": len(recordings), "with detections": len(given)},
            hint="See what was dropped and why in the log; check image sizes and the columns of the detections",
        )
    measured = {c: r.frame_rate_hz for c, r in given.items()}
    readout = config.adjust.readout_fraction
    paths = {c: image_path(r, readout) for c, r in given.items()}
    synchronisation = synchronize(
        paths,
        config.synchronise,
        np.random.default_rng(config.seed),
        hints_s,
        lambda done, total: progress("synchronise", done, total),
    )
    yield Stage("synchronise", 1, 1, synchronisation)

    given, clocks = correct_frame_rates(given, synchronisation.clocks)
    paths |= {c: image_path(r, readout) for c, r in given.items() if r.frame_rate_hz != measured[c]}
    synchronisation = replace(synchronisation, clocks=clocks)
    starts = initial_pairs(synchronisation, paths, given, config.initialise, config.structure, readout)
    yield Stage("initialise", 1, 1, starts)

    growth = Growth(
        given,
        paths,
        synchronisation.clocks,
        config.structure,
        config.register,
        config.adjust,
        config.grow,
        config.seed,
    )
    grown: Grown | None = None
    for grown in grow(starts[0], growth):
        yield Stage("grow", len(grown.adjusted.camera_ids), len(synchronisation.clocks), grown)
    assert grown is not None  # the initial pair at least

    adjusted, missing, wander = grown.adjusted, grown.missing, {}
    passes = config.passes
    k = 0
    while k < passes:
        adjusted = finish(
            adjusted,
            given,
            config.structure,
            config.adjust,
            config.freedom,
            config.finish,
            retriangulate=k > 0,
        )
        yield Stage("adjust", k + 1, passes, adjusted)
        if k == 0:
            wander = find_wander(adjusted, config.wander)
            rates = {c: adjusted.scene.cameras[c].rate for c in wander}
            given |= {c: retimed(given[c], w, rates[c]) for c, w in wander.items()}
            passes += bool(wander)
        if missing and k == 0:
            growth = replace(growth, recordings=given, paths={**paths, **refined_paths(adjusted.scene, given)})
            for grown in complete(Grown(adjusted, None, missing), growth):
                adjusted, missing = grown.adjusted, grown.missing
        k += 1

    unregistered = {**silent, **synchronisation.untied, **missing}
    reconstruction, deviations = assemble(adjusted, given, unregistered, config.coverage)
    if not reconstruction.trajectory.segments:
        raise ReconstructionError(
            "cover",
            "no stretch of the trajectory is supported by two cameras that agree",
            threshold=config.coverage.min_segment_s,
            hint="The reconstruction contradicts itself; check calibrations and frame rates",
        )
    yield Stage("cover", 1, 1, Outcome(reconstruction, adjusted, deviations, synchronisation, wander))


def outcome(stages: Iterator[Stage]) -> Outcome:
    """Run a stream of `run` to its end."""
    product = None
    for stage in stages:
        product = stage.product
    if not isinstance(product, Outcome):
        raise ValueError("stages: expected a stream that ends in an Outcome")
    return product


def correct_frame_rates(
    recordings: Mapping[str, Recording], clocks: Mapping[str, tuple[float, float]]
) -> tuple[dict[str, Recording], dict[str, tuple[float, float]]]:
    """Recordings with the frame rates that synchronisation found where those given are grossly wrong, and their clocks.

    A real clock is never off by a per cent: there the given frame rate is a mistake, and the rate is folded into it.
    """
    corrected, found = dict(recordings), dict(clocks)
    for camera_id, (offset_s, rate) in clocks.items():
        recording = recordings[camera_id]
        if abs(rate - 1) > _GROSS_RATE and all(track.time_s is None for track in recording.tracks):
            corrected[camera_id] = replace(recording, frame_rate_hz=recording.frame_rate_hz / rate)
            found[camera_id] = (offset_s, 1.0)
    return corrected, found
