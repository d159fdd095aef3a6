"""The figures of a calibration as plotly's JSON: where boards were seen, and what the lens leaves unexplained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.model.camera import Intrinsics
from skytrace.report.figures import Figure, numbers
from skytrace.report.residual_figures import arrows, image_layout
from skytrace.report.samples import mean_field
from skytrace.report.theme import camera_colour

_PIXEL_STEP = 0.1
_FIELD_COLUMNS, _FIELD_AT_LEAST = 16, 5


@dataclass(frozen=True, eq=False, slots=True)
class DrawnView:
    """The board in one picture."""

    name: str
    xy_px: FloatArray  # (n, 2) corners; none where no board was found
    error_px: FloatArray | None  # (n, 2) predicted less seen, where the view was used
    fate: str  # "used", or why not
    rms_px: float | None
    tilt_deg: float | None


@dataclass(frozen=True, eq=False, slots=True)
class LensPicture:
    """A lens and what it was made from."""

    lens: Intrinsics
    views: tuple[DrawnView, ...]

    @property
    def used(self) -> list[DrawnView]:
        return [view for view in self.views if view.error_px is not None]


def coverage_figure(picture: LensPicture) -> Figure:
    """All corners in the image, a colour a view; crosses where the view was not used."""
    data = []
    for k, view in enumerate(picture.views):
        if not len(view.xy_px):
            continue
        used = view.error_px is not None
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "name": view.name,
                "showlegend": False,
                "x": numbers(view.xy_px[:, 0], _PIXEL_STEP),
                "y": numbers(view.xy_px[:, 1], _PIXEL_STEP),
                "marker": {"size": 5, "color": camera_colour(k), "opacity": 0.75}
                if used
                else {"size": 7, "symbol": "x-thin", "line": {"width": 1.5, "color": "$target"}},
                "hovertemplate": "%{x:.0f}, %{y:.0f} px<extra>%{fullData.name}</extra>",
            }
        )
    return {"data": data, "layout": image_layout(picture.lens.size_px)}


def residual_figure(picture: LensPicture) -> Figure:
    """Mean residuals over the image, magnified: what the lens model does not explain shows as a pattern."""
    xy, error = _stacked([(v.xy_px, v.error_px) for v in picture.used if v.error_px is not None])
    place, mean = mean_field(xy, error, picture.lens.size_px, _FIELD_COLUMNS, _FIELD_AT_LEAST)
    data = [arrows(place, mean, picture.lens.size_px[0])] if len(place) else []
    return {"data": data, "layout": {**image_layout(picture.lens.size_px), "showlegend": True}}


def scatter_figure(picture: LensPicture) -> Figure:
    """Every residual about the origin."""
    data = []
    for k, view in enumerate(picture.views):
        if view.error_px is None:
            continue
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "name": view.name,
                "showlegend": False,
                "x": numbers(view.error_px[:, 0], 1e-3),
                "y": numbers(view.error_px[:, 1], 1e-3),
                "marker": {"size": 4, "color": camera_colour(k), "opacity": 0.6},
                "hovertemplate": "%{x:.2f}, %{y:.2f} px<extra>%{fullData.name}</extra>",
            }
        )
    layout = {
        "margin": {"l": 8, "r": 12, "t": 8, "b": 40},
        "hovermode": "closest",
        "xaxis": {"title": {"text": "predicted less seen, x [px]"}},
        "yaxis": {"title": {"text": "y [px]"}, "scaleanchor": "x", "autorange": "reversed"},
    }
    return {"data": data, "layout": layout}


def _stacked(parts: Sequence[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    if not parts:
        return np.zeros((0, 2)), np.zeros((0, 2))
    return np.concatenate([xy for xy, _ in parts]), np.concatenate([error for _, error in parts])
