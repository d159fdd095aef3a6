"""The offline reconstruction: each stage yields its product, so that callers save, show or test one stream."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from skytrace.errors import ReconstructionError
from skytrace.estimation.adjust.driver import Adjusted
from skytrace.estimation.clock_wander import Wander
from skytrace.estimation.correspond import ImagePath, image_path
from skytrace.estimation.coverage import Cuts
from skytrace.estimation.finish import finish
from skytrace.estimation.given_offsets import given_synchronisation
from skytrace.estimation.grow import Grown, Growth, grow
from skytrace.estimation.hints import Hints
from skytrace.estimation.initialize import InitialPair, initial_pairs
from skytrace.estimation.known import Known
from skytrace.estimation.known_placement import Placed
from skytrace.estimation.lens_doubt import LensDoubt, doubted_lenses, doubting
from skytrace.estimation.posterior import Posterior
from skytrace.estimation.synchronize import Synchronisation, synchronize
from skytrace.model.reconstruction import Reconstruction
from skytrace.model.track import Recording
from skytrace.pipeline.assemble import assemble
from skytrace.pipeline.canonical import Origin, origins, rebased_hints, restored_synchronisation
from skytrace.pipeline.config import Config
from skytrace.pipeline.final_passes import Finished, final_passes
from skytrace.pipeline.frame_rates import correct_frame_rates


@dataclass(frozen=True, eq=False, slots=True)
class Stage:
    """One step of the stream: its name, how far it is, and what it produced."""

    name: str
    done: int
    total: int
    product: Any


@dataclass(frozen=True, eq=False, slots=True)
class Outcome:
    """The end of the stream. In `adjusted`, `wander` and `recordings` a camera's time is since its first detection."""

    reconstruction: Reconstruction
    adjusted: Adjusted
    posterior: Posterior
    synchronisation: Synchronisation
    wander: Mapping[str, Wander]  # of the cameras whose clocks run unevenly
    recordings: Mapping[str, Recording]  # those adjusted, with the frame rates and time stamps found
    origins: Mapping[str, Origin]  # that frames and times are counted from
    order: tuple[str, ...]  # in which cameras were given
    cuts: Cuts
    placed: Placed | None = None  # in the frame of what is known, and what of that held
    doubted: Mapping[str, LensDoubt] = field(default_factory=dict)  # calibrations that the flight contradicts


Progress = Callable[[str, int, int], None]
Synchronise = Callable[[Mapping[str, ImagePath], Config, Hints | None, Progress], Synchronisation]


def run(
    recordings: Sequence[Recording],
    config: Config,
    *,
    hints: Hints | None = None,
    known: Known | None = None,
    progress: Progress = lambda name, done, total: None,
    synchronise: Synchronise | None = None,
) -> Iterator[Stage]:
    """Reconstruct a flight from cleaned recordings; the last stage's product is the Outcome.

    `hints` are what is known of the clocks, `known` what is known of the cameras, neither ever needed; `progress` hears
    of the steps inside long stages; `synchronise` takes the place of `synchronise_paths`. Raises ReconstructionError
    where the data determine nothing.
    """
    given, silent = _usable(recordings)
    order, origin = tuple(given), origins(given)
    given = {c: at.rebased(given[c]) for c, at in origin.items()}
    readout = config.adjust.readout_fraction
    paths = {c: image_path(r, readout) for c, r in given.items()}
    synchronisation = (synchronise or synchronise_paths)(
        paths, config, rebased_hints(hints or Hints(), origin), progress
    )
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
    for finished in final_passes(grown, growth, config, known):
        yield Stage("adjust", finished.passes_done, finished.passes, finished.adjusted)
    assert finished is not None  # config.passes >= 1

    unregistered = {**silent, **synchronisation.untied, **finished.missing}
    product = _assembled(finished, as_given, unregistered, config, order, origin)
    doubted = doubted_lenses(product.adjusted, product.posterior.lens) if config.doubt_lenses else {}
    if doubted:
        product = _with_lenses_of_the_flight(product, doubted, config)
        yield Stage("adjust", finished.passes + 1, finished.passes + 1, product.adjusted)
    _require_covered(product, config)
    yield Stage("cover", 1, 1, product)


def _assembled(
    finished: Finished,
    synchronisation: Synchronisation,
    unregistered: Mapping[str, str],
    config: Config,
    order: tuple[str, ...],
    origin: Mapping[str, Origin],
) -> Outcome:
    """The outcome of the last pass."""
    reconstruction, deviations, cuts = assemble(
        finished.adjusted, finished.recordings, unregistered, config.coverage, order, origin
    )
    return Outcome(
        reconstruction,
        finished.adjusted,
        deviations,
        synchronisation,
        finished.wander,
        finished.recordings,
        origin,
        order,
        cuts,
        finished.placed,
    )


def _with_lenses_of_the_flight(before: Outcome, doubted: Mapping[str, LensDoubt], config: Config) -> Outcome:
    """The outcome with the radial distortion of doubted calibrations taken from the flight."""
    recordings = doubting(before.recordings, doubted)
    adjusted = finish(
        before.adjusted,
        recordings,
        config.structure,
        config.adjust,
        config.freedom,
        config.finish,
        retriangulate=True,
    )
    return _reassembled(replace(before, recordings=recordings, doubted=doubted), adjusted, config)


def concluded(before: Outcome, adjusted: Adjusted, config: Config) -> Outcome:
    """The outcome of a flight that was adjusted further. Raises ReconstructionError where nothing is covered."""
    product = _reassembled(before, adjusted, config)
    _require_covered(product, config)
    return product


def _reassembled(before: Outcome, adjusted: Adjusted, config: Config) -> Outcome:
    reconstruction, deviations, cuts = assemble(
        adjusted,
        before.recordings,
        before.reconstruction.unregistered,
        config.coverage,
        before.order,
        before.origins,
    )
    return replace(before, reconstruction=reconstruction, adjusted=adjusted, posterior=deviations, cuts=cuts)


def _require_covered(product: Outcome, config: Config) -> None:
    least, cut_s = config.coverage.min_cameras, product.cuts.cut_s
    if not product.reconstruction.trajectory.segments:
        raise ReconstructionError(
            "cover",
            f"no stretch of the trajectory is supported by {'two' if least == 2 else least} cameras that agree",
            counts={
                "cameras": len(product.reconstruction.cameras),
                **{f"{why.replace('_', ' ')} [s]": round(cut, 1) for why, cut in cut_s.items() if cut},
            },
            threshold=config.coverage.min_segment_s,
            hint="The reconstruction contradicts itself; check calibrations and frame rates",
        )


def synchronise_paths(
    paths: Mapping[str, ImagePath], config: Config, hints: Hints | None, progress: Progress
) -> Synchronisation:
    """The first stage: when each camera filmed, from image paths, the config's `synchronise` and seed, and hints."""
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
