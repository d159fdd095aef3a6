"""Simulate a flight filmed by three unsynchronised cameras, reconstruct it from the detections alone, and judge it."""

import sys

import numpy as np

import skytrace

scenario = skytrace.Scenario(n_cameras=3, duration_s=40.0)
simulated = skytrace.simulate(scenario, np.random.default_rng(1))

result = skytrace.reconstruct(simulated.recordings)  # pixels, lenses and nominal frame rates; nothing of the truth
for camera_id, camera in result.reconstruction.cameras.items():
    print(f"{camera_id} began {camera.clock.offset_s:9.4f} s after {result.reconstruction.reference}")

motion = simulated.truth.motion
true_m = motion.position(np.arange(motion.begin_s, motion.end_s, 0.2))  # (n, 3), five a second
errors = skytrace.evaluate(result.reconstruction, truth=true_m, rate_hz=5.0).as_dict()["trajectory"]["all"]
print(f"mean error {100 * errors['mean']:.1f} cm over {errors['n']} of {errors['n_total']} positions")

skytrace.write_run(sys.argv[1] if len(sys.argv) > 1 else "simulated-run", result)
