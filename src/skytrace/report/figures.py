"""The figures about the flight as plotly's JSON: the 3D picture and the timeline. Pure functions of a reconstruction.

Colours written "$name" are named in theme.py and put in by the page, which knows the reader's colour scheme.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.projection import project
from skytrace.geometry.rigid import Rigid
from skytrace.io.run_folder import SUPPORT_S
from skytrace.model.reconstruction import CameraEstimate, Reconstruction
from skytrace.report.picture import frustum_lines
from skytrace.report.samples import PathSamples, sight_intervals
from skytrace.report.theme import camera_colour

Figure = dict[str, Any]
PATH, TARGET, SIGHT, TRUTH = (
    "path",
    "target",
    "sight",
    "truth",
)  # the traces that the page's script looks for, by their `meta`


def numbers(values: Iterable[float], step: float) -> list[float | None]:
    """Values rounded to a power of ten, at most 1, not above `step`; None (a gap in plotly) where not finite."""
    decimals = decimals_for(step)
    array = np.round(np.asarray(values, float), decimals)
    if decimals == 0:
        return [int(v) if np.isfinite(v) else None for v in array.tolist()]
    return [v if np.isfinite(v) else None for v in array.tolist()]


def decimals_for(step: float) -> int:
    """How many decimals, none or more, tell values `step` apart."""
    return max(0, int(np.ceil(-np.log10(step) - 1e-9)))


def significant(values: Iterable[float], digits: int = 4) -> list[float | None]:
    """Values to so many significant digits, None where they are not finite."""
    return [float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in np.asarray(values, float).tolist()]


def resolution(points: FloatArray) -> float:
    """A length that does not show in a picture of points (n, 3): 1e-5 of their extent."""
    return 1e-5 * (float(np.ptp(points, axis=0).max()) or 1.0) if len(points) else 1e-5


def label(camera_id: str, longest: int = 18) -> str:
    """A camera's name as plotly's labels take it: short, and not read as markup.

    Its 2D and 3D labels agree on tags but not on escapes, so angle brackets give way to their look-alikes.
    """
    short = camera_id if len(camera_id) <= longest else camera_id[: longest - 1] + "…"
    return short.replace("<", "‹").replace(">", "›")


def broken(path: PathSamples, values: ArrayLike) -> FloatArray:
    """Values (n, ...) of the path's samples with a row of NaN between segments, so that lines break there."""
    return np.insert(np.asarray(values, float), np.flatnonzero(np.diff(path.segment)) + 1, np.nan, axis=0)


def path_columns(path: PathSamples) -> dict[str, list[float | None]]:
    """The path's samples by name, one row of None between segments."""
    step = resolution(path.position)

    x, y, z = broken(path, path.position).T
    return {
        "time": numbers(broken(path, path.time_s), 1e-3),
        "x": numbers(x, step),
        "y": numbers(y, step),
        "z": numbers(z, step),
        "speed": significant(broken(path, path.speed)),
        "sigma": significant(broken(path, path.sigma), 3),
        "cameras": numbers(broken(path, path.n_cameras), 1),
        "segment": numbers(broken(path, path.segment + 1), 1),
    }


def projected_columns(path: PathSamples, camera: CameraEstimate) -> dict[str, list[float | None]]:
    """Where a camera sees the path, whole pixels row by row as in `path_columns`; None where it has no sight of it."""
    lens, time_s = camera.refined, path.time_s
    xy = project(
        camera.camera_from_world.apply(path.position), lens.focal_px, lens.principal_px, lens.distortion, lens.model
    )
    intervals = sight_intervals(camera)
    last = np.searchsorted(intervals[:, 0] - SUPPORT_S, time_s, side="right") - 1
    seen = (last >= 0) & (time_s <= np.append(intervals[:, 1], -np.inf)[last] + SUPPORT_S)
    x, y = broken(path, np.where(seen[:, None], xy, np.nan)).T
    return {"x": numbers(x, 1), "y": numbers(y, 1)}


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
        if not high > low:
            low, high = low - 0.5, high + 0.5
        first, last = significant((low, high))
        choices.append({"key": key, "label": title, "min": first, "max": last})
    return choices


def scene_figure(
    reconstruction: Reconstruction,
    path: PathSamples,
    picture_from_world: Rigid,
    unit: str,
) -> Figure:
    """The flight and its cameras in 3D, in the picture's frame; the script adds colours, hover texts, target."""
    centres = np.array([c.camera_from_world.centre for c in reconstruction.cameras.values()])
    everything = picture_from_world.apply(np.concatenate([path.position, centres]))
    step = resolution(everything)
    depth = 0.05 * float(np.linalg.norm(np.ptp(everything, axis=0))) or 1.0

    line = broken(path, picture_from_world.apply(path.position))
    data = [_lines(line, step, "trajectory", meta=PATH, showlegend=False, line={"width": 5, "color": "$accent"})]
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
        "scene": {**axes, "aspectmode": "data", "dragmode": "turntable", "domain": {"y": [0, 0.9]}},
        "legend": {"orientation": "h", "x": 0, "y": 0, "yanchor": "bottom", "itemsizing": "constant"},
        "uirevision": "keep the reader's view",
    }
    return {"data": data, "layout": layout}


def truth_trace(true_path: FloatArray, step: float) -> dict[str, Any]:
    """The true path (n, 3) in the picture's frame, NaN where it is unknown."""
    return _lines(true_path, step, "truth", meta=TRUTH, line={"width": 2, "color": "$muted"}, hoverinfo="skip")


_WAYS = ("right", "forward", "up")
_UP, _LEVEL = {"x": 0, "y": 0, "z": 1}, {"x": 0, "y": 1, "z": 0}
VIEWS: dict[str, Any] = {
    "overview": {"eye": {"x": -0.7, "y": -1.6, "z": 0.8}, "up": _UP, "center": {"x": 0, "y": 0, "z": -0.1}},
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


def time_range_s(reconstruction: Reconstruction) -> list[float]:
    """First and last time, with a margin, of anything that is covered or was used."""
    times = [c.residuals.time_s for c in reconstruction.cameras.values()]
    times += [np.array([s.begin_s, s.end_s]) for s in reconstruction.trajectory.segments]
    pooled = np.concatenate(times)
    if not len(pooled):
        return [0.0, 1.0]
    margin_s = max(0.01 * float(np.ptp(pooled)), 0.1)
    return [round(float(pooled.min()) - margin_s, 3), round(float(pooled.max()) + margin_s, 3)]


def timeline_figure(reconstruction: Reconstruction, path: PathSamples, unit: str) -> Figure:
    """When each camera saw the target, against what is covered and how certain the position is."""
    covered = np.array([[s.begin_s, s.end_s] for s in reconstruction.trajectory.segments]).reshape(-1, 2)
    rows = [("covered", covered, "$ink")]
    for index, (camera_id, camera) in enumerate(reconstruction.cameras.items()):
        rows.append((label(camera_id), sight_intervals(camera), camera_colour(index)))
    data = [interval_bars(name, intervals, colour) for name, intervals, colour in rows]
    bars_px, certainty_px = 26 * len(rows), 110
    layout: Figure = {
        "margin": {"l": 8, "r": 12, "t": 30, "b": 40},
        "showlegend": False,
        "hovermode": "closest",
        "height": bars_px + 80,
        "xaxis": {"title": {"text": "time [s]"}, "anchor": "y", "range": time_range_s(reconstruction)},
        "yaxis": row_axis([name for name, _, _ in rows]),
    }
    if np.isfinite(path.sigma).any():
        share = bars_px / (bars_px + certainty_px)
        layout["height"] += certainty_px
        layout["yaxis"]["domain"] = [1 - share, 1]
        layout["xaxis"]["anchor"] = "y2"
        layout["yaxis2"] = {
            "domain": [0, 0.9 * (1 - share)],
            "title": {"text": f"± [{unit}]"},
            "range": [0, 1.5 * float(np.nanpercentile(path.sigma, 98)) or 1.0],
            "fixedrange": True,
            "nticks": 5,
        }
        data.append(_certainty(path, unit))
    return {"data": data, "layout": layout}


def _certainty(path: PathSamples, unit: str) -> dict[str, Any]:
    columns = path_columns(path)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": columns["time"],
        "y": columns["sigma"],
        "yaxis": "y2",
        "line": {"width": 1.5, "color": "$accent"},
        "hovertemplate": f"%{{x:.2f}} s: ± %{{y:.2~r}} {unit}<extra></extra>",
    }


def interval_bars(name: str, intervals: FloatArray, colour: str, width_px: int = 14) -> dict[str, Any]:
    """Intervals (k, 2) of time as bars on the row of that name."""
    ends = np.column_stack([intervals, np.full(len(intervals), np.nan)]).ravel()
    return {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "x": numbers(ends, 1e-3),
        "y": [None if np.isnan(end) else name for end in ends],
        "line": {"width": width_px, "color": colour},
        "hovertemplate": "%{y}: %{x:.2f} s<extra></extra>",
    }


def row_axis(names: Sequence[str]) -> dict[str, Any]:
    """The axis of rows of bars, from top to bottom."""
    return {
        "type": "category",
        "categoryorder": "array",
        "categoryarray": list(names),
        "range": [len(names) - 0.4, -0.6],
        "fixedrange": True,
        "showgrid": False,
    }
