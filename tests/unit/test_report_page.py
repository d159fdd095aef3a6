"""The page is one well-formed file that holds everything, escapes everything and asks for nothing."""

from __future__ import annotations

import re

import numpy as np
import pytest
from html_page import Page, assert_controls_are_named, data_of
from report_scene import make_reconstruction, make_summary

from skytrace.report import render_report

EXTRAS = {"versions": {"skytrace": "1.2.3"}, "settings": {"adjust": {"loss_scale": 2.0, "focal": True}}}


@pytest.fixture(scope="module")
def reconstruction():
    return make_reconstruction(["north", "south", "east"], unregistered={"west": "it never saw the target move"})


@pytest.fixture(scope="module")
def html(reconstruction):
    return render_report(reconstruction, make_summary(reconstruction), name="Evening flight", **EXTRAS)


@pytest.fixture(scope="module")
def page(html):
    return Page(html)


def test_page_holds_name_summary_warnings_cameras_settings_and_versions(page):
    assert page.text["h1"] == "Evening flight"
    assert "Evening flight" in page.text["title"]
    main = page.text["main"]
    for text in (
        "3 of 4 cameras",
        "The focal length of cam1 moved by 2.4 %",
        "it never saw the target move",
        "arbitrary unit",
        "isolated jump",
        "adjust.loss_scale",
        "1.2.3",
        "readout s",
        "by its prior",
        "0.0200 ± 0.0029",
        "determined by the data",
        "focal scale",
        "converged",
        "north – south",
        "−12.5000 ± 0.0020",
        "98 % agree",
        "0.9974",
        "also plausible",
        "−70.200",
        "−12.5000 ± 0.0012",
        "1510.0 × 1512.0",
        "calibrated 1500.0 × 1500.0",
        "+0.67, +0.80 %",
        "0.60 of a frame",
        "30.0000 Hz, given 29.9700",
    ):
        assert text in main, text
    for camera_id in ("north", "south", "east", "west"):
        assert camera_id in page.text["th"]


def test_dropped_detections_are_counted_by_reason(html, page):
    rows = re.findall(r"<tr>(.*?)</tr>", html[html.index("What was dropped") :], re.DOTALL)
    cells = [re.sub(r"<[^>]+>", " ", cell).split() for cell in re.findall(r"<td>(.*?)</td>", rows[1])]
    assert cells[1][0] == "40"
    assert [cell[0] for cell in cells[2:4]] == ["31", "9"]
    assert "outside image" not in page.text["main"]  # no camera lost any for this reason


def test_script_data_is_json_and_holds_every_registered_camera(html, reconstruction):
    data = data_of(html)
    assert [camera["id"] for camera in data["cameras"]] == list(reconstruction.cameras)
    assert data["unit"] == "units"
    assert {"time", "x", "y", "z", "speed", "sigma", "cameras", "segment"} == set(data["path"])


def test_references_within_the_page_resolve(page):
    page.assert_references_resolve()
    controls = [attrs["id"] for tag, attrs in page.elements if tag in ("select", "input") and "id" in attrs]
    assert {"colour", "camera", "moment"} <= set(controls)


def test_every_control_has_a_name(html):
    assert_controls_are_named(html)


def test_page_asks_for_nothing_outside(page):
    page.assert_asks_for_nothing()


def test_names_and_texts_from_outside_are_escaped():
    nasty = '<img src=x onerror=alert(1)>"&</script><!--'
    reconstruction = make_reconstruction([nasty, "b"], unregistered={"<i>c</i>": nasty})
    summary = {**make_summary(reconstruction), "warnings": [nasty], "observability": {nasty: nasty}}
    extras = {"versions": {nasty: nasty}, "settings": {nasty: [nasty]}}
    html = render_report(reconstruction, summary, name=nasty, **extras)
    page = Page(html)
    assert page.text["h1"] == nasty
    assert nasty in page.text["li"]
    assert nasty in page.text["option"]
    assert not {"img", "i"} & {tag for tag, _ in page.elements}
    assert data_of(html)["cameras"][0]["id"] == nasty


def test_page_is_the_same_for_the_same_input(html, reconstruction):
    assert render_report(reconstruction, make_summary(reconstruction), name="Evening flight", **EXTRAS) == html


def test_empty_summary_leaves_its_sections_out(reconstruction):
    page = Page(render_report(reconstruction, {}, name="bare", versions={}, settings={}))
    for absent in ("warning", "What was dropped", "Synchronisation", "Computing time", "Settings", "Versions"):
        assert absent not in page.text["main"]
    assert "it never saw the target move" in page.text["main"]


def test_partial_and_unknown_entries_of_the_summary_do_no_harm(reconstruction):
    summary = {
        "cameras": {"north": {}, "elsewhere": {"reason": "no file"}},
        "synchronisation": {
            "pairs": [{"camera0": "north", "camera1": "south", "score": None}],
            "disagreement_s": np.array([0.002]),
        },
        "timings_s": {},
        "warnings": [],
        "something_new": {"a": 1},
        "observability": {"north": {"rate": {"determined": "fixed"}}, "scale": False},
    }
    main = Page(render_report(reconstruction, summary, name="odd", versions={}, settings={"a": np.float64(0.5)})).text[
        "main"
    ]
    assert "no file" in main
    assert "3 of 5 cameras" in main
    assert "north – south" in main
    assert "fixed" in main
    assert "scale" in main


def test_metric_gauge_speaks_of_metres():
    html = render_report(make_reconstruction(gauge="metric"), {}, name="metric", versions={}, settings={})
    data = data_of(html)
    assert data["unit"] == "m"
    assert "in metres" in html
    assert data["scene"]["layout"]["scene"]["zaxis"]["title"]["text"] == "up [m]"


def test_ten_minutes_of_seven_cameras_fit_into_eight_megabytes():
    reconstruction = make_reconstruction(
        [f"camera-{i}" for i in range(7)], duration_s=600.0, frame_rate_hz=60.0, n_segments=20
    )
    html = render_report(reconstruction, make_summary(reconstruction), name="long", versions={}, settings={})
    assert 4e6 < len(html.encode()) < 8e6
    path = data_of(html)["path"]["time"]
    assert 4000 < len(path) <= 6000 + 20
