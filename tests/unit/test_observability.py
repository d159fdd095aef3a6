"""What determined each parameter: by numbers, and in words a user can act on."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from skytrace.model.reconstruction import Residuals
from skytrace.pipeline.observability import (
    BY_PRIOR,
    DETERMINED,
    FIXED,
    NOT_AT_ALL,
    PARTLY,
    image_speed_px_s,
    observability_words,
    rows_crossed,
    verdict,
)


@pytest.mark.parametrize(
    ("prior", "posterior", "said"),
    [
        (0.0, 0.0, FIXED),
        (1.0, 0.29, DETERMINED),
        (1.0, 0.31, PARTLY),
        (1.0, 0.81, BY_PRIOR),
        (1.0, 1.0, BY_PRIOR),
        (1.0, 1.1, NOT_AT_ALL),
        (math.inf, 0.02, DETERMINED),
        (math.inf, 0.2, PARTLY),
        (math.inf, 2.0, NOT_AT_ALL),
    ],
)
def test_the_posterior_is_held_against_the_prior(prior: float, posterior: float, said: str) -> None:
    row = verdict(0.1, prior, posterior, 0.033)
    assert row["determined"] == said
    assert row["prior_sd"] == (None if math.isinf(prior) else prior)
    assert (row["value"], row["posterior_sd"]) == (0.1, posterior)


def residuals(rows: tuple[float, float], speed_px_s: float = 100.0, n: int = 900) -> Residuals:
    """A target that sweeps to and fro at a constant speed, between two rows; a tenth of the detections contradict."""
    time_s = np.arange(n) / 30.0
    phase = np.abs((time_s / 5) % 2 - 1)
    span = rows[1] - rows[0]
    across = math.sqrt(max((speed_px_s * 5) ** 2 - span**2, 0.0))
    xy = np.column_stack([200 + across * phase, rows[0] + span * phase])
    inlier = np.arange(n) % 10 != 3
    xy[~inlier] = [0.0, 5000.0]
    return Residuals(np.arange(n), time_s, np.round(xy), np.zeros((n, 2)), inlier)


def test_rows_crossed_and_speed_are_those_of_the_agreeing_detections() -> None:
    found = residuals((300.0, 500.0))
    assert rows_crossed(found, 1000) == pytest.approx(0.2 * 0.96, abs=0.005)
    assert image_speed_px_s(found) == pytest.approx(100.0, rel=0.03)
    nothing = Residuals(np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0, bool))
    assert rows_crossed(nothing, 1000) == image_speed_px_s(nothing) == 0


def scene(**readout: str):
    """An outcome of cameras whose readout was determined like this, and their verdicts."""
    cameras = {
        c: SimpleNamespace(residuals=residuals((300.0, 500.0)), refined=SimpleNamespace(height_px=1000))
        for c in readout
    }
    rows = {
        c: {
            name: {"value": 0.02, "prior_sd": 1.0, "posterior_sd": 1.0, "determined": DETERMINED}
            for name in ("offset_s", "rate", "focal_scale", "aspect", "principal_x", "principal_y", "k1", "k2", "k3")
        }
        | {"readout_s": {"value": 0.02, "prior_sd": 1.0, "posterior_sd": 1.0, "determined": said}}
        for c, said in readout.items()
    }
    reconstruction = SimpleNamespace(cameras=cameras, reference=next(iter(readout)))
    return cast(Any, SimpleNamespace(reconstruction=reconstruction)), rows


def test_a_readout_that_was_assumed_says_why() -> None:
    words = observability_words(*scene(a=DETERMINED, b=BY_PRIOR, c=NOT_AT_ALL))
    (sentence,) = [text for text in words if text.startswith("Readout times")]
    assert sentence.startswith(
        f"Readout times: {DETERMINED} for a; {BY_PRIOR} for b (20.0 ms is about what was assumed"
    )
    assert sentence.count("the target crossed only 19 % of the image height, at 100 px/s") == 2
    assert f"{NOT_AT_ALL} for c" in sentence


def test_a_determined_readout_needs_no_reason() -> None:
    words = observability_words(*scene(a=DETERMINED, b=PARTLY))
    assert not any("assumed" in text for text in words)


def test_the_reference_clock_is_not_spoken_of() -> None:
    words = observability_words(*scene(a=DETERMINED, b=PARTLY))
    assert "Clock offsets: determined by the data for b." in words
    assert "Focal lengths: determined by the data for a, b." in words


def test_of_several_parameters_the_worst_counts() -> None:
    outcome, rows = scene(a=DETERMINED, b=DETERMINED)
    rows["b"]["k3"]["determined"] = BY_PRIOR
    words = observability_words(outcome, rows)
    assert f"Radial distortions: {DETERMINED} for a; {BY_PRIOR} for b." in words
