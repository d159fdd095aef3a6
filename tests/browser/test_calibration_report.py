"""The page of a calibration in a real browser: it draws itself without a complaint, in the dark and on phones too."""

from __future__ import annotations

import chromium
import pytest
from calibration_scene import make_picture, make_summary

from skytrace.report import render_calibration_report

pytestmark = pytest.mark.skipif(chromium.EXECUTABLE is None, reason="no Chromium is installed")


@pytest.mark.parametrize("emulation", [{}, {"scheme": "dark"}, {"width": 390, "phone": True}])
def test_draws_every_figure_without_errors_or_requests(tmp_path, emulation):
    page = tmp_path / "page.html"
    page.write_text(render_calibration_report(make_picture(30), make_summary(), name="lens"), encoding="utf-8")
    with chromium.browser() as browser:
        browser.emulate(**{"width": 1280, "height": 900, **emulation})
        browser.open(page)
        browser.wait_until("document.documentElement?.dataset.report === 'drawn'")
        for element, traces in (("coverage", 31), ("residuals", 1), ("scatter", 30)):
            assert browser.evaluate(f"document.getElementById('{element}').data.length") == traces
        assert browser.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
        assert browser.complaints() == []
        assert browser.requests() == [page.as_uri()]
