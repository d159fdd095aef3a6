"""How the adjustment's time and memory grow with the length of a flight: 12 cameras at 60 frames a second.

    python -m benchmarks.adjustment_scaling [--minutes 5 15 60] [--cameras 12] [--iterations 6]

The problem is built from a simulated flight without a detour through the pipeline: its true state, moved off the truth
by what a reconstruction starts with. Each length runs in a process of its own. Times are CPU: of one linearisation
("build"), of one elimination and step ("solve"), of one evaluation of the cost, of an iteration of Levenberg-Marquardt
on average, and of the posterior deviations of the whole trajectory. "peak" is the process's memory, "before" that with
the problem built. "error" is the root mean square distance between the estimated and the true control points after a
similarity, "sigma" the median deviation claimed. Beside them the machine's reference loop, a product of two 500 x 500
matrices, so that ratios can be compared between machines.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import resource
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from benchmarks.adjustment import best_ms
from skytrace.estimation.adjust import normal, solve
from skytrace.estimation.adjust.camera_priors import Priors
from skytrace.estimation.adjust.driver import Adjusted, make_priors
from skytrace.estimation.adjust.problem import (
    N_PARAMETERS,
    KnotGrid,
    Observations,
    Problem,
    State,
    Weights,
    calibration_row,
)
from skytrace.estimation.adjust.settings import AdjustSettings, Freedom
from skytrace.estimation.posterior import knot_weights, posterior
from skytrace.estimation.priors import MotionPrior, balanced, motion_prior
from skytrace.estimation.scene import Scene
from skytrace.geometry.rigid import align_similarity
from skytrace.model.camera import Intrinsics
from skytrace.model.track import Recording
from skytrace.simulation import Scenario
from skytrace.simulation.cameras import TrueCamera, draw_cameras, draw_clocks
from skytrace.simulation.flight import SplineMotion, build_motion

T = TypeVar("T")
RATE_HZ, NOISE_PX = 60.0, 0.5
# What a start is off by: rotation, centre in m, offset in s, rate, readout in s; the lens starts as calibrated.
OFF = np.r_[[2e-3] * 3, [0.2] * 3, 5e-3, 1e-6, 2e-3, [0.0] * 7]
OFF_CONTROL_M = 0.2


@dataclass(frozen=True, eq=False, slots=True)
class Case:
    """A simulated problem, its truth, and a start off the truth."""

    problem: Problem
    truth: State
    start: State
    priors: Priors
    weights: Weights
    motion: MotionPrior
    camera_ids: tuple[str, ...]


def simulated(minutes: float, n_cameras: int, rng: np.random.Generator) -> Case:
    """A flight of some minutes, every frame of every camera that shows the target detected."""
    scenario = Scenario(
        motion="spline", duration_s=60 * minutes, n_cameras=n_cameras, frame_rates_hz=(RATE_HZ,),
        resolutions_px=((1920, 1080),), camera_distance=1.5, readout_spread=0.05,
    )  # fmt: skip
    clocks, begin_s = draw_clocks(scenario, rng)
    motion = build_motion(scenario, begin_s, rng)
    assert isinstance(motion, SplineMotion)
    cameras = draw_cameras(scenario, clocks, rng)
    segment = motion.segment
    first = round(segment.knot_start_s / segment.knot_spacing_s)
    grid = KnotGrid(segment.knot_spacing_s, ((first, first + len(segment.control_in_world) - 3),))
    problem, truth = _detected(cameras, grid, np.array(segment.control_in_world), begin_s, motion.end_s, rng)
    by_camera = OFF * rng.normal(size=(n_cameras, N_PARAMETERS))
    by_camera[0, :8] = 0.0  # the reference
    start = truth.moved(by_camera, OFF_CONTROL_M * rng.normal(size=truth.control.shape))
    start = replace(start, lens=np.zeros_like(truth.lens))
    recordings = {
        c: Recording(c, camera.calibrated, RATE_HZ, ()) for c, camera in zip(scenario.camera_ids, cameras, strict=True)
    }
    priors = make_priors(problem, recordings, scenario.camera_ids, AdjustSettings(), Freedom(), 1.0)
    prior = motion_prior("jerk", grid.spacing_s, grid.runs, 1.0)
    prior = replace(prior, extent=np.ones(grid.n_control))
    prior = balanced(prior, truth.control, prior.rank / prior.energy(truth.control))
    weights = Weights(np.full(n_cameras, NOISE_PX), np.ones(n_cameras))
    return Case(problem, truth, start, priors, weights, prior, scenario.camera_ids)


def _detected(
    cameras: tuple[TrueCamera, ...],
    grid: KnotGrid,
    control: np.ndarray,
    begin_s: float,
    end_s: float,
    rng: np.random.Generator,
) -> tuple[Problem, State]:
    """Every frame in which a camera has the target in its image, and the true state."""
    frames, clock = [], []
    for camera in cameras:
        k = np.arange(
            np.ceil((begin_s - camera.clock.offset_s) / camera.clock.period_s),
            np.floor((end_s - camera.clock.offset_s) / camera.clock.period_s),
        )
        mean = k.mean() / RATE_HZ
        frames.append(k / RATE_HZ - mean)
        rate = camera.clock.period_s * RATE_HZ
        clock.append([camera.clock.offset_s + rate * mean, rate, camera.clock.readout_s])
    truth = State(
        np.stack([c.camera_from_world.rotation for c in cameras]),
        np.stack([c.camera_from_world.centre for c in cameras]),
        np.array(clock),
        np.stack([lens_change(c.calibrated, c.intrinsics) for c in cameras]),
        control,
    )
    index = np.repeat(np.arange(len(cameras)), [len(f) for f in frames])
    tau, row = np.concatenate(frames), np.full(len(index), 0.5)
    lenses = [c.calibrated for c in cameras]
    calibration = np.stack([calibration_row(lens) for lens in lenses])
    problem = Problem(Observations(index, tau, row, np.zeros((len(index), 2))), calibration, grid, 0)
    xy = solve.predict(problem, truth)
    for _ in range(4):  # the row that is exposed when the target is on it
        xy = solve.predict(problem, truth)
        row = np.clip(xy[:, 1] / lenses[0].height_px, 0, 1)
        problem = replace(problem, observations=replace(problem.observations, row=row))
    width, height = lenses[0].size_px
    with np.errstate(invalid="ignore"):
        shown = (xy > 0).all(axis=1) & (xy[:, 0] < width) & (xy[:, 1] < height)
    noisy = xy[shown] + NOISE_PX * rng.normal(size=(int(shown.sum()), 2))
    return replace(problem, observations=Observations(index[shown], tau[shown], row[shown], noisy)), truth


def lens_change(calibrated: Intrinsics, true: Intrinsics) -> np.ndarray:
    """The lens parameters (7,) that turn a calibration into the true lens."""
    log_scale = np.log(true.focal_px / calibrated.focal_px)
    principal = (true.principal_px - calibrated.principal_px) / calibrated.focal_px
    radial = (true.distortion - calibrated.distortion)[[0, 1, 4]]
    return np.r_[log_scale[0], log_scale[1] - log_scale[0], principal, radial]


def measure(minutes: float, n_cameras: int, iterations: int) -> str:
    """One line of the table."""
    case = simulated(minutes, n_cameras, np.random.default_rng(0))
    n, before = len(case.problem.observations), peak_mib()
    rest = (case.priors, case.weights, case.motion)
    solve.minimise(case.problem, case.start, *rest, max_iterations=1)  # compiles
    found, minimise_s = timed(
        lambda: solve.minimise(case.problem, case.start, *rest, max_iterations=iterations, tolerance=0.0)
    )
    equations = solve.assemble(case.problem, found.state, *rest)
    build = best_ms(lambda: solve.assemble(case.problem, found.state, *rest), 3)
    solved = best_ms(lambda: normal.step(equations, normal.eliminate(equations, 1e-4)), 3)
    cost = best_ms(lambda: solve.cost(case.problem, found.state, *rest), 3)
    residual = solve.predict(case.problem, found.state) - case.problem.observations.xy_px
    adjusted = Adjusted(
        Scene(case.camera_ids[0], {}), case.camera_ids, case.problem, found.state, *rest,
        np.zeros(n, np.int64), residual, 1.0, found.cost, found.iterations, found.ending,
    )  # fmt: skip
    n_knots = len(knot_weights(case.motion.run_lengths)[0])
    claimed, posterior_s = timed(lambda: posterior(adjusted, np.zeros(n_cameras), np.ones(n_knots, bool)))
    aligned = align_similarity(found.state.control, case.truth.control).apply(found.state.control)
    error = float(np.sqrt(((aligned - case.truth.control) ** 2).sum(axis=1).mean()))
    matrix = np.random.default_rng(0).normal(size=(500, 500))
    loop = best_ms(lambda: matrix @ matrix)
    per = 1e9 * minimise_s / found.iterations / n
    return (
        f"{minutes:>8g}{n:>10}{case.problem.grid.n_control:>9}{build:>10.0f}{solved:>10.0f}{cost:>9.0f}"
        f"{1e6 * build / n:>11.0f}{per:>15.0f}{posterior_s:>12.2f}{before:>9.0f}{peak_mib():>8.0f}"
        f"{100 * error:>10.2f}{100 * float(np.median(claimed.knot_sigma)):>10.2f}{loop:>9.2f}"
    )


def timed(function: Callable[[], T]) -> tuple[T, float]:
    """The result of a call, and its CPU seconds."""
    start = time.process_time()
    result = function()
    return result, time.process_time() - start


def peak_mib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, nargs="+", default=[5.0, 15.0, 60.0])
    parser.add_argument("--cameras", type=int, default=12)
    parser.add_argument("--iterations", type=int, default=6)
    options = parser.parse_args()
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # of the processes that measure
    print(
        f"{'minutes':>8}{'detect.':>10}{'control':>9}{'build ms':>10}{'solve ms':>10}{'cost ms':>9}{'build ns/n':>11}"
        f"{'iteration ns/n':>15}{'posterior s':>12}{'before':>9}{'peak':>8}{'error cm':>10}{'sigma cm':>10}"
        f"{'loop ms':>9}"
    )
    for minutes in options.minutes:
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
            print(pool.submit(measure, minutes, options.cameras, options.iterations).result(), flush=True)


if __name__ == "__main__":
    main()
