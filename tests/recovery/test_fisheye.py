"""A fisheye among pinhole cameras: blind reconstruction, its lens refined like the others'."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skytrace.simulation import presets

from .scenes import recover

SHORT = replace(presets["noise_free_smooth"], duration_s=40.0, fisheye_cameras=1, n_cameras=3)


@pytest.fixture(scope="module")
def noise_free():
    return recover(SHORT, seed=3)


def test_noise_free_flight_is_exact(noise_free):
    assert noise_free.simulated.recordings[0].intrinsics.model == "fisheye"
    assert sorted(noise_free.reconstruction.cameras) == ["cam0", "cam1", "cam2"]
    assert noise_free.error_m.max() < 2e-4


def test_the_refined_lens_is_a_fisheye_still(noise_free):
    true = noise_free.simulated.truth.cameras["cam0"].intrinsics
    found = noise_free.reconstruction.cameras["cam0"].refined
    assert found.model == "fisheye"
    np.testing.assert_allclose(found.focal_px, true.focal_px, rtol=2e-5)


def test_a_wrong_calibration_is_refined():
    """Two fisheyes among four, lenses off by what calibrations commonly are, noise and outliers."""
    wrong = replace(
        presets["demo"], duration_s=60.0, fisheye_cameras=2, focal_error=0.01, radial_error=0.002, noise_px=0.4
    )
    found = recover(wrong, seed=1)
    assert len(found.reconstruction.cameras) == 4
    assert np.sqrt((found.error_m**2).mean()) < 0.05
