"""The page of a calibration: the lens with its deviations, where boards were seen, and what remains unexplained."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

import numpy as np

from skytrace.geometry.projection import COEFFICIENTS
from skytrace.report.calibration_figures import (
    DrawnView,
    LensPicture,
    coverage_figure,
    residual_figure,
    scatter_figure,
)
from skytrace.report.shell import filled, tiles, warnings_card, whole_page
from skytrace.report.tables import table
from skytrace.report.theme import themes
from skytrace.report.words import NO_BREAK, count, number

__all__ = ["DrawnView", "LensPicture", "render_calibration_report"]


def render_calibration_report(picture: LensPicture, summary: Mapping[str, Any], *, name: str) -> str:
    """The page of a calibration: HTML text that holds all it needs, plotly.js included.

    `summary` is what the calibration file keeps of how it came about; of a lens that was refused, the page says why.
    The same input gives the same text.
    """
    main = filled(
        "calibration_page.html",
        refused=_refused(summary["refused"]),
        warnings=warnings_card([*summary["warnings"], *summary["advice"]]),
        summary=escape(_sentence(picture, summary)),
        tiles=tiles(_figures(picture, summary)),
        lens=_lens_table(picture),
        views=_view_table(picture),
    )
    figures = {
        "coverage": coverage_figure(picture),
        "residuals": residual_figure(picture),
        "scatter": scatter_figure(picture),
    }
    data = {"themes": themes(), "figures": figures}
    return whole_page(name, "skytrace calibration", main, data, ["calibration_page.js"], ["calibration_page.css"])


def _refused(reasons: list[str]) -> str:
    if not reasons:
        return ""
    items = "".join(f"<p>{escape(reason[:1].upper() + reason[1:])}.</p>\n" for reason in reasons)
    heading = '<h2 id="refused-title">These pictures do not determine the lens</h2>'
    return f'<section class="card warnings" aria-labelledby="refused-title">\n{heading}\n{items}</section>\n'


def _sentence(picture: LensPicture, summary: Mapping[str, Any]) -> str:
    return (
        f"{count(summary['used'], 'picture')} of {summary['pictures']} used, {summary['corners_used']} corners of a "
        f"{summary['board']}; a {picture.lens.model} lens leaves {number(summary['rms_px'], 3)} px (root mean square)."
    )


def _figures(picture: LensPicture, summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    lens = picture.lens
    wide = lens.undistort(np.array([[-0.5, 0.0], [lens.size_px[0] - 0.5, 0.0]]) + [0.0, lens.principal_px[1]])[0][:, 0]
    angle_deg = float(np.degrees(np.ptp(np.arctan(wide))))
    shown = [
        ("focal length", f"{number(lens.focal_px[0], 5)}{NO_BREAK}px ± {_percent(summary['focal_sd'])}"),
        ("angle of view, across", f"{angle_deg:.1f}°"),
        ("residuals", f"{number(summary['rms_px'], 3)}{NO_BREAK}px"),
    ]
    if summary["focal_halves_rms"] is not None:
        shown.append(("focal lengths of two halves differ by", _percent(summary["focal_halves_rms"])))
    shown.append(("… when movement is taken twice or half as large", _percent(summary["focal_motion_sensitivity"])))
    shown.append(("movement during the readout", f"{np.degrees(summary['turn_sd_rad']):.2f}° (one deviation)"))
    return shown


def _percent(share: float) -> str:
    return f"{100 * share:.2f}{NO_BREAK}%"


def _lens_table(picture: LensPicture) -> str:
    lens, sd = picture.lens, picture.lens.deviation
    rows = [
        ("focal length x", lens.focal_px[0], None if sd is None else sd.focal * lens.focal_px[0]),
        ("focal length y", lens.focal_px[1], None if sd is None else sd.focal * lens.focal_px[1]),
        ("principal point x", lens.principal_px[0], None if sd is None else sd.principal_px[0]),
        ("principal point y", lens.principal_px[1], None if sd is None else sd.principal_px[1]),
    ]
    cells = [(escape(title), [f"{value:.2f} px", "" if s is None else f"{s:.2f} px"]) for title, value, s in rows]
    for k, title in enumerate(COEFFICIENTS[lens.model]):
        deviation = "" if sd is None else f"{sd.distortion[k]:.5f}"
        cells.append((title, [f"{lens.distortion[k]:.5f}", deviation]))
    return table("The lens", ("", "value", "standard deviation"), cells)


def _view_table(picture: LensPicture) -> str:
    rows = []
    for view in picture.views:
        tilt = "" if view.tilt_deg is None else f"{view.tilt_deg:.0f}°"
        rms = "" if view.rms_px is None or not np.isfinite(view.rms_px) else f"{view.rms_px:.3f} px"
        rows.append((escape(view.name), [str(len(view.xy_px)), tilt, rms, escape(view.fate)]))
    return table("All pictures", ("picture", "corners", "tilt", "residuals", "used?"), rows)
