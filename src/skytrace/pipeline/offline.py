"""The offline reconstruction: each stage yields its product, so that callers save, show or test one stream."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from skytrace.errors import ReconstructionError
from skytrace.estimation.adjust.driver import Adjusted
from skytrace.estimation.clock_wander import Wander, find_wander, retimed
from skytrace.estimation.correspond import ImagePath, image_path
from skytrace.estimation.finish import finish, refined_paths
from skytrace.estimation.given_offsets import given_synchronisation
from skytrace.estimation.grow import Grown, Growth, complete, grow
from skytrace.estimation.hints import Hints
from skytrace.estimation.initialize import InitialPair, initial_pairs
from skytrace.estimation.posterior import Posterior
from skytrace.estimation.synchronize import Synchronisation, synchronize
from skytrace.model.reconstruction import Reconstruction
from skytrace.model.track import Recording
from skytrace.pipeline.assemble import assemble
from skytrace.pipeline.canonical import origins, rebased_hints, restored_synchronisation
from skytrace.pipeline.config import Config


@dataclass(frozen=True, eq=False, slots=True)
class Stage:
    """One step of the stream: its name, how far it is, and what it produced."""

    name: str
    done: int
    total: int
    product: Any


@dataclass(frozen=True, eq=False, slots=True)
class Outcome:
    """The end of the stream. `adjusted` and `wander` count each camera's time from its first detection."""

    reconstruction: Reconstruction
    adjusted: Adjusted
    posterior: Posterior
    synchronisation: Synchronisation
    wander: Mapping[str, Wander]  # of the cameras whose clocks run unevenly


Progress = Callable[[str, int, int], None]
_GROSS_RATE = 0.01  # a real clock is never off by this much: the given frame rate is a mistake


def run(
    recordings: Sequence[Recording],
    config: Config,
    *,
    hints: Hints | None = None,
    progress: Progress = lambda name, done, total: None,
) -> Iterator[Stage]:
    """Reconstruct a flight from cleaned recordings; the last stage's product is the Outcome.

    `hints` are what is known of the clocks, never needed; `progress` hears of the steps inside long stages. Raises
    ReconstructionError where the data determine nothing.
    """
    given, silent = _usable(recordings)
    order, origin = tuple(given), origins(given)
    given = {c: at.rebased(given[c]) for c, at in origin.items()}
    readout = config.adjust.readout_fraction
    paths = {c: image_path(r, readout) for c, r in given.items()}
    synchronisation = _synchronise(paths, config, rebased_hints(hints or Hints(), origin), progress)
    as_given = restored_synchronisation(synchronisation, origin)
    yield Stage("synchronise", 1, 1, as_given)

    corrected, clocks = correct_frame_rates(given, synchronisation.clocks)
    paths |= {c: image_path(r, readout) for c, r in corrected.items() if r is not given[c]}
    origin = {c: at.stretched(given[c].frame_rate_hz / corrected[c].frame_rate_hz) for c, at in origin.items()}
    starts = initial_pairs(
        replace(synchronisation, clocks=clocks), paths, corrected, config.initialise, config.structure, readout
    )
    yield Stage("initialise", 1, 1, starts)

    growth = Growth(
        corrected,
        paths,
        clocks,
        config.structure,
        config.register,
        config.adjust,
        config.grow,
        config.seed,
        config.freedom,
    )
    grown = None
    for grown in _grow_from_best(starts[: config.start_attempts], growth):
        yield Stage("grow", len(grown.adjusted.camera_ids), len(clocks), grown)
    assert grown is not None  # _grow_from_best yields or raises

    finished = None
    for finished in _finish(grown, growth, config):
        yield Stage("adjust", finished.passes_done, finished.passes, finished.adjusted)
    assert finished is not None  # config.passes >= 1

    unregistered = {**silent, **synchronisation.untied, **finished.missing}
    reconstruction, deviations = assemble(
        finished.adjusted, finished.recordings, unregistered, config.coverage, order, origin
    )
    if not reconstruction.trajectory.segments:
        raise ReconstructionError(
            "cover",
            "no stretch of the trajectory is supported by two cameras that agree",
            counts={"cameras": len(reconstruction.cameras)},
            threshold=config.coverage.min_segment_s,
            hint="The reconstruction contradicts itself; check calibrations and frame rates",
        )
    product = Outcome(reconstruction, finished.adjusted, deviations, as_given, finished.wander)
    yield Stage("cover", 1, 1, product)


def _synchronise(
    paths: Mapping[str, ImagePath], config: Config, hints: Hints | None, progress: Progress
) -> Synchronisation:
    if config.synchronise.method == "given":
        return given_synchronisation(paths, hints or Hints(), config.synchronise)
    return synchronize(
        paths,
        config.synchronise,
        np.random.default_rng(config.seed),
        hints,
        lambda done, total: progress("synchronise", done, total),
    )


def outcome(stages: Iterator[Stage]) -> Outcome:
    """Run a stream of `run` to its end."""
    product = None
    for stage in stages:
        product = stage.product
    if not isinstance(product, Outcome):
        raise ValueError("stages: expected a stream that ends in an Outcome")
    return product


def _usable(recordings: Sequence[Recording]) -> tuple[dict[str, Recording], dict[str, str]]:
    """Recordings with tracks by camera, and why the others are out. Raises where fewer than two are left."""
    given = {r.camera_id: r for r in recordings if r.n_detections}
    silent = {r.camera_id: "it has no usable detections" for r in recordings if not r.n_detections}
    if len(given) < 2:
        raise ReconstructionError(
            "clean",
            "fewer than two cameras have usable detections",
            counts={"cameras given": len(recordings), "with detections": len(given)},
            threshold=2,
            hint="Check the image sizes in the calibrations, the columns of the detections, and how many detections "
            "follow each other",
        )
    return given, silent


def correct_frame_rates(
    recordings: Mapping[str, Recording], clocks: Mapping[str, tuple[float, float]]
) -> tuple[dict[str, Recording], dict[str, tuple[float, float]]]:
    """Recordings with the frame rates that synchronisation found where those given are grossly wrong, and their clocks.

    The rate found is folded into the frame rate, and into the time stamps, which are stretched in slowed-down videos.
    """
    corrected, found = dict(recordings), dict(clocks)
    for camera_id, (offset_s, rate) in clocks.items():
        if abs(rate - 1) > _GROSS_RATE:
            corrected[camera_id] = _stretched(recordings[camera_id], rate)
            found[camera_id] = (offset_s, 1.0)
    return corrected, found


def _stretched(recording: Recording, rate: float) -> Recording:
    """The same frames, `rate` times as far apart."""
    tracks = tuple(t if t.time_s is None else replace(t, time_s=rate * t.time_s) for t in recording.tracks)
    return replace(recording, frame_rate_hz=recording.frame_rate_hz / rate, tracks=tracks)


def _grow_from_best(starts: Sequence[InitialPair], growth: Growth) -> Iterator[Grown]:
    """Grow from one initial pair after another until all cameras are in; the last one yielded is the largest."""
    best: Grown | None = None
    failure: ReconstructionError | None = None
    for start in starts:
        grown = None
        try:
            for grown in grow(start, growth):
                yield grown
        except ReconstructionError as error:
            failure = error
        if grown is not None and (best is None or len(grown.adjusted.camera_ids) > len(best.adjusted.camera_ids)):
            best = grown
        if best is not None and not best.missing:
            break
    if best is None:
        assert failure is not None  # there is at least one start
        raise failure
    yield best


@dataclass(frozen=True, eq=False, slots=True)
class _Finished:
    """The scene after a final pass, with the recordings as retimed so far."""

    adjusted: Adjusted
    missing: Mapping[str, str]
    recordings: Mapping[str, Recording]
    wander: Mapping[str, Wander]
    passes_done: int
    passes: int


def _finish(grown: Grown, growth: Growth, config: Config) -> Iterator[_Finished]:
    """Adjust everything, the second time on even clocks and with cameras that failed before; once more if any did."""
    recordings, paths = dict(growth.recordings), growth.paths
    wander: dict[str, Wander] = {}
    passes, k = config.passes, 0
    while k < passes:
        adjusted = finish(
            grown.adjusted,
            recordings,
            config.structure,
            config.adjust,
            config.freedom,
            config.finish,
            retriangulate=k > 0,
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
        yield _Finished(grown.adjusted, grown.missing, recordings, wander, k, passes)
