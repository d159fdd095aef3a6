"""The figures about one camera's reprojection errors as plotly's JSON: over time, as a distribution, over the image."""

from __future__ import annotations

from typing import Any

import numpy as np

from skytrace.geometry.arrays import BoolArray, FloatArray, IntArray
from skytrace.model.reconstruction import CameraEstimate
from skytrace.report.figures import Figure, numbers, significant
from skytrace.report.samples import MAX_RESIDUALS, error_field, error_histogram, running_median, thin
from skytrace.report.words import number

_MARGIN = {"l": 8, "r": 12, "t": 8, "b": 40}
_LEGEND = {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"}
_FRAME = {"zeroline": False, "showline": True, "mirror": True}
_PIXEL_STEP = 0.1
_SMALLEST_PX = 1e-9  # what a logarithmic axis shows of an error of zero


def residual_figures(camera: CameraEstimate, colour: str, range_s: list[float]) -> dict[str, Figure]:
    """The three figures of a camera by name: time, histogram, image."""
    shown = thin(len(camera.residuals.frame), MAX_RESIDUALS)
    return {
        "time": time_figure(camera, colour, range_s, shown),
        "histogram": histogram_figure(camera, colour),
        "image": image_figure(camera, colour, shown),
    }


def time_figure(camera: CameraEstimate, colour: str, range_s: list[float], shown: IntArray) -> Figure:
    """Error lengths over time on a logarithmic axis, with the running median of those that agree."""
    residuals = camera.residuals
    length = np.maximum(np.linalg.norm(residuals.error_px[shown], axis=1), _SMALLEST_PX)
    data = []
    for name, chosen, marker in _kinds(residuals.inlier[shown], colour):
        points = {"x": numbers(residuals.time_s[shown][chosen], 1e-3), "y": significant(length[chosen], 3)}
        data.append(_points(points, name, marker, "%{x:.2f} s: %{y:.2~r} px"))
    middle_s, median_px = running_median(residuals)
    data.append(
        {
            "type": "scatter",
            "mode": "lines",
            "name": "running median",
            "x": numbers(middle_s, 1e-2),
            "y": significant(median_px, 3),
            "line": {"width": 2, "color": "$ink"},
            "hovertemplate": "%{x:.1f} s: median %{y:.2~r} px<extra></extra>",
        }
    )
    layout = {
        "margin": _MARGIN,
        "legend": _LEGEND,
        "hovermode": "closest",
        "xaxis": {"title": {"text": "time [s]"}, "range": range_s},
        "yaxis": {"title": {"text": "reprojection error [px]"}, "type": "log", "dtick": 1, **_log_range(length)},
    }
    return {"data": data, "layout": layout}


def _log_range(length_px: FloatArray) -> dict[str, Any]:
    # The smallest errors are a matter of luck, and on a logarithmic axis they would take half of the figure.
    if not len(length_px):
        return {}
    low, high = np.log10(np.percentile(length_px, 0.5)), np.log10(length_px.max())
    return {"range": [round(float(low) - 0.1, 3), round(float(high) + 0.15, 3)]}


def histogram_figure(camera: CameraEstimate, colour: str) -> Figure:
    """How the errors in x and in y are distributed, against the normal distribution of the robust deviation."""
    sigma = camera.sigma_px if camera.sigma_px > 0 else 1.0
    reach = 6 * sigma
    centre, density = error_histogram(camera.residuals, reach)
    data: list[dict[str, Any]] = [
        _curve(centre, density[:, axis], f"in {'xy'[axis]}", {"color": line, "width": 2, "shape": "hvh"})
        for axis, line in enumerate((colour, "$ink"))
    ]
    normal = np.exp(-0.5 * (centre / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))
    data.append(
        _curve(centre, normal, f"normal, σ {number(sigma, 2)} px", {"color": "$muted", "width": 1.5, "dash": "dot"})
    )
    layout = {
        "margin": _MARGIN,
        "legend": _LEGEND,
        "hovermode": "closest",
        "xaxis": {"title": {"text": "projected minus measured [px]"}},
        "yaxis": {"title": {"text": "share per px"}, "rangemode": "tozero"},
    }
    return {"data": data, "layout": layout}


def image_figure(camera: CameraEstimate, colour: str, shown: IntArray) -> Figure:
    """Where in the image the detections lie, with the magnified mean error of each part of it."""
    residuals, (width, height) = camera.residuals, camera.refined.size_px
    data = []
    for name, chosen, marker in _kinds(residuals.inlier[shown], colour):
        xy = residuals.measured_px[shown][chosen]
        points = {"x": numbers(xy[:, 0], _PIXEL_STEP), "y": numbers(xy[:, 1], _PIXEL_STEP)}
        data.append(_points(points, name, {**marker, "opacity": 0.45}, "%{x:.0f}, %{y:.0f} px"))
    place, error = error_field(residuals, (width, height))
    if len(place):
        data.append(arrows(place, error, width))
    return {"data": data, "layout": image_layout((width, height))}


def arrows(place: FloatArray, error_px: FloatArray, width_px: float) -> dict[str, Any]:
    """Magnified mean errors (m, 2) at places (m, 2) of an image."""
    magnification = arrow_magnification(error_px, width_px)
    strokes = _arrows(place, magnification * error_px)
    return {
        "type": "scatter",
        "mode": "lines",
        "name": f"mean error × {magnification}",
        "x": numbers(strokes[:, 0], _PIXEL_STEP),
        "y": numbers(strokes[:, 1], _PIXEL_STEP),
        "line": {"width": 2, "color": "$ink"},
        "hoverinfo": "skip",
    }


def image_layout(size_px: tuple[int, int]) -> dict[str, Any]:
    """A figure that is a camera's image, its pixels square."""
    width, height = size_px
    return {
        "margin": _MARGIN,
        "legend": _LEGEND,
        "hovermode": "closest",
        "xaxis": {"range": [-0.5, width - 0.5], "constrain": "domain", "title": {"text": "x [px]"}, **_FRAME},
        "yaxis": {
            "range": [height - 0.5, -0.5],
            "constrain": "domain",
            "scaleanchor": "x",
            "title": {"text": "y [px]"},
            **_FRAME,
        },
    }


def arrow_magnification(error_px: FloatArray, width_px: float) -> int:
    """A round factor, 1, 2 or 5 times a power of ten, that makes the longest arrow about an eighth of the image."""
    longest = float(np.linalg.norm(error_px, axis=1).max())
    ratio = width_px / 8 / max(longest, 1e-6)
    return max(digit * 10**power for power in range(10) for digit in (1, 2, 5) if digit * 10**power <= max(ratio, 1.0))


def _arrows(place: FloatArray, vector: FloatArray) -> FloatArray:
    tip = place + vector
    back, side = -0.25 * vector, 0.15 * np.column_stack([-vector[:, 1], vector[:, 0]])
    gap = np.full_like(place, np.nan)
    return np.stack([place, tip, tip + back + side, gap, tip, tip + back - side, gap], axis=1).reshape(-1, 2)


def _kinds(inlier: BoolArray, colour: str) -> list[tuple[str, BoolArray, dict[str, Any]]]:
    agreeing = {"color": colour, "size": 4, "opacity": 0.6}
    contradicting = {"color": "$target", "size": 7, "symbol": "x-thin", "line": {"width": 1.5, "color": "$target"}}
    return [("agrees", inlier, agreeing), ("set aside", ~inlier, contradicting)]


def _points(points: dict[str, Any], name: str, marker: dict[str, Any], hover: str) -> dict[str, Any]:
    extra = {"marker": marker, "hovertemplate": hover + "<extra></extra>"}
    return {"type": "scatter", "mode": "markers", "name": name, **points, **extra}


def _curve(x: FloatArray, y: FloatArray, name: str, line: dict[str, Any]) -> dict[str, Any]:
    values = {"x": significant(x), "y": significant(y)}
    return {"type": "scatter", "mode": "lines", "name": name, **values, "line": line, "hoverinfo": "skip"}
