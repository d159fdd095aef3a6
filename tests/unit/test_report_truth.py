"""What is known of the truth is added to the page of a run, replaced when it is added again, and drawn for papers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from html_page import Page, assert_controls_are_named, coloured, data_of
from report_scene import make_reconstruction, make_summary

from skytrace.evaluation.path import SampledPath
from skytrace.evaluation.summary import evaluate
from skytrace.geometry.rigid import Similarity, so3_exp
from skytrace.model.trajectory import Trajectory
from skytrace.report import add_truth, render_report
from skytrace.report.container import take_apart
from skytrace.report.static import pictures

TRUTH_FROM_WORLD = Similarity(30.0, so3_exp(np.array([0.3, -0.2, 1.0])), np.array([5.0, -7.0, 1.0]))
RATE_HZ = 5.0
OFF_M = 0.06


@pytest.fixture(scope="module")
def reconstruction():
    return make_reconstruction(["north", "south", "east"])


@pytest.fixture(scope="module")
def html(reconstruction):
    return render_report(
        reconstruction, make_summary(reconstruction), name="A <flight> & more", versions={}, settings={}
    )


@pytest.fixture(scope="module")
def truth(reconstruction):
    """The true path, each sample off by 6 cm, back and forth; one is not known."""
    position = TRUTH_FROM_WORLD.apply(reconstruction.trajectory.position(np.arange(0, 30, 1 / RATE_HZ)))
    position[:, 2] += OFF_M * (-1.0) ** np.arange(len(position))
    position[20] = np.nan
    return position


@pytest.fixture(scope="module")
def evaluation(reconstruction, truth):
    centres = {c: e.camera_from_world.centre for c, e in reconstruction.cameras.items()}
    rotations = {c: e.camera_from_world.rotation for c, e in reconstruction.cameras.items()}
    return evaluate(
        SampledPath.from_trajectory(reconstruction.trajectory),
        truth=truth,
        rate_hz=RATE_HZ,
        centres=centres,
        known_centres={c: 2 * centre for c, centre in centres.items()},
        rotations=rotations,
        known_rotations=rotations,
    )


@pytest.fixture(scope="module")
def judged(html, evaluation, truth):
    return add_truth(html, evaluation, truth, RATE_HZ)


def test_the_true_path_is_drawn_where_the_path_is(judged, reconstruction):
    traces = {trace["meta"]: trace for trace in data_of(judged)["scene"]["data"] if "meta" in trace}
    true, path = (np.array([traces[name][axis] for axis in "xyz"], float).T for name in ("truth", "path"))
    assert np.isnan(true[20]).all()
    known, drawn = true[np.isfinite(true[:, 0])], path[np.isfinite(path[:, 0])]
    assert len(known) > 130
    nearest = np.linalg.norm(known[:, None] - drawn, axis=2).min(axis=1)
    assert np.median(nearest) == pytest.approx(OFF_M / 30, rel=0.2)


def test_the_error_along_the_track_is_a_figure_and_a_colour(judged):
    import plotly.graph_objects as go

    data = data_of(judged)
    error = data["truth"]["error"]["data"][0]
    assert np.median(error["y"]) == pytest.approx(100 * OFF_M, rel=0.05)
    assert data["truth"]["scale"] == pytest.approx(30, rel=1e-3)
    column = [value for value in data["path"]["error"] if value is not None]
    assert len(data["path"]["error"]) == len(data["path"]["time"])
    assert 0.8 < len(column) / len(data["path"]["time"]) < 1  # not beside the unknown sample
    assert data["colours"][-1]["key"] == "error"
    go.Figure(coloured(data["truth"]["error"]))


def test_the_page_tells_the_errors_in_tables(judged):
    page = Page(judged)
    for text in ("Against the truth", "all covered samples", "velocity, in cm/s", "deviation 3"):
        assert text in page.text["main"], text
    assert "camera orientation" in page.text["thead"]
    assert page.text["h1"] == "A <flight> & more"
    page.assert_references_resolve()
    page.assert_asks_for_nothing()
    assert_controls_are_named(judged)


def test_adding_the_truth_again_replaces_it(judged, html, evaluation, truth):
    assert add_truth(judged, evaluation, truth, RATE_HZ) == judged
    centres_only = evaluate(
        SampledPath.from_trajectory(make_reconstruction().trajectory),
        centres={"a": np.zeros(3), "b": np.eye(3)[0], "c": np.eye(3)[1]},
        known_centres={"a": np.zeros(3), "b": np.eye(3)[0], "c": np.eye(3)[2]},
    )
    less = add_truth(judged, centres_only)
    assert less == add_truth(html, centres_only)
    assert "truth" not in data_of(less)
    assert "camera centre" in Page(less).text["thead"]


@pytest.mark.parametrize("page", ["", "<p>another page</p>"])
def test_another_page_is_refused(page, evaluation):
    with pytest.raises(ValueError, match="not a page of skytrace"):
        add_truth(page, evaluation)


def test_a_page_without_a_place_for_the_truth_is_refused(html, evaluation):
    with pytest.raises(ValueError, match="reconstruct it again"):
        add_truth(html.replace("<!-- truth -->", ""), evaluation)


def test_pictures_for_papers_are_png_and_the_same_each_time(judged, html):
    pytest.importorskip("matplotlib")
    data = take_apart(judged).data
    files = pictures(data)
    assert set(files) == {"overview.png", "trajectory.png", "residuals.png", "clocks.png", "error.png"}
    for content in files.values():
        assert content.startswith(b"\x89PNG")
        width, height = (int.from_bytes(content[k : k + 4], "big") for k in (16, 20))
        assert 600 < width < 2000
        assert 300 < height < 2500
    assert set(pictures(take_apart(html).data)) == set(files) - {"error.png"}
    assert pictures(data) == files


@pytest.mark.filterwarnings("error")
def test_pictures_of_a_run_that_covers_nothing_and_of_odd_names():
    pytest.importorskip("matplotlib")
    reconstruction = make_reconstruction(["a$b_c", "<$>" + "ü" * 40])
    nothing = replace(reconstruction, trajectory=Trajectory(()))
    page = render_report(nothing, {}, name="bare", versions={}, settings={})
    assert len(pictures(take_apart(page).data)) == 4
