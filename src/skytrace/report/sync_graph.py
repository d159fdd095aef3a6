"""The cameras as a graph: who is tied to whom, how surely, and whose clock is how far off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.report.figures import Figure, label, numbers
from skytrace.report.theme import camera_colour
from skytrace.report.words import MINUS, number, probability, with_deviation

PAIRS, SELECTED = "pairs", "selected"  # the traces that the page's script looks for, by their `meta`
_LIKELY = 0.5
_KNOB = 0.38  # where along a line its knob sits: off the middle, where opposite lines of a ring would cross
_SIDE, _HEAD, _FOOT = 1.3, 0.9, 0.6  # around a ring, for labels
_CROWD = 8  # more cameras than these have no room for offsets on a phone

Places = dict[str, tuple[FloatArray, FloatArray]]  # camera id -> place (2,), and the direction out of its ring (2,)


def graph_figure(document: Mapping[str, Any], threshold: float, upright: bool) -> Figure:
    """Cameras in rings, one a group and one of those not tied in, side by side or `upright` one above the other.

    Lines are pairs with a plausible offset, wide and coloured by confidence, dotted where they were not used. Beside
    plotly's, the figure has the entries `size`, the width and height of what is drawn, and `ends`, x and y of both ends
    of each pair.
    """
    places, titles, size = _layout(_rings(document), upright)
    pairs = document["pairs"]
    ends = np.array([[places[p["camera0"]][0], places[p["camera1"]][0]] for p in pairs]).reshape(-1, 2, 2)
    data = [_lines(np.zeros((0, 2, 2)), {"width": 14, "color": "$ink"}, meta=SELECTED, opacity=0.25)]
    for name, colour, width, low, high in _classes(threshold):
        inside = np.array([low <= p["confidence"] < high for p in pairs], bool)
        used = np.array([p["accepted"] for p in pairs], bool)
        if (inside & used).any():
            style = {"width": width, "color": colour}
            data.append(_lines(ends[inside & used], style, name=name, showlegend=True))
        if (inside & ~used).any():
            style = {"width": min(width, 2), "color": colour, "dash": "dot"}
            data.append(_lines(ends[inside & ~used], style, name=f"{name}, not used", showlegend=True))
    data.append(_knobs(pairs, ends))
    references = {group["reference"] for group in document["groups"]}
    longest, brief = (12, len(places) > _CROWD) if upright else (18, False)
    for index, (camera_id, camera) in enumerate(document["cameras"].items()):
        caption = f"<b>{label(camera_id, longest)}</b>"
        if not brief and "offset_s" in camera:
            caption += "<br>" + ("reference" if camera_id in references else _offset(camera))
        data.append(_node(caption, camera_id, camera, camera_colour(index), places[camera_id]))
    layout = {
        "margin": {"l": 4, "r": 4, "t": 4, "b": 4},
        "hovermode": "closest",
        "dragmode": False,
        "legend": {"orientation": "h", "x": 0, "y": 0, "yanchor": "top", "itemclick": False, "itemdoubleclick": False},
        "xaxis": {"visible": False, "range": [0, size[0]], "fixedrange": True},
        "yaxis": {"visible": False, "range": [-size[1], 0], "fixedrange": True, "scaleanchor": "x"},
        "annotations": titles,
    }
    return {
        "data": data,
        "layout": layout,
        "buttons": ["toImage"],
        "size": list(size),
        "ends": [numbers(e.ravel(), 1e-3) for e in ends],
    }


def _rings(document: Mapping[str, Any]) -> list[tuple[str, list[str]]]:
    """Titles and cameras of the groups, each in the order given, and of the cameras that are in none."""
    groups = document["groups"]
    rings = [
        (f"on the clock of {label(g['reference'])}", [c for c in document["cameras"] if c in g["cameras"]])
        for g in groups
    ]
    grouped = {c for _, ring in rings for c in ring}
    alone = [c for c in document["cameras"] if c not in grouped]
    return [*rings, ("not tied in", alone)] if alone else rings


def _layout(
    rings: Sequence[tuple[str, list[str]]], upright: bool
) -> tuple[Places, list[dict[str, Any]], tuple[float, float]]:
    """Places of the cameras, titles of the rings as annotations, and width and height of the whole."""
    places: Places = {}
    titles, at, across = [], 0.0, 0.0
    head = _HEAD + 0.4 if len(rings) > 1 else _HEAD
    for title, ring in rings:
        rim, out = _ring(len(ring), upright)
        low, high = rim.min(axis=0), rim.max(axis=0)
        # Upright, rings are scaled down to the width of a phone, and their labels are not.
        room = max(1.0, float(high[1])) if upright else 1.0
        width, height = high - low + [2 * _SIDE * room, (head + _FOOT) * room]
        corner = np.array([0.0, -at]) if upright else np.array([at, 0.0])
        shift = corner + [_SIDE * room - low[0], -head * room - high[1]]
        for camera_id, point, direction in zip(ring, rim, out, strict=True):
            places[camera_id] = point + shift, direction
        if len(rings) > 1:
            top = {"x": float(corner[0] + width / 2), "y": float(corner[1]), "yanchor": "top", "showarrow": False}
            titles.append({**top, "text": title, "font": {"color": "$muted"}, "bgcolor": "$card"})
        along, other = (height, width) if upright else (width, height)
        at, across = at + float(along), max(across, float(other))
    return places, titles, (across, at) if upright else (at, across)


def _ring(n: int, upright: bool) -> tuple[FloatArray, FloatArray]:
    """Places (n, 2) around a centre, the first at the top, and the directions (n, 2) in which their labels stand."""
    # An even ring stands on a side, so that two cameras are beside each other.
    angles = np.pi / 2 + (np.pi / n if n % 2 == 0 else 0.0) - 2 * np.pi * np.arange(n) / n
    out = np.column_stack([np.cos(angles), np.sin(angles)])
    rim = (0.0 if n == 1 else 1.0 + 0.13 * max(n - 3, 0)) * out
    # Labels of one or two cameras keep clear of the lines that come from the other rings.
    if n < 3 and not upright:
        out = np.tile([0.0, 1.0], (n, 1))
    elif n == 1:
        out = np.array([[1.0, 0.0]])
    return rim, out


def _classes(threshold: float) -> list[tuple[str, str, float, float, float]]:
    """Name, colour, width, least confidence and the one below which confidences belong to each class of lines."""
    sure, likely = number(threshold, 2), number(_LIKELY, 1)
    return [
        (f"confidence from {sure}", "$accent", 4.0, threshold, np.inf),
        (f"{likely} to {sure}", "$caution", 2.5, _LIKELY, threshold),
        (f"below {likely}", "$target", 1.5, -np.inf, _LIKELY),
    ]


def _lines(ends: FloatArray, style: dict[str, Any], **attributes: Any) -> dict[str, Any]:
    """Lines (k, 2, 2) between two points each."""
    broken = np.concatenate([ends, np.full((len(ends), 1, 2), np.nan)], axis=1).reshape(-1, 2)
    x, y = (numbers(broken[:, axis], 1e-3) for axis in (0, 1))
    shown = {"showlegend": False, "hoverinfo": "skip", **attributes}
    return {"type": "scatter", "mode": "lines", "x": x, "y": y, "line": style, **shown}


def _knobs(pairs: Sequence[Mapping[str, Any]], ends: FloatArray) -> dict[str, Any]:
    """What a pair is pointed at and chosen by, in the order of the pairs."""
    at = ends[:, 0] + _KNOB * (ends[:, 1] - ends[:, 0])
    return {
        "type": "scatter",
        "mode": "markers",
        "meta": PAIRS,
        "x": numbers(at[:, 0], 1e-3),
        "y": numbers(at[:, 1], 1e-3),
        "text": [_pair_text(pair) for pair in pairs],
        "marker": {"size": 9, "color": "$card", "line": {"width": 1.5, "color": "$muted"}},
        "hovertemplate": "%{text}<extra></extra>",
        "showlegend": False,
    }


def _pair_text(pair: Mapping[str, Any]) -> str:
    return "<br>".join(
        [
            f"<b>{label(pair['camera0'])} – {label(pair['camera1'])}</b>",
            f"offset {with_deviation(pair['offset_s'], pair['offset_sd_s'])} s",
            f"confidence {probability(pair['confidence'])}, {'used' if pair['accepted'] else 'not used'}",
            f"{number(pair['overlap_s'])} s of common view",
        ]
    )


def _offset(camera: Mapping[str, Any]) -> str:
    return f"{camera['offset_s']:+.3f} s".replace("-", MINUS)


def _node(
    caption: str, camera_id: str, camera: Mapping[str, Any], colour: str, place: tuple[FloatArray, FloatArray]
) -> dict[str, Any]:
    at, out = place
    hover, known = [f"<b>{label(camera_id)}</b>"], "offset_s" in camera
    if known:
        hover.append(f"offset {with_deviation(camera['offset_s'], camera['offset_sd_s'])} s")
        hover.append(f"rate {with_deviation(camera['rate'], camera['rate_sd'])}")
        hover.append(f"confidence {probability(camera['confidence'])}")
    else:
        hover.append("not tied in")
    vertical = "middle" if abs(out[1]) < 0.35 else "top" if out[1] > 0 else "bottom"
    horizontal = "center" if abs(out[0]) < 0.35 else "right" if out[0] > 0 else "left"
    return {
        "type": "scatter",
        "mode": "markers+text",
        "x": numbers(at[:1], 1e-3),
        "y": numbers(at[1:], 1e-3),
        "text": [caption],
        "textposition": f"{vertical} {horizontal}",
        "textfont": {"size": 13, "color": "$ink"},
        "marker": {"size": 20, "color": colour if known else "$card", "line": {"width": 3, "color": colour}},
        "hovertext": ["<br>".join(hover)],
        "hovertemplate": "%{hovertext}<extra></extra>",
        "showlegend": False,
    }
