"""The ablation on a real recording: what refined lenses are worth."""

from __future__ import annotations

from pathlib import Path

import pytest

from skytrace.benchmark.ablation import Variant, measure_flight, read_recording, recordings_with_truth
from skytrace.pipeline.config import Config

pytestmark = pytest.mark.real


def test_refined_lenses_are_worth_a_centimetre_on_dataset1(data_dir: Path) -> None:
    assert "dataset1" in recordings_with_truth(data_dir)
    judged = read_recording("dataset1", "auto", data_dir, Config())
    chosen = [Variant("jerk", "estimated", lens, lens) for lens in (True, False)]
    refined, calibrated = measure_flight(judged, Config(), chosen)
    assert refined.without_large is not None
    assert calibrated.without_large is not None
    assert refined.without_large.mean < calibrated.without_large.mean - 0.01
    assert calibrated.without_large.mean < 0.085
    assert min(m.without_large.n + m.n_dropped for m in (refined, calibrated)) >= 519
