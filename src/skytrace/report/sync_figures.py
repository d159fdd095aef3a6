"""The figures of a synchronisation as plotly's JSON: clocks over time, and per pair the search and its errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from skytrace.estimation.sync_curves import EpipolarErrors, PairCurves, ScoreCurve, Sight
from skytrace.geometry.arrays import FloatArray, IntArray
from skytrace.report.figures import Figure, interval_bars, label, numbers, row_axis, significant
from skytrace.report.samples import thin
from skytrace.report.theme import camera_colour
from skytrace.report.words import number

_MARGIN = {"l": 8, "r": 12, "t": 8, "b": 40}
_LEGEND = {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"}
_ZOOM_S = 10.0  # around the chosen offset, where the curve keeps every point
_SMALLEST_MRAD, _BINS = 1e-3, 48


def clock_figures(document: Mapping[str, Any], sights: Mapping[str, Sight]) -> list[tuple[str, Figure]]:
    """Titles and timelines: one of each group on the clock of its reference, one of the rest on their own clocks."""
    colours = {c: camera_colour(index) for index, c in enumerate(document["cameras"])}
    figures, shown = [], set()
    for group in document["groups"]:
        clocks = {
            c: (camera["offset_s"], camera["rate"])
            for c, camera in document["cameras"].items()
            if c in group["cameras"] and c in sights
        }
        shown |= set(clocks)
        title = f"time [s] on the clock of {label(group['reference'])}"
        figures.append((f"On the clock of {group['reference']}", _timeline(title, clocks, sights, colours)))
    own = {c: (0.0, 1.0) for c in document["cameras"] if c in sights and c not in shown}
    if own:
        title = "Not tied in: each on a clock of its own"
        figures.append((title, _timeline("time [s] on each camera's own clock", own, sights, colours)))
    return figures


def _timeline(
    title: str, clocks: Mapping[str, tuple[float, float]], sights: Mapping[str, Sight], colours: Mapping[str, str]
) -> Figure:
    data = []
    for c, (offset_s, rate) in clocks.items():
        filmed = offset_s + rate * np.array([sights[c].filmed_s])
        data.append(interval_bars(label(c), filmed, colours[c], 2))
        data.append(interval_bars(label(c), offset_s + rate * sights[c].seen_s, colours[c]))
    layout = {
        "margin": {"l": 8, "r": 12, "t": 30, "b": 44},
        "showlegend": False,
        "hovermode": "closest",
        "height": 26 * len(clocks) + 80,
        "xaxis": {"title": {"text": title}},
        "yaxis": row_axis([label(c) for c in clocks]),
    }
    return {"data": data, "layout": layout}


def score_figure(curves: PairCurves, rivals: Sequence[Mapping[str, float]], max_points: int) -> Figure:
    """The score over all offsets, with the chosen offset, its rivals and what the joint clocks say."""
    curve = curves.curve
    marks = [m for m in (curves.chosen_s, curves.joint_s) if m is not None]
    offset_s, score, overlap_s = broken_curve(curve, summits_kept(curve, marks, max_points))
    top = 1.12 * max(float(curve.score.max()), curve.chance)
    data: list[dict[str, Any]] = [
        {
            "type": "scatter",
            "mode": "lines",
            "name": "score",
            "x": numbers(offset_s, 1e-3),
            "y": significant(score, 4),
            "customdata": numbers(overlap_s, 0.1),
            "line": {"width": 1.2, "color": "$accent"},
            "hovertemplate": "%{x:.1f} s: score %{y:.0f}, %{customdata:.0f} s of overlap<extra></extra>",
            "showlegend": False,
        },
        {
            "type": "scatter",
            "mode": "lines",
            "name": "best by chance",
            "x": numbers(curve.offset_s[[0, -1]], 1e-3),
            "y": significant([curve.chance] * 2, 4),
            "line": {"width": 1.5, "color": "$muted", "dash": "dash"},
            "hovertemplate": "best with one track run backwards: %{y:.0f}<extra></extra>",
        },
    ]
    if rivals:
        at = [r["offset_s"] for r in rivals]
        marker = {"size": 10, "symbol": "triangle-down", "color": "$caution"}
        data.append(_marks(curve, at, "rivals", marker, "rival at %{x:.2f} s"))
    if _apart(curves):
        marker = {"size": 12, "symbol": "x-thin", "line": {"width": 3, "color": "$ink"}}
        data.append(_marks(curve, [curves.joint_s], "by the other pairs", marker, "by the other pairs: %{x:.2f} s"))
    if curves.chosen_s is not None:
        marker = {"size": 12, "symbol": "diamond", "color": "$target", "line": {"width": 1, "color": "$card"}}
        data.append(_marks(curve, [curves.chosen_s], "chosen", marker, "chosen: %{x:.2f} s"))
    layout = {
        "margin": _MARGIN,
        "legend": _LEGEND,
        "hovermode": "closest",
        "xaxis": {"title": {"text": f"offset of {label(curves.camera1)} from {label(curves.camera0)} [s]"}},
        "yaxis": {"title": {"text": "score"}, "range": [0, significant([top], 3)[0]]},
    }
    return {"data": data, "layout": layout}


def zoom_range_s(curves: PairCurves) -> list[float] | None:
    """Where the chosen offset shows in detail; None without one."""
    if curves.chosen_s is None:
        return None
    return [round(curves.chosen_s - _ZOOM_S, 2), round(curves.chosen_s + _ZOOM_S, 2)]


def summits_kept(curve: ScoreCurve, marks_s: Sequence[float], max_points: int) -> IntArray:
    """Indices of about `max_points` points, the highest of each stretch, and of all points near the marks."""
    n = len(curve.offset_s)
    if n <= max_points:
        return np.arange(n)
    edges = np.linspace(0, n, max_points + 1).round().astype(np.int64)
    highest = [k + int(np.argmax(curve.score[k:end])) for k, end in pairwise(edges)]
    near = [np.flatnonzero(np.abs(curve.offset_s - mark) <= _ZOOM_S) for mark in marks_s]
    return np.unique(np.concatenate([highest, [0, n - 1], *near])).astype(np.int64)


def broken_curve(curve: ScoreCurve, kept: IntArray) -> FloatArray:
    """Offsets, scores and overlaps (3, m) of the points kept, NaN between those that offsets without a score part."""
    columns = np.stack([curve.offset_s, curve.score, curve.overlap_s])
    part = np.r_[0, np.cumsum(np.diff(curve.offset_s) > 1.5 * curve.step_s)]
    breaks = np.flatnonzero(np.diff(part[kept])) + 1
    return np.insert(columns[:, kept], breaks, np.nan, axis=1)


def _apart(curves: PairCurves) -> bool:
    if curves.joint_s is None:
        return False
    return curves.chosen_s is None or abs(curves.joint_s - curves.chosen_s) > _DISTINCT_S


_DISTINCT_S = 1.0


def _marks(
    curve: ScoreCurve, at_s: Sequence[float | None], name: str, marker: dict[str, Any], hover: str
) -> dict[str, Any]:
    x = np.array([t for t in at_s if t is not None])
    y = [curve.score_at(t) or 0.0 for t in x]  # on the axis where it was not searched
    return {
        "type": "scatter",
        "mode": "markers",
        "name": name,
        "x": numbers(x, 1e-3),
        "y": significant(y, 4),
        "marker": marker,
        "cliponaxis": False,
        "hovertemplate": hover + "<extra></extra>",
    }


def error_time_figure(errors: EpipolarErrors, camera0: str, max_points: int) -> Figure:
    """Epipolar errors over time on a logarithmic axis, before and after the refinement."""
    shown = thin(len(errors.time_s), max_points)
    data = []
    for name, values, marker in _kinds(errors):
        points = {"x": numbers(errors.time_s[shown], 0.1), "y": significant(_mrad(values[shown]), 3)}
        hover = "%{x:.1f} s: %{y:.2~r} mrad<extra></extra>"
        data.append({"type": "scatter", "mode": "markers", "name": name, **points, "marker": marker})
        data[-1]["hovertemplate"] = hover
    layout = {
        "margin": _MARGIN,
        "legend": _LEGEND,
        "hovermode": "closest",
        "xaxis": {"title": {"text": f"time [s] of {label(camera0)}"}},
        "yaxis": {"title": {"text": "epipolar error [mrad]"}, "type": "log", "dtick": 1, "range": _log_range(errors)},
    }
    return {"data": data, "layout": layout}


def error_histogram_figure(errors: EpipolarErrors) -> Figure:
    """How many epipolar errors are how large, on a logarithmic axis, before and after the refinement."""
    low, high = _log_range(errors)
    edges = np.linspace(low, high, _BINS + 1)
    data: list[dict[str, Any]] = []
    for name, values, marker in _kinds(errors):
        known = np.log10(_mrad(values[np.isfinite(values)]))
        counts = np.histogram(np.clip(known, low, high), edges)[0] / max(len(known), 1)
        data.append(
            {
                "type": "scatter",
                "mode": "lines",
                "name": f"{name}, median {number(float(np.median(_mrad(values[np.isfinite(values)]))), 2)}",
                "x": significant(10 ** np.r_[edges[0], 0.5 * (edges[1:] + edges[:-1]), edges[-1]], 4),
                "y": significant(np.r_[counts[0], counts, counts[-1]], 3),
                "line": {"width": 2, "color": marker["color"], "shape": "hvh"},
                "fill": "tozeroy",
                "hoverinfo": "skip",
            }
        )
    layout = {
        "margin": _MARGIN,
        "legend": _LEGEND,
        "hovermode": "closest",
        "xaxis": {"title": {"text": "epipolar error [mrad]"}, "type": "log", "dtick": 1, "range": [low, high]},
        "yaxis": {"title": {"text": "share"}, "rangemode": "tozero", "tickformat": ".0%"},
    }
    return {"data": data, "layout": layout}


def _kinds(errors: EpipolarErrors) -> list[tuple[str, FloatArray, dict[str, Any]]]:
    before = {"color": "$faint", "size": 4, "opacity": 0.9}
    after = {"color": "$accent", "size": 4, "opacity": 0.7}
    return [("before", errors.before, before), ("after", errors.after, after)]


def _mrad(errors: FloatArray) -> FloatArray:
    return np.maximum(1e3 * errors, _SMALLEST_MRAD)


def _log_range(errors: EpipolarErrors) -> list[float]:
    # The smallest errors are a matter of luck, and on a logarithmic axis they would take half of the figure.
    pooled = np.log10(_mrad(np.concatenate([errors.before[np.isfinite(errors.before)], errors.after])))
    low, high = np.percentile(pooled, 1), pooled.max()
    return [round(float(low) - 0.2, 2), round(float(high) + 0.15, 2)]
