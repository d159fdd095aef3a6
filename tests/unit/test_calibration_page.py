"""The page of a calibration: what it says, and what its figures hold."""

from __future__ import annotations

import numpy as np
from calibration_scene import SIZE, make_picture, make_summary

from skytrace.report import render_calibration_report
from skytrace.report.calibration_figures import LensPicture, coverage_figure, residual_figure, scatter_figure


def test_the_page_tells_the_lens_and_every_picture():
    page = render_calibration_report(make_picture(), make_summary(advice=["take < more"]), name="my <lens>")
    for text in (
        "my &lt;lens&gt;",
        "600.00 px",
        "0.40",
        "0.61",
        "p0 &lt;b&gt;.jpg",
        "no board found",
        "take &lt; more",
    ):
        assert text in page
    for coefficient in ("k1", "k2", "k3", "k4"):
        assert f'<th scope="row">{coefficient}</th>' in page
    assert page == render_calibration_report(make_picture(), make_summary(advice=["take < more"]), name="my <lens>")


def test_a_refused_lens_says_why_at_the_top():
    refused = render_calibration_report(make_picture(), make_summary(refused=["tilt the board"]), name="lens")
    assert "do not determine the lens" in refused
    assert "<p>Tilt the board.</p>" in refused
    assert "do not determine the lens" not in render_calibration_report(make_picture(), make_summary(), name="lens")


def test_coverage_shows_every_corner_and_marks_views_that_were_not_used():
    figure = coverage_figure(make_picture())
    assert len(figure["data"]) == 7
    assert [len(trace["x"]) for trace in figure["data"]] == [40] * 7
    assert [trace["marker"].get("symbol") for trace in figure["data"]] == [None] * 6 + ["x-thin"]
    assert figure["layout"]["xaxis"]["range"] == [-0.5, SIZE[0] - 0.5]
    assert figure["layout"]["yaxis"]["range"] == [SIZE[1] - 0.5, -0.5]


def test_residuals_are_those_of_the_views_used():
    picture = make_picture()
    assert sum(len(trace["x"]) for trace in scatter_figure(picture)["data"]) == 240
    shown = np.array([x for trace in scatter_figure(picture)["data"] for x in trace["x"]])
    errors = np.concatenate([view.error_px[:, 0] for view in picture.used if view.error_px is not None])
    np.testing.assert_allclose(shown, errors, atol=6e-4)
    assert len(residual_figure(make_picture(30))["data"]) == 1
    assert residual_figure(LensPicture(picture.lens, ()))["data"] == []
