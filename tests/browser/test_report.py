"""The report in a real browser: it draws itself without a complaint and answers to the keyboard."""

from __future__ import annotations

from pathlib import Path

import chromium
import numpy as np
import pytest
from report_scene import make_reconstruction, make_summary

from skytrace.evaluation.path import SampledPath
from skytrace.evaluation.summary import evaluate
from skytrace.report import add_truth, render_report

pytestmark = pytest.mark.skipif(chromium.EXECUTABLE is None, reason="no Chromium is installed")

DRAWN = "document.documentElement?.dataset.report === 'drawn'"
RIGHT, END, HOME = ("ArrowRight", 39), ("End", 35), ("Home", 36)


@pytest.fixture(scope="module")
def report(tmp_path_factory) -> Path:
    reconstruction = make_reconstruction(
        ["cam0", "cam1 <b>", "cam2"],
        duration_s=40.0,
        n_segments=2,
        gap_s=12.0,  # the segments are 0 to 8 s and 20 to 28 s
        unregistered={"cam3": "no overlap"},
    )
    truth = 3 * reconstruction.trajectory.position(np.arange(0, 40, 0.2)) + 0.01 * np.sin(np.arange(200))[:, None]
    evaluation = evaluate(SampledPath.from_trajectory(reconstruction.trajectory), truth=truth, rate_hz=5.0)
    extras = {"versions": {"skytrace": "1"}, "settings": {"seed": 0}}
    file = tmp_path_factory.mktemp("report") / "report.html"
    page = render_report(reconstruction, make_summary(reconstruction), name="A flight", **extras)
    file.write_text(add_truth(page, evaluation, truth, 5.0), encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def browser(report):
    """A desktop's browser that has drawn the report; the tests share it, each sets what it relies on."""
    with chromium.browser() as running:
        yield opened(running, report)


def text(browser, element: str) -> str:
    return browser.evaluate(f"document.getElementById('{element}').textContent")


def choose(browser, element: str, value: str) -> None:
    select = f"document.getElementById('{element}')"
    browser.evaluate(f"{select}.value = '{value}', {select}.dispatchEvent(new Event('change'))")


def opened(browser, report, **emulation):
    browser.emulate(**{"width": 1280, "height": 900, **emulation})
    browser.open(report)
    browser.wait_until(DRAWN)
    return browser


def test_draws_every_figure_without_errors_or_requests(browser, report):
    for element in ("scene", "timeline", "truth-error", "errors-time", "errors-histogram", "errors-image"):
        assert browser.evaluate(f"document.getElementById('{element}').data.length") >= 2
        assert browser.evaluate(f"document.getElementById('{element}').querySelector('svg.main-svg') !== null")
    assert browser.evaluate("document.getElementById('colour').options.length") == 5
    # Four chosen buttons a figure: those that plotly adds by itself include one that uploads the figure.
    assert browser.evaluate("document.querySelectorAll('.modebar-btn').length") == 10 * 4
    assert browser.complaints() == []
    assert browser.requests() == [report.as_uri()]


def test_slider_moves_the_target_by_keyboard_and_tells_what_is_there(browser):
    browser.evaluate("document.getElementById('moment').focus()")
    browser.press(*HOME)
    assert text(browser, "at-time") == "0.00 s"
    browser.press(*RIGHT)
    assert text(browser, "at-time") == "0.04 s"
    browser.press(*END)
    assert text(browser, "at-time") == "28.00 s"
    browser.press(*HOME)
    browser.wait_until("document.getElementById('timeline').layout.shapes[0].x0 === 0")
    assert "units" in text(browser, "at-position")
    assert "cam0" in text(browser, "at-cameras")
    assert "cam3" not in text(browser, "at-cameras")
    assert "seen by" in browser.evaluate("document.getElementById('moment').getAttribute('aria-valuetext')")
    target = "document.getElementById('scene').data.find((trace) => trace.meta === 'target')"
    at_start = browser.evaluate(f"{target}.x[0]")
    browser.press(*END)
    browser.wait_until(f"{target}.x[0] !== {at_start}")
    assert browser.complaints() == []


def test_play_runs_through_the_flight_and_pauses(browser):
    browser.evaluate("document.getElementById('pace').value = '20'")
    browser.evaluate("document.getElementById('play').click()")
    browser.wait_until("document.getElementById('at-time').textContent === '28.00 s'")
    assert browser.evaluate("document.getElementById('play').getAttribute('aria-label')") == "Play"


def test_play_skips_what_is_not_covered(browser):
    slider = "document.getElementById('moment')"
    browser.evaluate(f"{slider}.value = 200, {slider}.dispatchEvent(new Event('input'))")
    assert text(browser, "at-time") == "8.00 s"
    browser.evaluate("document.getElementById('pace').value = '1'")
    browser.evaluate("document.getElementById('play').click()")
    # At this pace the gap itself would take twelve seconds.
    browser.wait_until("parseFloat(document.getElementById('at-time').textContent) > 20.1", timeout_s=9)
    browser.evaluate("document.getElementById('play').click()")
    assert browser.evaluate("document.getElementById('play').getAttribute('aria-label')") == "Play"


def test_selections_redraw_and_keep_the_point_of_view(browser):
    browser.evaluate("document.querySelector('[data-view=above]').click()")
    choose(browser, "colour", "sigma")
    scene = "document.getElementById('scene').layout"
    browser.wait_until(f"{scene}.coloraxis.colorbar.title.text.startsWith('posterior deviation')")
    assert browser.evaluate(f"{scene}.scene.camera.eye.z") == 2
    choose(browser, "camera", "0")
    before = browser.evaluate("document.getElementById('errors-time').data[0].y[0]")
    choose(browser, "camera", "1")
    browser.wait_until(f"document.getElementById('errors-time').data[0].y[0] !== {before}")
    assert browser.complaints() == []


def test_the_slider_moves_the_target_in_the_image_and_in_the_errors(browser):
    choose(browser, "camera", "0")
    ring = "document.getElementById('errors-image').data.find((trace) => trace.meta === 'now')"
    browser.wait_until(ring)
    browser.evaluate("document.getElementById('moment').focus()")
    browser.press(*HOME)
    browser.wait_until("document.getElementById('truth-error').layout.shapes[0].x0 === 0")
    before = "skytrace.report.cameras[0].projected.x[0]"
    browser.wait_until(f"{ring}.x[0] === {before}")
    browser.press(*RIGHT)
    browser.press(*RIGHT)
    browser.press(*RIGHT)
    browser.wait_until(f"{ring}.x[0] !== {before}")
    choose(browser, "camera", "1")
    browser.wait_until(f"{ring}?.x[0] === skytrace.report.cameras[1].projected.x[3]")
    assert browser.complaints() == []


def test_the_errors_against_the_truth_colour_the_path(browser):
    choose(browser, "colour", "error")
    scene = "document.getElementById('scene')"
    browser.wait_until(f"{scene}.layout.coloraxis.colorbar.title.text === 'error [cm]'")
    assert "true path" in text(browser, "scene-caption")
    assert browser.evaluate(f"{scene}.data.some((trace) => trace.meta === 'truth' && trace.x.length > 100)")
    assert browser.evaluate("document.getElementById('truth-error').data[0].x.length") > 60
    choose(browser, "colour", "time")
    assert browser.complaints() == []


def test_clocks_are_drawn_with_their_deviations(browser):
    names = ("offset", "deviation", "rate", "readout")
    drawn = [browser.evaluate(f"document.getElementById('clock-{name}').data[0].y.length") for name in names]
    assert drawn == [3] * 4
    assert browser.evaluate("document.getElementById('clock-rate').data[0].error_x.array.length") == 3


def test_figures_follow_the_colour_scheme(browser):
    colour = "document.getElementById('timeline').layout.template.layout.font.color"
    browser.emulate(1280, 900, scheme="light")
    browser.wait_until(f"{colour} === '#16202a'")
    browser.emulate(1280, 900, scheme="dark")
    browser.wait_until(f"{colour} === '#e6eaf0'")
    assert browser.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(17, 21, 26)"
    assert browser.complaints() == []


def test_phone_shows_the_page_without_sideways_scrolling(report):
    with chromium.browser() as browser:
        opened(browser, report, width=390, height=844, phone=True)
        assert browser.evaluate("document.documentElement.scrollWidth") == 390
        assert browser.evaluate("document.getElementById('scene').clientWidth") <= 390
        assert browser.evaluate("document.getElementById('timeline').layout.dragmode") is False
        assert browser.complaints() == []


def test_without_webgl_the_flight_is_drawn_from_above(report):
    with chromium.browser("--disable-3d-apis") as browser:
        opened(browser, report)
        assert browser.evaluate("document.getElementById('scene').data.every((trace) => trace.type === 'scatter')")
        assert "no WebGL" in text(browser, "scene-caption")
        browser.evaluate("document.getElementById('moment').focus()")
        browser.press(*END)
        assert text(browser, "at-time") == "28.00 s"
        assert browser.complaints() == []
