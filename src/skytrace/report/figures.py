"""The figures about the flight as plotly's JSON: the 3D picture and the timeline. Pure functions of a reconstruction.

Colours written "$name" are named in theme.py and put in by the page, which knows the reader's colour scheme.
"""

from __future__ import annotations

import html
from collections.abc import Iterable
from typing import Any

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import Rigid
from skytrace.model.reconstruction import Reconstruction
from skytrace.report.picture import frustum_lines
from skytrace.report.samples import MAX_TRUTH_SAMPLES, PathSamples, sight_intervals, thin
from skytrace.report.theme import camera_colour

Figure = dict[str, Any]
PATH, TARGET, SIGHT = "path", "target", "sight"  # the traces that the page's script looks for, by their `meta`


def numbers(values: Iterable[float], step: float) -> list[float | None]:
    """Values rounded to the power of ten next below `step`, None (a gap in plotly) where they are not finite."""
    decimals = int(np.ceil(-np.log10(step) - 1e-9))
    array = np.round(np.asarray(values, float), decimals)
    if decimals <= 0:
        return [int(v) if np.isfinite(v) else None for v in array.tolist()]
    return [v if np.isfinite(v) else None for v in array.tolist()]


def resolution(points: FloatArray) -> float:
    """A length that does not show in a picture of points (n, 3): 1e-5 of their extent."""
    return 1e-5 * (float(np.ptp(points, axis=0).max()) or 1.0) if len(points) else 1e-5


def label(camera_id: str, longest: int = 18) -> str:
    """A camera's name as plotly's labels take it: short, and not read as markup."""
    return html.escape(camera_id if len(camera_id) <= longest else camera_id[: longest - 1] + "…", quote=False)


def path_columns(path: PathSamples) -> dict[str, list[float | None]]:
    """The path's samples by name, one row of None between segments so that lines break there."""
    breaks = np.flatnonzero(np.diff(path.segment)) + 1
    step = resolution(path.position)

    def column(values: FloatArray, precision: float) -> list[float | None]:
        return numbers(np.insert(np.asarray(values, float), breaks, np.nan), precision)

    columns = {"time": column(path.time_s, 1e-3)}
    for axis, name in enumerate("xyz"):
        columns[name] = column(path.position[:, axis], step)
    columns["speed"] = column(path.speed, step)
    columns["sigma"] = column(path.sigma, 0.01 * step)
    columns["cameras"] = column(path.n_cameras, 1)
    columns["segment"] = column(path.segment + 1, 1)
    return columns


def colour_choices(path: PathSamples, unit: str) -> list[dict[str, Any]]:
    """What the path can be coloured by: the column's name, its label and the range of its colours."""
    choices = []
    for key, title, values in (
        ("time", "time [s]", path.time_s),
        ("speed", f"speed [{unit}/s]", path.speed),
        ("sigma", f"posterior deviation [{unit}]", path.sigma),
        ("cameras", "number of cameras", path.n_cameras),
    ):
        known = np.asarray(values, float)[np.isfinite(values)]
        if not len(known):
            continue
        # A few wild samples at the ends of segments must not use up the scale.
        low, high = (known.min(), known.max()) if key in ("time", "cameras") else np.percentile(known, (1, 98))
        choices.append({"key": key, "label": title, "min": _short(low), "max": _short(max(high, low * (1 + 1e-6)))})
    return choices


def _short(value: float) -> float:
    return float(f"{value:.4g}")


def scene_figure(
    reconstruction: Reconstruction,
    path: PathSamples,
    picture_from_world: Rigid,
    unit: str,
    truth_in_world: FloatArray | None = None,
) -> Figure:
    """The flight and its cameras in 3D, in the frame of the picture. The script adds colours, hover texts and target."""
    centres = np.array([c.camera_from_world.centre for c in reconstruction.cameras.values()])
    everything = picture_from_world.apply(np.concatenate([path.position, centres]))
    step = resolution(everything)
    depth = 0.05 * float(np.linalg.norm(np.ptp(everything, axis=0))) or 1.0

    breaks = np.flatnonzero(np.diff(path.segment)) + 1
    line = np.insert(picture_from_world.apply(path.position), breaks, np.nan, axis=0)
    data = [_lines(line, step, "trajectory", meta=PATH, line={"width": 5, "color": "$accent"})]
    if truth_in_world is not None:
        true_path = picture_from_world.apply(truth_in_world[thin(len(truth_in_world), MAX_TRUTH_SAMPLES)])
        data.append(_lines(true_path, step, "truth", line={"width": 2, "color": "$muted"}, hoverinfo="skip"))
    for index, (camera_id, camera) in enumerate(reconstruction.cameras.items()):
        colour = camera_colour(index)
        strokes = picture_from_world.apply(frustum_lines(camera.camera_from_world, camera.refined, depth))
        outline = {"line": {"width": 3, "color": colour}, "showlegend": False}
        data.append(_lines(strokes, step, label(camera_id), hoverinfo="name", **outline))
    data.append(_names(reconstruction, picture_from_world.apply(centres), step))
    faint = {"line": {"width": 2, "color": "$target"}, "opacity": 0.5, "showlegend": False, "hoverinfo": "skip"}
    data.append(_lines(np.zeros((0, 3)), step, "lines of sight", meta=SIGHT, **faint))
    dot = {"size": 7, "color": "$target", "line": {"width": 1, "color": "$card"}}
    data.append(_lines(np.zeros((0, 3)), step, "target", meta=TARGET, mode="markers", marker=dot, hoverinfo="skip"))
    axes = {f"{axis}axis": {"title": {"text": f"{way} [{unit}]"}} for axis, way in zip("xyz", _WAYS, strict=True)}
    layout = {
        "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
        "scene": {**axes, "aspectmode": "data", "dragmode": "turntable", "camera": VIEWS["overview"]},
        "legend": {"orientation": "h", "x": 0, "y": 0, "yanchor": "bottom", "itemsizing": "constant"},
        "uirevision": "keep the reader's view",
    }
    return {"data": data, "layout": layout}


_WAYS = ("right", "forward", "up")
_UP, _LEVEL = {"x": 0, "y": 0, "z": 1}, {"x": 0, "y": 1, "z": 0}
VIEWS: dict[str, Any] = {
    "overview": {"eye": {"x": -0.6, "y": -1.5, "z": 0.75}, "up": _UP, "center": {"x": 0, "y": 0, "z": 0}},
    "above": {"eye": {"x": 0, "y": -0.01, "z": 2}, "up": _LEVEL, "center": {"x": 0, "y": 0, "z": 0}},
    "front": {"eye": {"x": 0, "y": -2, "z": 0.05}, "up": _UP, "center": {"x": 0, "y": 0, "z": 0}},
    "side": {"eye": {"x": 2, "y": 0, "z": 0.05}, "up": _UP, "center": {"x": 0, "y": 0, "z": 0}},
}


def _lines(points: FloatArray, step: float, name: str, **attributes: Any) -> dict[str, Any]:
    x, y, z = (numbers(points[:, axis], step) for axis in range(3))
    return {"type": "scatter3d", "mode": "lines", "name": name, "x": x, "y": y, "z": z, **attributes}


def _names(reconstruction: Reconstruction, centres: FloatArray, step: float) -> dict[str, Any]:
    colours = [camera_colour(index) for index in range(len(reconstruction.cameras))]
    return {
        **_lines(centres, step, "cameras", mode="markers+text", hoverinfo="text", showlegend=False),
        "marker": {"size": 3, "color": colours},
        "text": [label(camera_id) for camera_id in reconstruction.cameras],
        "textposition": "bottom center",
        "textfont": {"color": "$ink", "size": 12},
    }


def timeline_figure(reconstruction: Reconstruction, path: PathSamples, unit: str) -> Figure:
    """When each camera saw the target, against what is covered and how certain the position is."""
    covered = np.array([[s.begin_s, s.end_s] for s in reconstruction.trajectory.segments]).reshape(-1, 2)
    rows = [("covered", covered, "$ink")]
    for index, (camera_id, camera) in enumerate(reconstruction.cameras.items()):
        rows.append((label(camera_id), sight_intervals(camera), camera_colour(index)))
    data = [_bars(name, intervals, colour) for name, intervals, colour in rows]
    bars_px, certainty_px = 26 * len(rows), 110
    layout: Figure = {
        "margin": {"l": 8, "r": 12, "t": 8, "b": 40},
        "showlegend": False,
        "hovermode": "closest",
        "height": bars_px + 60,
        "xaxis": {"title": {"text": "time [s]"}, "anchor": "y"},
        "yaxis": {
            "type": "category",
            "categoryorder": "array",
            "categoryarray": [name for name, _, _ in rows],
            "autorange": "reversed",
            "range": [len(rows) - 0.4, -0.6],
            "fixedrange": True,
            "showgrid": False,
        },
    }
    layout["yaxis"]["autorange"] = False
    if np.isfinite(path.sigma).any():
        columns = path_columns(path)
        share = bars_px / (bars_px + certainty_px)
        layout["height"] += certainty_px
        layout["yaxis"]["domain"] = [1 - share, 1]
        layout["xaxis"]["anchor"] = "y2"
        layout["yaxis2"] = {
            "domain": [0, 0.92 * (1 - share)],
            "title": {"text": f"deviation [{unit}]"},
            "type": "log",
            "fixedrange": True,
            "nticks": 4,
        }
        data.append(
            {
                "type": "scatter",
                "mode": "lines",
                "x": columns["time"],
                "y": columns["sigma"],
                "yaxis": "y2",
                "line": {"width": 1.5, "color": "$accent"},
                "hovertemplate": f"%{{x:.2f}} s: ± %{{y:.2~r}} {unit}<extra></extra>",
            }
        )
    return {"data": data, "layout": layout}


def _bars(name: str, intervals: FloatArray, colour: str) -> dict[str, Any]:
    ends = np.column_stack([intervals, np.full(len(intervals), np.nan)]).ravel()
    return {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "x": numbers(ends, 1e-3),
        "y": [None if np.isnan(end) else name for end in ends],
        "line": {"width": 14, "color": colour},
        "hovertemplate": "%{y}: %{x:.2f} s<extra></extra>",
    }
