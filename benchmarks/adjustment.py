"""Cost of the adjustment's inner loop on dataset4, and how it grows with the number of observations.

    SKYTRACE_DATA=... python -m benchmarks.adjustment

First the CPU seconds of each stage of a reconstruction in this process, compiled code on disk; "adjust" is the final
adjustment from the grown start. Then CPU milliseconds, the best of several runs, of one linearisation ("build"), one
elimination and step ("solve") and one evaluation of the cost, beside a reference loop of the same machine (a product of
two 500 x 500 matrices on one thread): the last column, (build + solve) / loop, can be compared between machines.
"""

from __future__ import annotations

import os
import resource
import sys
import tempfile
import time
from collections import defaultdict
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
    from skytrace.estimation.adjust import normal, solve
    from skytrace.estimation.adjust.problem import Observations
    from skytrace.io.flight import read_flight
    from skytrace.pipeline.config import Config
    from skytrace.pipeline.offline import Outcome, run
    from skytrace.pipeline.prepare import prepare_flight

    if "SKYTRACE_DATA" not in os.environ:
        sys.exit("set SKYTRACE_DATA to the folder that holds drone-tracking/")
    with tempfile.TemporaryDirectory() as folder:
        flight = read_flight(write_dataset("dataset4", "auto", Path(os.environ["SKYTRACE_DATA"]), Path(folder) / "f"))
    stages: defaultdict[str, float] = defaultdict(float)
    product = None
    last = time.process_time()
    for stage in run(prepare_flight(flight, Config().clean).recordings, Config()):
        now, product = time.process_time(), stage.product
        stages[stage.name] += now - last
        last = now
    assert isinstance(product, Outcome)
    adjusted = product.adjusted

    matrix = np.random.default_rng(0).normal(size=(500, 500))
    loop = best_ms(lambda: matrix @ matrix)
    print("CPU s: " + ", ".join(f"{name} {s:.2f}" for name, s in stages.items()) + f"; all {sum(stages.values()):.2f}")
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB; loop {loop:.2f} ms")
    heads = ("observations", "control", "cameras", "build ms", "solve ms", "cost ms", "/ loop")
    print(" ".join(f"{head:>{max(8, len(head))}}" for head in heads))
    for copies in (1, 10):
        o = adjusted.problem.observations
        order = np.repeat(np.arange(len(o)), copies)
        many = Observations(o.camera[order], o.tau_s[order], o.row[order], o.xy_px[order])
        problem = replace(adjusted.problem, observations=many)
        rest = (adjusted.state, adjusted.priors, adjusted.weights, adjusted.motion)
        equations = solve.assemble(problem, *rest)

        def solved(equations: normal.NormalEquations = equations) -> object:
            return normal.step(equations, normal.eliminate(equations, 1e-4))

        build = best_ms(lambda problem=problem, rest=rest: solve.assemble(problem, *rest))
        cost = best_ms(lambda problem=problem, rest=rest: solve.cost(problem, *rest))
        counts = f"{len(many):>12} {problem.grid.n_control:>8} {problem.n_cameras:>8}"
        solve_ms = best_ms(solved)
        print(f"{counts} {build:>8.1f} {solve_ms:>8.1f} {cost:>8.1f} {(build + solve_ms) / loop:>8.2f}")


if __name__ == "__main__":
    main()
