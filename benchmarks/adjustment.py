"""Cost of the adjustment's inner loop on dataset4, and how it grows with the number of observations.

    SKYTRACE_DATA=... python -m benchmarks.adjustment

Times are CPU milliseconds, the best of several runs, beside a reference loop of the same machine (a product of two
500 x 500 matrices on one thread), so that ratios can be compared between machines.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")


def best_ms(function: Callable[[], object], repeats: int = 7) -> float:
    """CPU milliseconds of the fastest of several calls, after one that does not count."""
    function()
    times = []
    for _ in range(repeats):
        start = time.process_time()
        function()
        times.append(time.process_time() - start)
    return 1e3 * min(times)


def main() -> None:
    """Measure and print."""
    import numpy as np

    from skytrace.datasets import write_dataset
    from skytrace.estimation.adjust import solve
    from skytrace.estimation.adjust.problem import Observations
    from skytrace.io.flight import read_flight
    from skytrace.pipeline.config import Config
    from skytrace.pipeline.offline import outcome, run
    from skytrace.pipeline.prepare import prepare_flight

    if "SKYTRACE_DATA" not in os.environ:
        sys.exit("set SKYTRACE_DATA to the folder that holds drone-tracking/")
    with tempfile.TemporaryDirectory() as folder:
        flight = read_flight(write_dataset("dataset4", "auto", Path(os.environ["SKYTRACE_DATA"]), Path(folder) / "f"))
    start = time.process_time()
    adjusted = outcome(run(prepare_flight(flight, Config().clean).recordings, Config())).adjusted
    whole_s = time.process_time() - start

    matrix = np.random.default_rng(0).normal(size=(500, 500))
    print(f"reference loop                        {best_ms(lambda: matrix @ matrix):9.2f} ms")
    print(f"dataset4 reconstructed, in process    {1e3 * whole_s:9.0f} ms")
    print(f"{'observations':>12} {'control':>8} {'cameras':>8} {'build ms':>9} {'solve ms':>9} {'cost ms':>8}")
    for copies in (1, 10):
        o = adjusted.problem.observations
        order = np.repeat(np.arange(len(o)), copies)
        many = Observations(o.camera[order], o.tau_s[order], o.row[order], o.xy_px[order])
        problem = replace(adjusted.problem, observations=many)
        rest = (adjusted.state, adjusted.priors, adjusted.weights, adjusted.motion)
        equations = solve.assemble(problem, *rest)

        def solved(equations: solve.NormalEquations = equations) -> object:
            return solve.step(equations, solve.eliminate(equations, 1e-4))

        build = best_ms(lambda problem=problem, rest=rest: solve.assemble(problem, *rest))
        cost = best_ms(lambda problem=problem, rest=rest: solve.cost(problem, *rest))
        counts = f"{len(many):>12} {problem.grid.n_control:>8} {problem.n_cameras:>8}"
        print(f"{counts} {build:>9.1f} {best_ms(solved):>9.1f} {cost:>8.1f}")


if __name__ == "__main__":
    main()
