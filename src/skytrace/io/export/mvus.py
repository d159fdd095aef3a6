"""JSON in the terms of mvus, the code published with Li et al., IROS 2020.

Its clocks count frames of the reference camera: frame j of a camera, on row y of a picture h rows high, was exposed at
alpha * (j + rs * y / h) + beta.
"""

from __future__ import annotations

import json

import numpy as np

from skytrace.io.calibration_writer import calibration_text
from skytrace.io.export.content import ExportCamera, ExportRun, Format


def write_mvus(run: ExportRun) -> str:
    """The text of the JSON: cameras with K-matrix, distCoeff, R, t; alpha, beta, rs; traj as rows time, x, y, z.

    The key `model` of a camera says whether its distCoeff are those of a pinhole or, unknown to mvus, of a fisheye.
    """
    reference = run.cameras[run.reference].clock
    clocks = [camera.clock for camera in run.cameras.values()]
    beta = [(c.offset_s - reference.offset_s) / reference.period_s for c in clocks]
    frames = (run.time_s - reference.offset_s) / reference.period_s
    document = {
        "generator": "skytrace",
        "name": run.name,
        "unit": run.unit,
        "frame": run.frame,
        "time": "frames of the reference camera: t = alpha * (frame + rs * row / height) + beta",
        "ref_cam": list(run.cameras).index(run.reference),
        "alpha": [c.period_s / reference.period_s for c in clocks],
        "beta": beta,
        "rs": [c.readout_s / c.period_s for c in clocks],
        "cameras": [_camera(camera) for camera in run.cameras.values()],
        "traj": np.vstack([frames, run.position.T]).tolist(),
    }
    return json.dumps(document, ensure_ascii=False, allow_nan=False) + "\n"


def _camera(camera: ExportCamera) -> dict[str, object]:
    about = {
        "comment": camera.camera_id,
        "R": camera.camera_from_frame.rotation.tolist(),
        "t": camera.camera_from_frame.translation.tolist(),
    }
    return json.loads(calibration_text(camera.intrinsics, 1 / camera.clock.period_s, about))


FORMAT = Format("mvus", ".json", "JSON in the terms of the paper's code", write_mvus, rate_hz=25.0)
