"""The figures say what the reconstruction says, in JSON that plotly accepts."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from html_page import coloured
from hypothesis import given
from hypothesis import strategies as st
from report_scene import make_reconstruction

from skytrace.model.reconstruction import Reconstruction, Residuals
from skytrace.model.trajectory import Trajectory
from skytrace.report import figures, theme
from skytrace.report.clock_figures import clock_figures
from skytrace.report.picture import picture_from_world
from skytrace.report.residual_figures import arrow_magnification, residual_figures
from skytrace.report.samples import MAX_RESIDUALS, path_samples, sight_intervals


def scene_of(reconstruction):
    path = path_samples(reconstruction)
    return figures.scene_figure(reconstruction, path, picture_from_world(reconstruction), "units")


def without_residuals(reconstruction: Reconstruction) -> Reconstruction:
    none = Residuals(np.zeros(0), np.zeros(0), np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0, bool))
    cameras = {camera_id: replace(camera, residuals=none) for camera_id, camera in reconstruction.cameras.items()}
    return Reconstruction(reconstruction.reference, cameras, Trajectory(()))


@given(st.lists(st.floats(-1e4, 1e4), min_size=1, max_size=20), st.floats(1e-6, 100))
def test_rounded_numbers_stay_within_the_step(values, step):
    rounded = figures.numbers(values, step)
    assert np.abs(np.array(rounded) - values).max() <= 0.5 * max(step, 1e-9) + 1e-9
    assert figures.numbers([np.nan, np.inf], step) == [None, None]


def test_significant_numbers():
    assert figures.significant([1.23456e-9, 123456.0, np.nan], 3) == [1.23e-9, 123000.0, None]


def test_path_breaks_between_segments_only():
    path = path_samples(make_reconstruction(n_segments=3))
    columns = figures.path_columns(path)
    for column in columns.values():
        assert len(column) == len(path.time_s) + 2
    gaps = [row for row, time in enumerate(columns["time"]) if time is None]
    assert len(gaps) == 2
    assert [columns["segment"][row - 1] for row in gaps] == [1, 2]
    assert [columns["segment"][row + 1] for row in gaps] == [2, 3]


def test_colour_choices_leave_out_an_unknown_deviation():
    keys = {
        known: [choice["key"] for choice in figures.colour_choices(path_samples(reconstruction), "m")]
        for known, reconstruction in ((True, make_reconstruction()), (False, make_reconstruction(with_sigma=False)))
    }
    assert keys == {True: ["time", "speed", "sigma", "cameras"], False: ["time", "speed", "cameras"]}
    for choice in figures.colour_choices(path_samples(make_reconstruction()), "m"):
        assert choice["min"] < choice["max"]


def test_a_few_wild_samples_do_not_use_up_the_colour_scale():
    path = path_samples(make_reconstruction())
    sigma = path.sigma.copy()
    sigma[:5] = 50.0
    deviation = figures.colour_choices(replace(path, sigma=sigma), "m")[2]
    assert deviation["max"] < 0.01
    still = figures.colour_choices(replace(path, speed=np.full(len(path.speed), 2.0)), "m")[1]
    assert (still["min"], still["max"]) == (1.5, 2.5)


def test_scene_shows_the_path_and_the_cameras_in_the_frame_of_the_picture():
    reconstruction = make_reconstruction(["left", "right", "a <b>"])
    path, picture = path_samples(reconstruction), picture_from_world(reconstruction)
    traces = {trace["name"]: trace for trace in scene_of(reconstruction)["data"]}
    assert {"left", "right", "a ‹b›", "trajectory"} <= set(traces)
    assert traces["cameras"]["text"] == ["left", "right", "a ‹b›"]
    for k, camera in enumerate(reconstruction.cameras.values()):
        shown = [traces["cameras"][axis][k] for axis in "xyz"]
        np.testing.assert_allclose(shown, picture.apply(camera.camera_from_world.centre), atol=1e-4)
    line = np.array([[v for v in traces["trajectory"][axis] if v is not None] for axis in "xyz"]).T
    np.testing.assert_allclose(line, picture.apply(path.position), atol=1e-4)


def test_timeline_shows_each_camera_and_what_is_covered():
    reconstruction = make_reconstruction()
    figure = figures.timeline_figure(reconstruction, path_samples(reconstruction), "units")
    traces = {trace.get("name"): trace for trace in figure["data"]}
    covered = [v for v in traces["covered"]["x"] if v is not None]
    assert covered == [time for s in reconstruction.trajectory.segments for time in (s.begin_s, s.end_s)]
    assert list(traces)[:5] == ["covered", *reconstruction.cameras] == figure["layout"]["yaxis"]["categoryarray"]
    first, last = figures.time_range_s(reconstruction)
    assert first < 0 < 29 < last


def test_a_camera_sees_the_path_where_its_detections_agree_and_nowhere_else():
    reconstruction = make_reconstruction()
    path, camera = path_samples(reconstruction), reconstruction.cameras["cam1"]
    seen = figures.projected_columns(path, camera)
    assert len(seen["x"]) == len(figures.path_columns(path)["time"])
    row = {t: k for k, t in enumerate(figures.path_columns(path)["time"])}
    intervals = sight_intervals(camera)
    shown = np.array([seen["x"][row[t]] is not None for t in np.round(path.time_s, 3)])
    inside = [any(begin - 0.25 <= t <= end + 0.25 for begin, end in intervals) for t in path.time_s]
    assert list(shown) == inside
    assert 0.5 < shown.mean() < 1
    k = int(np.flatnonzero(shown)[10])
    at = camera.camera_from_world.apply(path.position[k])
    xy = 1510 * at[0] / at[2] + 960, 1512 * at[1] / at[2] + 540
    np.testing.assert_allclose([seen[axis][row[round(path.time_s[k], 3)]] for axis in "xy"], xy, atol=0.51)


def test_clock_figures_show_every_camera_with_its_deviations():
    reconstruction = make_reconstruction()
    summary = {"cameras": {camera_id: {"frame_rate_given_hz": 30.003} for camera_id in reconstruction.cameras}}
    shown = clock_figures(reconstruction, summary)
    assert shown["offset"]["data"][0]["x"] == [0.0, -12.5, -25.0, -37.5]
    assert shown["deviation"]["data"][0]["x"] == [0.0, 1.2, 1.2, 1.2]
    assert shown["rate"]["data"][0]["x"] == pytest.approx([-100] * 4, abs=0.1)
    assert shown["rate"]["data"][0]["error_x"]["array"] == pytest.approx([0, 7.5, 7.5, 7.5])
    assert shown["readout"]["data"][0]["x"] == [20.0] * 4
    assert clock_figures(reconstruction, {})["rate"]["data"][0]["x"] == [None] * 4


@pytest.mark.parametrize("degenerate", [False, True])
def test_plotly_accepts_every_figure(degenerate):
    import plotly.graph_objects as go

    reconstruction = make_reconstruction(with_sigma=not degenerate)
    if degenerate:
        reconstruction = without_residuals(reconstruction)
    shown = [scene_of(reconstruction), figures.timeline_figure(reconstruction, path_samples(reconstruction), "units")]
    shown += clock_figures(reconstruction, {}).values()
    for camera in reconstruction.cameras.values():
        shown += residual_figures(camera, theme.camera_colour(0), figures.time_range_s(reconstruction)).values()
    for figure in shown:
        json.dumps(figure, allow_nan=False)
        assert go.Figure(coloured(figure)).to_dict()["data"] is not None
    for scheme in theme.themes().values():
        go.Figure(layout={"template": scheme["template"], "coloraxis": {"colorscale": scheme["scale"]}})


def test_residuals_are_thinned_and_keep_agreeing_and_contradicting_apart():
    camera = make_reconstruction(["a", "b"], duration_s=120.0).cameras["a"]
    shown = residual_figures(camera, "#123456", [0, 1])
    agreeing, aside, median = shown["time"]["data"]
    assert len(agreeing["x"]) + len(aside["x"]) == MAX_RESIDUALS
    assert np.median(aside["y"]) > 5 > np.median(agreeing["y"])
    assert len(shown["image"]["data"][0]["x"]) == len(agreeing["x"])
    assert 0.3 < np.nanmedian(np.array(median["y"], float)) < 1.0


def test_tiny_residuals_of_a_noise_free_run_keep_their_digits():
    camera = make_reconstruction(["a", "b"]).cameras["a"]
    tiny = replace(camera.residuals, error_px=camera.residuals.error_px * 1e-7)
    shown = residual_figures(replace(camera, residuals=tiny, sigma_px=5e-8), "#123456", [0, 1])
    assert 1e-8 < np.median(shown["time"]["data"][0]["y"]) < 1e-7
    assert 0 < max(shown["histogram"]["data"][0]["x"]) < 1e-6


@given(st.floats(1e-4, 1e3), st.floats(200, 8000))
def test_arrows_are_magnified_by_a_round_factor_to_a_readable_length(longest_px, width_px):
    factor = arrow_magnification(np.array([[longest_px, 0.0]]), width_px)
    assert str(factor).rstrip("0") in {"1", "2", "5"}
    if factor > 1:
        assert width_px / 8 / 2.6 <= factor * longest_px <= width_px / 8 * (1 + 1e-9)


def luminance(colour: str) -> float:
    channels = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def contrast(a: str, b: str) -> float:
    low, high = sorted((luminance(a), luminance(b)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_colours_can_be_told_from_the_background(scheme):
    colours = theme.SCHEMES[scheme]
    assert min(contrast(colour, colours["card"]) for colour in theme.CAMERA_COLOURS) >= 3.0
    assert min(contrast(colours[name], colours["card"]) for name in ("ink", "muted", "accent")) >= 4.5
    assert min(contrast(stop, colours["card"]) for _, stop in theme.themes()[scheme]["scale"]) >= 2.4
