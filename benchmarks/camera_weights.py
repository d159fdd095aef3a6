"""How much better than the others a camera may count: simulated flights with cameras of unlike noise.

    python -m benchmarks.camera_weights [--seeds N]

A camera's noise is estimated from its residuals, and the trajectory follows the camera that counts most, so that its
residuals shrink and it counts more still. `AdjustSettings.smallest_sigma_ratio` bounds that, in shares of the median
camera's noise. Mean error over the trajectory, in cm, after the best alignment; calibrations, clocks and slow errors as
in the preset "realistic", and up to 1.5 px of white noise more, another amount for each camera.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from skytrace.model.track import Recording
from skytrace.pipeline.config import Config
from skytrace.pipeline.judging import evaluate
from skytrace.pipeline.offline import outcome, run
from skytrace.pipeline.prepare import prepare_recordings
from skytrace.simulation import presets, simulate

RATIOS = (0.5, 0.7, 1.0)
_TRUTH_HZ = 20.0


def noisier(recording: Recording, noise_px: float, rng: np.random.Generator) -> Recording:
    """The recording with white noise added."""
    tracks = (replace(t, xy_px=t.xy_px + noise_px * rng.normal(size=t.xy_px.shape)) for t in recording.tracks)
    return replace(recording, tracks=tuple(tracks))


def errors_cm(seed: int) -> list[float]:
    """Mean error of one flight under each ratio."""
    scenario = replace(presets["realistic"], n_cameras=4 + seed % 3, duration_s=60.0, drift_px=0.4, drift_s=1.5)
    simulated = simulate(scenario, np.random.default_rng((99, seed)))
    rng = np.random.default_rng(seed)
    recordings = [noisier(r, rng.uniform(0, 1.5), rng) for r in simulated.recordings]
    motion = simulated.truth.motion
    truth = motion.position(np.arange(motion.begin_s, motion.end_s, 1 / _TRUTH_HZ))
    found = []
    for ratio in RATIOS:
        config = Config()
        config = replace(config, adjust=replace(config.adjust, smallest_sigma_ratio=ratio))
        product = outcome(run(prepare_recordings(recordings, config.clean).recordings, config))
        judged = evaluate(product.reconstruction, truth=truth, rate_hz=_TRUTH_HZ).trajectory
        assert judged is not None
        found.append(100 * judged.complete.statistics.mean)
    return found


def main() -> None:
    """Reconstruct, compare, print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    seeds = range(parser.parse_args().seeds)
    print("| flight | " + " | ".join(f"at least {ratio:g}" for ratio in RATIOS) + " |")
    print("| --- " * (len(RATIOS) + 1) + "|")
    rows = []
    for seed in seeds:
        rows.append(errors_cm(seed))
        print(f"| {seed} | " + " | ".join(f"{value:.2f}" for value in rows[-1]) + " |", flush=True)
    print("| geometric mean | " + " | ".join(f"{v:.2f}" for v in np.exp(np.log(rows).mean(axis=0))) + " |")


if __name__ == "__main__":
    main()
