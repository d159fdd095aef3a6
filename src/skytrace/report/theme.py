"""Colours of the figures in light and in dark surroundings. The page's own colours are in page.css."""

from __future__ import annotations

from typing import Any

# Of medium luminance, so that each stands out from the light and from the dark background alike.
CAMERA_COLOURS = (
    "#3a81d7",
    "#d67523",
    "#25984d",
    "#c46dbd",
    "#977e0d",
    "#0f9ea5",
    "#ca545a",
    "#927fe7",
    "#6c8e03",
    "#18a287",
    "#008cba",
    "#d76797",
)
FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif"

# A figure writes "$ink" where it means the colour of that name; the page puts in the one of the reader's scheme.
SCHEMES: dict[str, dict[str, str]] = {
    "light": {
        "ink": "#16202a",
        "muted": "#5b6875",
        "faint": "#a9b3be",
        "grid": "#dde2e8",
        "card": "#ffffff",
        "accent": "#0b62b8",
        "target": "#c4291c",
        "caution": "#a96d00",
    },
    "dark": {
        "ink": "#e6eaf0",
        "muted": "#9aa7b5",
        "faint": "#5d6a78",
        "grid": "#303944",
        "card": "#1a2028",
        "accent": "#6cb2f5",
        "target": "#ff7a6b",
        "caution": "#e0a63a",
    },
}

# The parts of one perceptually uniform scale that are readable on each background.
_SCALES = {
    "light": ("#0d0887", "#46039f", "#7201a8", "#9c179e", "#bd3786", "#d8576b", "#ed7953"),
    "dark": ("#a2209a", "#bd3786", "#d8576b", "#ed7953", "#fb9f3a", "#fdca26", "#f0f921"),
}


def camera_colour(index: int) -> str:
    """The colour of the camera at a place in the list."""
    return CAMERA_COLOURS[index % len(CAMERA_COLOURS)]


def themes() -> dict[str, dict[str, Any]]:
    """For each scheme its named colours, its colour scale and the plotly template made of them."""
    return {
        name: {"colours": colours, "scale": _scale(name), "template": {"layout": _template(colours)}}
        for name, colours in SCHEMES.items()
    }


def _scale(scheme: str) -> list[list[float | str]]:
    stops = _SCALES[scheme]
    return [[round(k / (len(stops) - 1), 4), colour] for k, colour in enumerate(stops)]


def _template(colours: dict[str, str]) -> dict[str, Any]:
    lines = {"gridcolor": colours["grid"], "linecolor": colours["faint"], "zerolinecolor": colours["grid"]}
    axis = {**lines, "automargin": True, "tickcolor": colours["faint"]}
    scene_axis = {**lines, "showbackground": False, "color": colours["muted"], "showspikes": False}
    return {
        "font": {"family": FONT, "size": 13, "color": colours["ink"]},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "xaxis": axis,
        "yaxis": axis,
        "scene": {"xaxis": scene_axis, "yaxis": scene_axis, "zaxis": scene_axis},
        "hoverlabel": {
            "bgcolor": colours["card"],
            "bordercolor": colours["faint"],
            "font": {"family": FONT, "color": colours["ink"]},
        },
        "modebar": {"bgcolor": "rgba(0,0,0,0)", "color": colours["faint"], "activecolor": colours["accent"]},
    }
