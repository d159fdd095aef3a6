"""Intrinsics and clocks: conventions by hand, and refusals."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from skytrace.model.camera import Clock, Intrinsics


def intrinsics(**changes):
    given = {
        "focal_px": [1000.0, 900.0],
        "principal_px": [640.0, 360.0],
        "distortion": [0.0] * 5,
        "size_px": (1280, 720),
    }
    return Intrinsics(**{**given, **changes})


def test_the_principal_point_looks_straight_ahead():
    camera = intrinsics()
    np.testing.assert_allclose(camera.rays(np.array([[640.0, 360.0]])), [[0, 0, 1]], atol=1e-15)
    xy, valid = camera.undistort([[1640.0, 1260.0]])
    np.testing.assert_allclose(xy, [[1, 1]])
    assert valid.all()
    np.testing.assert_allclose(
        camera.project(np.array([[1.0, 1.0, 1.0], [1.0, 1.0, -1.0]])), [[1640, 1260], [np.nan] * 2]
    )
    assert camera.height_px == 720


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"focal_px": [1000.0, 0.0]}, "focal_px: expected positive values"),
        ({"focal_px": [-5.0, 5.0]}, "focal_px: expected positive values"),
        ({"focal_px": [1000.0]}, r"focal_px: expected shape \(2\)"),
        ({"principal_px": [np.nan, 0.0]}, "principal_px: contains values that are not finite"),
        ({"distortion": [0.0] * 4}, r"distortion: expected shape \(5\)"),
        ({"size_px": (0, 720)}, "size_px: expected positive width and height"),
        ({"size_px": (1280, -1)}, "size_px: expected positive width and height"),
    ],
)
def test_impossible_lenses_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        intrinsics(**changes)


def test_intrinsics_cannot_be_changed():
    camera = intrinsics()
    with pytest.raises(dataclasses.FrozenInstanceError):
        camera.size_px = (1, 1)
    with pytest.raises(ValueError, match="read-only"):
        camera.focal_px[0] = 1.0


def test_world_time_by_hand():
    clock = Clock(offset_s=10.0, period_s=0.04, readout_s=0.02, height_px=1000)
    assert clock.world_time(25, 500.0) == pytest.approx(11.01)
    assert clock.frame_at(11.01, 500.0) == pytest.approx(25)
    np.testing.assert_allclose(clock.world_time(np.array([0, 25]), np.array([0.0, 1000.0])), [10.0, 11.02])
    np.testing.assert_allclose(clock.frame_at(np.array([10.0, 11.02]), np.array([0.0, 1000.0])), [0, 25])


def test_a_global_shutter_does_not_care_for_rows():
    clock = Clock(1.0, 0.5)
    np.testing.assert_array_equal(clock.world_time(3, np.array([0.0, 700.0])), [2.5, 2.5])


@pytest.mark.parametrize("period_s", [0.0, -0.03, np.nan])
def test_a_clock_must_run_forwards(period_s):
    with pytest.raises(ValueError, match="period_s: expected a positive number"):
        Clock(0.0, period_s)
