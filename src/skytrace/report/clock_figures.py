"""The figures about the cameras' clocks as plotly's JSON: offsets and their deviations, rates, readout times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from skytrace.model.reconstruction import Reconstruction
from skytrace.report.figures import Figure, label, row_axis, significant
from skytrace.report.tables import finite
from skytrace.report.theme import camera_colour
from skytrace.report.words import with_deviation

_PPM = 1e6
_MS = 1e3


def clock_figures(reconstruction: Reconstruction, summary: Mapping[str, Any]) -> dict[str, Figure]:
    """Figures by name: offset, deviation, rate, readout; a row for each camera, from top to bottom.

    Rates are relative to the frame rate given, or to the reference's clock where the summary does not tell it.
    """
    cameras = list(reconstruction.cameras.values())
    names = [label(camera_id) for camera_id in reconstruction.cameras]
    given_hz = [_given_hz(summary, camera_id) for camera_id in reconstruction.cameras]
    offset = np.array([c.clock.offset_s for c in cameras])
    offset_sd = np.array([c.clock_deviation.offset_s for c in cameras])
    period = np.array([c.clock.period_s for c in cameras])
    period_sd = np.array([c.clock_deviation.period_s for c in cameras])
    given_s = np.array([np.nan if hz is None else 1 / hz for hz in given_hz])
    rate, rate_sd = _PPM * (given_s / period - 1), _PPM * period_sd / period
    readout = np.array([_MS * c.clock.readout_s for c in cameras])
    readout_sd = np.array([_MS * c.clock_deviation.readout_s for c in cameras])
    return {
        "offset": _bars(names, offset, [f"{with_deviation(*v)} s" for v in zip(offset, offset_sd, strict=True)], "s"),
        "deviation": _bars(names, _MS * offset_sd, [f"± {_MS * v:.2g} ms" for v in offset_sd], "ms"),
        "rate": _points(names, rate, rate_sd, "ppm"),
        "readout": _points(names, readout, readout_sd, "ms"),
    }


def _given_hz(summary: Mapping[str, Any], camera_id: str) -> float | None:
    value = (summary.get("cameras") or {}).get(camera_id, {}).get("frame_rate_given_hz")
    return value if finite(value) else None


def _bars(names: Sequence[str], value: Any, texts: Sequence[str], unit: str) -> Figure:
    data = {
        "type": "bar",
        "orientation": "h",
        "x": significant(value, 6),
        "y": list(names),
        "width": 0.55,
        "marker": {"color": _colours(names)},
        "text": list(texts),
        "textposition": "none",
        "hovertemplate": "%{y}: %{text}<extra></extra>",
    }
    return {"data": [data], "layout": _layout(names, unit)}


def _points(names: Sequence[str], value: Any, deviation: Any, unit: str) -> Figure:
    data = {
        "type": "scatter",
        "mode": "markers",
        "x": significant(value, 6),
        "y": list(names),
        "marker": {"color": _colours(names), "size": 9},
        "error_x": {"type": "data", "array": significant(deviation, 3), "color": "$ink", "thickness": 1.5, "width": 5},
        "text": [f"{with_deviation(v, d)} {unit}" for v, d in zip(value, deviation, strict=True)],
        "hovertemplate": "%{y}: %{text}<extra></extra>",
    }
    return {"data": [data], "layout": _layout(names, unit)}


def _colours(names: Sequence[str]) -> list[str]:
    return [camera_colour(index) for index in range(len(names))]


def _layout(names: Sequence[str], unit: str) -> dict[str, Any]:
    return {
        "margin": {"l": 8, "r": 12, "t": 30, "b": 40},
        "showlegend": False,
        "height": 26 * len(names) + 90,
        "xaxis": {"title": {"text": f"[{unit}]"}, "nticks": 6},
        "yaxis": row_axis(names),
    }
