"""The ablation: what its variants change, one synchronisation for all of them, and its table."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from skytrace.benchmark import ablation, ablation_table
from skytrace.benchmark.ablation import VARIANTS, Judged, Measurement, Variant, measure_flight, read_judged
from skytrace.cli import run
from skytrace.errors import InputError
from skytrace.estimation.hints import Hints
from skytrace.evaluation.statistics import ErrorStatistics
from skytrace.io.run_folder import json_text
from skytrace.pipeline.config import Config
from skytrace.pipeline.prepare import prepare_recordings
from skytrace.simulation import presets, simulate, write_flight

FLIGHT = replace(presets["demo"], duration_s=40.0, n_cameras=3)
RATE_HZ = 5.0


def test_variants_are_the_papers_and_more_each_once() -> None:
    assert len(set(VARIANTS)) == len(VARIANTS)
    for free in (False, True):
        for shutter in ("none", "estimated"):
            own = {v.motion for v in VARIANTS if (v.shutter, v.focal, v.lens) == (shutter, free, free)}
            assert own == {"none", "kinetic", "force", "jerk"}
    assert {(v.focal, v.lens) for v in VARIANTS} == {(False, False), (True, True), (True, False), (False, True)}


def test_the_default_is_among_the_variants() -> None:
    assert any(variant.configured(Config()) == Config() for variant in VARIANTS)


def test_a_variant_changes_what_it_says() -> None:
    config = Variant("force", "none", False, True).configured(Config(seed=3))
    assert (config.adjust.motion_prior, config.adjust.readout_fraction, config.seed) == ("force", 0.0, 3)
    assert (config.freedom.rolling_shutter, config.freedom.focal, config.freedom.lens) == (False, False, True)
    assumed = Variant("jerk", "assumed", True, True).configured(Config())
    assert assumed.adjust.readout_fraction == Config().adjust.readout_fraction
    assert not assumed.freedom.rolling_shutter


@pytest.fixture(scope="module")
def judged() -> Judged:
    simulated = simulate(FLIGHT, np.random.default_rng(2))
    motion = simulated.truth.motion
    time_s = np.arange(motion.begin_s, motion.end_s, 1 / RATE_HZ)
    recordings = prepare_recordings(simulated.recordings, Config().clean).recordings
    return Judged("simulated", recordings, Hints(), None, motion.position(time_s), RATE_HZ)


def test_variants_share_one_synchronisation_for_each_readout(judged: Judged, monkeypatch: pytest.MonkeyPatch) -> None:
    real, calls = ablation.synchronise_paths, []

    def counted(*arguments):
        calls.append(arguments[1].adjust.readout_fraction)
        return real(*arguments)

    monkeypatch.setattr(ablation, "synchronise_paths", counted)
    chosen = [
        Variant("jerk", "estimated", True, True),
        Variant("none", "estimated", False, False),
        Variant("jerk", "none", True, True),
    ]
    rows = list(measure_flight(judged, Config(), chosen))
    assert calls == [0.6, 0.0]
    assert [row.variant for row in rows] == chosen
    for row in rows:
        assert row.failure == ""
        assert row.errors is not None
        assert row.errors.mean < 0.3
        assert row.errors.n > 0.9 * row.n_total
        assert row.cpu_s > 0
    # The reused synchronisation gives exactly what a search of its own does.
    (alone,) = measure_flight(judged, Config(), chosen[1:2])
    assert alone.errors == rows[1].errors


def test_a_flight_that_cannot_be_reconstructed_fails_in_every_row(judged: Judged) -> None:
    hopeless = replace(judged, recordings=judged.recordings[:1])
    rows = list(measure_flight(hopeless, Config(), VARIANTS[:2]))
    assert [row.errors for row in rows] == [None, None]
    assert all("fewer than two cameras" in row.failure for row in rows)
    assert "fails" in ablation_table.as_text(rows)
    assert "fewer than two cameras" in ablation_table.as_markdown(rows)


def test_a_flight_without_truth_is_refused(tmp_path, capsys) -> None:
    simulated = simulate(replace(FLIGHT, duration_s=5.0), np.random.default_rng(2))
    path = tmp_path / "flight"
    write_flight(simulated, path)
    description = path / "flight.toml"
    description.write_text(description.read_text().split("[truth]")[0])
    with pytest.raises(InputError, match=r"no \[truth\] section"):
        read_judged(path, Config())
    assert run(["benchmark", "ablation", str(path)]) == 3
    assert "no [truth] section" in capsys.readouterr().err


def test_without_flights_or_recordings_nothing_is_measured(tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.delenv("SKYTRACE_DATA", raising=False)
    assert run(["benchmark", "ablation"]) == 3
    assert "SKYTRACE_DATA" in capsys.readouterr().err
    assert run(["benchmark", "ablation", "--data", str(tmp_path)]) == 3
    assert "none of the recordings with truth" in capsys.readouterr().err


def made_up(variant: Variant, **changes) -> Measurement:
    errors = ErrorStatistics(200, 0.081, 0.099, 0.072, 1.5, 0.9)
    kept = ErrorStatistics(197, 0.071, 0.085, 0.0699, 0.5, 0.5)
    return replace(Measurement("dataset1 auto", variant, errors, kept, 3, 260, 1.25), **changes)


def test_the_table_shows_the_papers_figures_and_the_mean_of_all() -> None:
    row = made_up(Variant("force", "none", False, False))
    cells = dict(zip(ablation_table.HEADER, ablation_table.cells(row), strict=True))
    assert cells == {
        "flight": "dataset1 auto",
        "motion prior": "force",
        "rolling shutter": "none",
        "lenses": "calibrated",
        "mean": "7.1",
        "RMSE": "8.5",
        "median": "7.0",
        "outliers %": "0.5",
        "N": "197",
        "dropped": "3",
        "mean of all": "8.1",
        "CPU s": "1.2",
    }
    text = ablation_table.as_text([row])
    assert text.splitlines()[3].startswith("dataset1 auto  force")
    assert all(len(line) <= 120 for line in text.splitlines()[5:])
    markdown = ablation_table.as_markdown([row]).splitlines()
    assert markdown[4].startswith("| dataset1 auto | force | none | calibrated | 7.1 |")
    document = json.loads(json_text(ablation_table.as_document([row])))
    assert document["rows"][0]["variant"]["shutter"] == "none"
    assert document["rows"][0]["without_large"]["n"] == 197


@pytest.mark.parametrize(
    ("focal", "lens", "words"),
    [
        (True, True, "refined"),
        (False, False, "calibrated"),
        (True, False, "focal only"),
        (False, True, "all but focal"),
    ],
)
def test_lenses_in_words(focal: bool, lens: bool, words: str) -> None:
    assert ablation_table.lenses(Variant("jerk", "estimated", focal, lens)) == words
