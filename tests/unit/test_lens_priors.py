"""What is believed of a lens before the flight."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.estimation.adjust.settings import AdjustSettings
from skytrace.estimation.lens_priors import lens_prior
from skytrace.geometry.pixel_aspect import standard_aspect
from skytrace.model.camera import Intrinsics

SETTINGS = AdjustSettings()
MIDDLE_PX = np.array([959.5, 539.5])


def lens(aspect=1.0, off_px=(0.0, 0.0), size_px=(1920, 1080)):
    middle = (np.array(size_px) - 1) / 2
    return Intrinsics([1500.0, 1500.0 * aspect], middle + off_px, np.zeros(5), size_px)


@pytest.mark.parametrize(
    ("aspect", "standard"), [(1.004, 1.0), (0.995, 1.0), (4 / 3 * 1.003, 4 / 3), (1.022, None), (1.2, None)]
)
def test_pixels_are_standard_unless_the_calibration_clearly_says_otherwise(aspect, standard):
    mean, deviation = lens_prior(lens(aspect), SETTINGS)
    if standard is None:
        assert (mean[1], deviation[1]) == (0.0, SETTINGS.aspect_sigma)
    else:
        assert aspect * np.exp(mean[1]) == pytest.approx(standard)
        assert deviation[1] == SETTINGS.standard_aspect_sigma


def test_the_principal_point_lies_between_the_calibrated_one_and_the_middle():
    off_px = np.array([12.0, -20.0])
    own = lens(off_px=off_px)
    mean, deviation = lens_prior(own, SETTINGS)
    expected_px = own.principal_px + own.focal_px * mean[2:4]
    share = (expected_px - MIDDLE_PX) / off_px
    assert share[0] == pytest.approx(share[1])
    assert 0.4 < share[0] < 0.8
    centring = SETTINGS.centring_sigma * 1920 / 1500
    np.testing.assert_allclose(1 / deviation[2:4] ** 2, 1 / SETTINGS.principal_sigma**2 + 1 / centring**2)
    # The two beliefs balance: each pulls at the mean as hard as the other.
    np.testing.assert_allclose(
        mean[2:4] / SETTINGS.principal_sigma**2, -(mean[2:4] + off_px / 1500) / centring**2, rtol=1e-9
    )


def test_a_centred_lens_with_square_pixels_stays_as_calibrated():
    mean, _ = lens_prior(lens(), SETTINGS)
    assert not mean.any()


def test_pictures_twice_as_large_are_believed_the_same():
    small = Intrinsics([1500.0, 1502.0], [970.0, 520.0], np.zeros(5), (1920, 1080))
    large = Intrinsics([3000.0, 3004.0], [1940.5, 1040.5], np.zeros(5), (3840, 2160))
    for one, other in zip(lens_prior(small, SETTINGS), lens_prior(large, SETTINGS), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)


def test_the_nearest_standard_shape():
    assert standard_aspect(1.08, within=0.02) == pytest.approx(12 / 11)
    assert standard_aspect(1.08, within=0.005) is None
