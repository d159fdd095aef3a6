"""The page of a synchronisation in a real browser: it draws itself without a complaint and answers to the keyboard."""

from __future__ import annotations

from pathlib import Path

import chromium
import pytest
from sync_scene import make_curves, make_document, make_recordings, unsolved

from skytrace.errors import ReconstructionError
from skytrace.estimation.sync_settings import SyncSettings
from skytrace.report import render_sync_report

pytestmark = pytest.mark.skipif(chromium.EXECUTABLE is None, reason="no Chromium is installed")

DRAWN = "document.documentElement?.dataset.report === 'drawn'"
DOWN, ENTER = ("ArrowDown", 40), ("Enter", 13)
IDS = ("north", "a camera with quite a long name <b>", "east", "hill", "lake")
FIGURES = ("graph", "clock-0", "clock-1", "score", "errors-histogram", "errors-time")


def written(folder: Path, document, failure=None) -> Path:
    curves = make_curves(document)
    file = folder / "sync.html"
    html = render_sync_report(document, curves, make_recordings(IDS), SyncSettings(), name="A flight", failure=failure)
    file.write_text(html, encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> Path:
    return written(tmp_path_factory.mktemp("sync"), make_document(IDS))


@pytest.fixture(scope="module")
def running():
    with chromium.browser() as browser:
        yield browser


@pytest.fixture
def browser(running, page):
    """A desktop's browser that has just drawn the page."""
    return opened(running, page)


def opened(browser, page, **emulation):
    browser.emulate(**{"width": 1280, "height": 900, **emulation})
    browser.open(page)
    browser.wait_until(DRAWN)
    return browser


def of(element: str) -> str:
    return f"document.getElementById('{element}')"


def shown_pair(browser) -> str:
    return browser.evaluate(f"{of('pair')}.selectedOptions[0].textContent")


def test_draws_every_figure_without_errors_or_requests(browser, page):
    for element in FIGURES:
        assert browser.evaluate(f"{of(element)}.data.length") >= 2
        assert browser.evaluate(f"{of(element)}.querySelector('svg.main-svg') !== null")
    # Chosen buttons only: those that plotly adds by itself include one that uploads the figure.
    assert browser.evaluate("document.querySelectorAll('.modebar-btn').length") == 1 + 4 * (len(FIGURES) - 1)
    assert shown_pair(browser).startswith("north – a camera")
    assert "It is used." in browser.evaluate(f"{of('pair-words')}.textContent")
    assert browser.complaints() == []
    assert browser.requests() == [page.as_uri()]


def test_the_selection_answers_to_the_keyboard(browser):
    browser.evaluate(f"{of('pair')}.focus()")
    browser.press(*DOWN)
    browser.wait_until(f"{of('score')}.data.find((t) => t.name === 'chosen').x[0] === 31.25")
    assert shown_pair(browser).startswith("north – east")
    browser.evaluate(f"{of('next')}.click()")
    browser.wait_until(f"{of('pair')}.value === '2'")
    browser.evaluate(f"{of('previous')}.click()")
    browser.wait_until(f"{of('pair')}.value === '1'")
    assert browser.complaints() == []


def test_the_table_leads_to_a_pair_and_the_graph_marks_it(browser):
    halo = f"{of('graph')}.data.find((t) => t.meta === 'selected')"
    before = browser.evaluate(f"JSON.stringify({halo}.x)")
    browser.evaluate("document.querySelector('[data-pair=\"2\"]').focus()")
    browser.press(*ENTER)
    browser.wait_until(f"{of('pair')}.value === '3'")
    assert "the other pairs put it at" in browser.evaluate(f"{of('pair-words')}.textContent")
    browser.wait_until(f"JSON.stringify({halo}.x) !== '{before}'")
    assert browser.evaluate(f"{halo}.x.length") == 2
    assert browser.evaluate("document.activeElement.id") == "pair-title"
    assert browser.evaluate(f"{of('pair-title')}.getBoundingClientRect().top") < 900
    assert browser.complaints() == []


def test_a_click_on_the_graph_chooses_the_pair(browser):
    knob = f"{of('graph')}.data.find((t) => t.meta === 'pairs')"
    place = browser.evaluate(
        f"(({{x, y}}, {{_fullLayout: {{xaxis, yaxis}}}}) => {{"
        f" const box = {of('graph')}.querySelector('.nsewdrag').getBoundingClientRect();"
        f" return [box.left + xaxis.d2p(x[3]), box.top + yaxis.d2p(y[3])]; }})({knob}, {of('graph')})"
    )
    for kind, buttons in (("mouseMoved", 0), ("mousePressed", 1), ("mouseReleased", 0)):
        button = "none" if kind == "mouseMoved" else "left"
        browser.call(
            "Input.dispatchMouseEvent",
            type=kind,
            x=place[0],
            y=place[1],
            button=button,
            buttons=buttons,
            clickCount=int(buttons or kind == "mouseReleased"),
        )
        browser.evaluate("new Promise((done) => requestAnimationFrame(() => setTimeout(done, 60)))")
    browser.wait_until(f"{of('pair')}.value === '2'")  # the graph's fourth pair is the third of all
    assert shown_pair(browser).startswith("north – hill")
    assert browser.complaints() == []


def test_zooms_to_the_chosen_offset_and_back(browser):
    axis = f"{of('score')}.layout.xaxis"
    browser.evaluate(f"{of('zoom-chosen')}.click()")
    browser.wait_until(f"{axis}.range[0] === -22.5 && {axis}.range[1] === -2.5")
    browser.evaluate(f"{of('zoom-all')}.click()")
    browser.wait_until(f"{axis}.range[0] < -140 && {axis}.range[1] > 140")
    assert browser.complaints() == []


def test_a_pair_without_evidence_shows_words_only(browser):
    browser.evaluate(f"{of('pair')}.value = '5', {of('pair')}.dispatchEvent(new Event('change'))")
    browser.wait_until(f"{of('score-figure')}.hidden && {of('error-figures')}.hidden")
    assert "No offset leaves enough time" in browser.evaluate(f"{of('pair-words')}.textContent")
    assert browser.evaluate(f"{of('next')}.disabled && {of('zoom-chosen')}.disabled")
    browser.evaluate(f"{of('pair')}.value = '0', {of('pair')}.dispatchEvent(new Event('change'))")
    browser.wait_until(f"{of('score')}.clientWidth > 600 && !{of('error-figures')}.hidden")
    assert browser.complaints() == []


def test_figures_follow_the_colour_scheme(browser):
    colour = f"{of('score')}.layout.template.layout.font.color"
    browser.wait_until(f"{colour} === '#16202a'")
    browser.emulate(1280, 900, scheme="dark")
    browser.wait_until(f"{colour} === '#e6eaf0'")
    assert browser.evaluate(f"{of('graph')}.data.find((t) => t.mode === 'markers+text').textfont.color") == "#e6eaf0"
    assert browser.complaints() == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_phone_shows_the_page_without_sideways_scrolling(running, page, scheme):
    browser = opened(running, page, width=390, height=844, phone=True, scheme=scheme)
    assert browser.evaluate("document.documentElement.scrollWidth") == 390
    for element in FIGURES:
        assert browser.evaluate(f"{of(element)}.clientWidth") <= 390
    notes = f"{of('graph')}.layout.annotations"
    assert browser.evaluate(f"{notes}[1].y < {notes}[0].y - 1")  # the rings stand one above the other
    assert browser.complaints() == []


def test_a_failure_is_drawn_with_what_evidence_there_is(running, tmp_path):
    failure = ReconstructionError("synchronise", "no two cameras can be tied together", hint="Fly turns")
    browser = opened(running, written(tmp_path, unsolved(make_document(IDS)), failure))
    assert "could not be synchronised" in browser.evaluate("document.querySelector('main h2').textContent")
    assert browser.evaluate(f"{of('score')}.data.length") >= 3
    assert browser.evaluate(f"{of('clock-1')} === null")
    assert browser.complaints() == []
