"""A made-up calibration for the tests of its page."""

from __future__ import annotations

import numpy as np

from skytrace.model.camera import Intrinsics, LensDeviation
from skytrace.report.calibration_page import DrawnView, LensPicture

SIZE = (1280, 720)


def make_picture(n: int = 6) -> LensPicture:
    """Views used but for two: one set aside, one without a board."""
    rng = np.random.default_rng(3)
    deviation = LensDeviation(0.004, 0.0005, np.array([2.0, 3.0]), np.array([0.001, 0.002, 0.003, 0.004]))
    distortion = np.array([-0.03, 0.1, -0.03, 0.002])
    lens = Intrinsics(np.array([600.0, 600.0]), np.array([640.0, 350.0]), distortion, SIZE, "fisheye", deviation)
    views = []
    for k in range(n):
        xy = rng.uniform([0, 0], SIZE, (40, 2))
        views.append(DrawnView(f"p{k} <b>.jpg", xy, rng.normal(0, 0.1, (40, 2)), "used", 0.14, 31.4))
    views.append(DrawnView("blurred.jpg", xy, None, "set aside: its corners are off by 3.20 px", 3.2, None))
    views.append(DrawnView("wall.jpg", np.zeros((0, 2)), None, "no board found", None, None))
    return LensPicture(lens, tuple(views))


def make_summary(**changes: object) -> dict[str, object]:
    summary: dict[str, object] = {
        "pictures": 8,
        "used": 6,
        "corners_used": 240,
        "board": "chessboard, 8 x 7 squares",
        "rms_px": 0.142,
        "focal_sd": 0.004,
        "focal_halves_rms": 0.0061,
        "focal_motion_sensitivity": 0.0012,
        "turn_sd_rad": 0.002,
        "advice": [],
        "refused": [],
        "warnings": [],
    }
    return {**summary, **changes}
