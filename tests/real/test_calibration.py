"""Two of the real photograph sets: every view found, residuals, lens model and focal length in their bands."""

from __future__ import annotations

from pathlib import Path

import pytest

from skytrace.benchmark.calibration import measure_set
from skytrace.io.calibration import read_calibration

pytestmark = pytest.mark.real


# Focal lengths by the flights, whose lens refinement is independent of the photographs, to two per cent.
@pytest.mark.parametrize(
    ("device", "model", "focal_px", "largest_rms_px"),
    [("gopro3", "fisheye", 871.0, 0.15), ("mate7", "pinhole", 1557.0, 0.25)],
)
def test_photographs_give_a_good_lens(
    data_dir: Path, device: str, model: str, focal_px: float, largest_rms_px: float
) -> None:
    published, _ = read_calibration(data_dir / "drone-tracking" / "calibration" / f"{device}.json")
    lens, measured = measure_set(data_dir, device, published, seed=0)
    assert measured.model == lens.model == model
    assert measured.used >= 0.85 * measured.pictures
    assert measured.rms_px <= largest_rms_px
    assert measured.focal_px == pytest.approx(focal_px, rel=0.02)
    assert measured.halves_rms is not None
    assert measured.halves_rms <= 0.007
    assert measured.focal_sd < 0.01
