"""Calibrations that a flight contradicts: found out, named, and taken from the flight where that helps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skytrace.estimation.lens_doubt import CONTRADICTED, lens_pulls
from skytrace.pipeline.config import Config
from skytrace.pipeline.summary import summarise
from skytrace.simulation import presets, simulate

from .scenes import compare

FLIGHT = replace(presets["realistic"], duration_s=120.0, n_cameras=4)


def recovered(radial: float, focal: float = 1.0):
    """A flight whose second camera's calibration is wrong in k1 and the focal length."""
    simulated = simulate(FLIGHT, np.random.default_rng((11, 100)))
    lens = simulated.recordings[1].intrinsics
    wrong = replace(lens, distortion=lens.distortion + [radial, 0, 0, 0, 0], focal_px=focal * lens.focal_px)
    recordings = tuple(replace(r, intrinsics=wrong) if r.camera_id == "cam1" else r for r in simulated.recordings)
    return compare(replace(simulated, recordings=recordings), Config())


@pytest.fixture(scope="module")
def right():
    return recovered(0.0)


@pytest.fixture(scope="module")
def bent():
    return recovered(0.4)


def test_usual_calibration_errors_are_not_doubted(right) -> None:
    found = right.outcome
    assert found.doubted == {}
    pulls = lens_pulls(found.adjusted, found.posterior.lens)
    assert np.isfinite(pulls).any()
    assert np.nanmax(np.abs(pulls)) < CONTRADICTED
    summary = summarise(found, right.prepared, {})
    assert not any("calibration" in text for text in summary["warnings"])
    assert not any(row["radial_from_flight"] for row in summary["cameras"].values())


def test_a_wrong_radial_distortion_is_named_and_taken_from_the_flight(right, bent) -> None:
    found = bent.outcome
    assert set(found.doubted) == {"cam1"}
    assert found.doubted["cam1"].deviations < -CONTRADICTED
    change = (
        found.reconstruction.cameras["cam1"].refined.distortion[0] - found.recordings["cam1"].intrinsics.distortion[0]
    )
    assert change == pytest.approx(-0.4, abs=0.1)
    summary = summarise(found, bent.prepared, {})
    (warning,) = [text for text in summary["warnings"] if "calibration does not fit" in text]
    assert "cam1" in warning
    assert "radial distortion" in warning
    assert summary["cameras"]["cam1"]["radial_from_flight"]
    # As good as with a right calibration.
    assert bent.error_m.mean() < 1.07 * right.error_m.mean()


def test_a_focal_length_against_its_prior_is_named() -> None:
    found = recovered(0.0, focal=0.9)
    summary = summarise(found.outcome, found.prepared, {})
    (warning,) = [text for text in summary["warnings"] if "focal length had to change" in text]
    assert "cam1" in warning
    assert summary["observability"]["cam1"]["focal_scale"]["pull_sd"] > CONTRADICTED
