"""Calibrated and refined lenses side by side, what is left out of the coverage, and what the data determine."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from html_page import Page
from report_scene import make_reconstruction, make_summary

from skytrace.model.camera import Intrinsics
from skytrace.report import render_report
from skytrace.report.lens_table import lens_table
from skytrace.report.words import NO_BREAK, cut_sentence


@pytest.fixture
def reconstruction():
    return make_reconstruction(["north", "south"])


def rows(html: str) -> list[list[str]]:
    found = re.findall(r"<tr>(.*?)</tr>", html, re.DOTALL)
    cells = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row, re.DOTALL) for row in found]
    return [[" ".join(re.sub(r"<[^>]+>", " ", cell).split()) for cell in row] for row in cells]


def verdicts(**pulls: float):
    deviations = {"focal_scale": 0.002, "aspect": 0.001, "principal_x": 0.003, "principal_y": 0.003, "k1": 0.05}
    return {name: {"posterior_sd": sd, "pull_sd": pulls.get(name)} for name, sd in deviations.items()}


def test_every_camera_has_a_calibrated_and_a_refined_row(reconstruction) -> None:
    summary = {"observability": {"north": verdicts()}, "cameras": {}}
    head, calibrated, refined, *south = rows(lens_table(reconstruction, summary))
    assert head[:6] == ["camera", "pattern", "fx [px]", "fy [px]", "cx [px]", "cy [px]"]
    assert head[6:] == ["k1", "k2", "p1", "p2", "k3"]
    assert calibrated[:6] == ["north calibrated", "", "1,500.0", "1,500.0", "960.0", "540.0"]
    assert refined[:2] == ["north refined", "not to be told"]
    assert refined[2:6] == ["1,510.0 ± 3.0", "1,512.0 ± 3.4", "960.0 ± 4.5", "540.0 ± 4.5"]
    assert refined[6] == "0.000 ± 0.050"
    assert [row[0] for row in south] == ["south calibrated", "south refined"]
    assert south[1][2] == "1,510.0"  # nothing is known of its deviations
    assert all(len(row) == len(head) for row in (calibrated, refined, *south))


def test_what_runs_against_the_calibration_is_marked(reconstruction) -> None:
    summary = {"observability": {"north": verdicts(k1=-4.31, focal_scale=2.9)}}
    refined = rows(lens_table(reconstruction, summary))[2]
    assert refined[6].endswith("4.3 deviations off")
    assert "off" not in refined[2]


@pytest.mark.parametrize(
    ("pattern", "said"),
    [
        (None, "not to be told"),
        ({"rms_px": 0.4, "deviations": 1.0, "named": False}, "none"),
        ({"rms_px": 0.214, "deviations": 9.33, "named": True}, "0.21 px 9.3 deviations"),
    ],
)
def test_patterns_over_the_image(reconstruction, pattern, said: str) -> None:
    summary = {"cameras": {"north": {"residual_pattern": pattern}}}
    assert rows(lens_table(reconstruction, summary))[2][1] == said


def test_fisheyes_have_coefficients_of_their_own(reconstruction) -> None:
    north = reconstruction.cameras["north"]
    fisheye = Intrinsics([900.0, 900.0], [960.0, 540.0], np.array([0.1, 0.2, 0.3, 0.4]), (1920, 1080), "fisheye")
    cameras = {**reconstruction.cameras, "north": replace(north, calibrated=fisheye, refined=fisheye)}
    table = rows(lens_table(replace(reconstruction, cameras=cameras), {}))
    head, calibrated, south = table[0], table[1], table[3]
    assert set(head[6:]) == {"k1", "k2", "p1", "p2", "k3", "k4"}
    assert calibrated[head.index("k4")] == "0.400"
    assert calibrated[head.index("p1")] == ""
    assert south[head.index("k4")] == ""


def test_what_is_not_covered_is_said_with_its_reasons() -> None:
    told = {"seen_s": 100.0, "too_few_cameras_s": 12.0, "cameras_disagree_s": 0.3, "too_uncertain_s": 4.5}
    assert cut_sentence(told).replace(NO_BREAK, " ") == (
        "Of 1 min 40 s in which any camera saw the target, these are left out: 12.0 s seen by too few cameras and "
        "4.5 s too uncertain."
    )
    assert cut_sentence({"seen_s": 100.0, "too_few_cameras_s": 0.1}) == ""
    assert cut_sentence({}) == ""


def test_the_page_shows_lenses_words_and_cuts(reconstruction) -> None:
    summary = {
        **make_summary(reconstruction),
        "not_covered": {"seen_s": 50.0, "cameras_disagree_s": 7.5},
        "observability_words": ["Readout times: by its prior for north (it <hardly> moved)."],
    }
    page = Page(render_report(reconstruction, summary, name="n", versions={}, settings={}))
    main = page.text["main"]
    assert "Lenses as calibrated and as refined" in main
    assert "it <hardly> moved" in main
    assert "7.5 s in which cameras contradict each other" in main.replace(NO_BREAK, " ")
