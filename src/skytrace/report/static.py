"""Pictures for papers: what the report of a run shows, drawn once and for good with matplotlib.

Everything drawn is taken from the page's own data, so that both show the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.report.theme import SCHEMES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

Data = Mapping[str, Any]
DPI = 200
_COLOURS = SCHEMES["light"]
_STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": _COLOURS["faint"],
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": _COLOURS["grid"],
    "grid.linewidth": 0.6,
    "xtick.color": _COLOURS["muted"],
    "ytick.color": _COLOURS["muted"],
    "legend.frameon": False,
}


def pictures(data: Data) -> dict[str, bytes]:
    """PNG files by name, of the data that the report of a run holds.

    overview (in 3D), trajectory (from above and from the side), residuals, clocks, and where the report tells of the
    truth the error along the track. Lengths are in metres where the run or the truth tells the scale. Raises
    ImportError where matplotlib is not installed.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure as Drawing

    drawers: dict[str, Callable[[Drawing, Data], None]] = {
        "overview.png": _overview,
        "trajectory.png": _views,
        "residuals.png": _residuals,
        "clocks.png": _clocks,
    }
    if "truth" in data:
        drawers["error.png"] = _error
    files = {}
    with mpl.rc_context({**mpl.rcParamsDefault, **_STYLE}):
        for name, drawer in drawers.items():
            drawing = Drawing(layout="constrained")
            drawer(drawing, data)
            file = BytesIO()
            # Without the date and the version, the same run gives the same file.
            drawing.savefig(file, format="png", dpi=DPI, bbox_inches="tight", metadata={"Software": None})
            files[name] = file.getvalue()
    return files


def _floats(values: Sequence[float | None]) -> FloatArray:
    return np.array([np.nan if value is None else value for value in values], float)


def _plain(text: str) -> str:
    """A text in which matplotlib finds no formulae."""
    return text.replace("$", r"\$")


def _points(trace: Data) -> FloatArray:
    return np.column_stack([_floats(trace[axis]) for axis in "xyz"])


def _scale(data: Data) -> tuple[float, str]:
    """Metres, or the arbitrary unit, per unit of the page's lengths."""
    scale = data.get("truth", {}).get("scale", 1.0)
    return scale, "m" if "truth" in data else data["unit"]


def _scene(data: Data) -> tuple[FloatArray, FloatArray | None, list[tuple[FloatArray, str]], Data, str]:
    """Path (n, 3), true path, camera frustums with their colours, the trace of names, and the unit of length."""
    scale, unit = _scale(data)
    path, truth, frustums, names = np.zeros((0, 3)), None, [], {}
    for trace in data["scene"]["data"]:
        meta, points = trace.get("meta"), scale * _points(trace)
        if meta == "path":
            path = points
        elif meta == "truth":
            truth = points
        elif trace["name"] == "cameras":
            names = {"at": points, "text": [_plain(text) for text in trace["text"]]}
        elif meta is None:
            frustums.append((points, trace["line"]["color"]))
    return path, truth, frustums, names, unit


def _segments(points: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Line pieces (m, 2, d) between neighbouring points (n, d) that are both known, and their values (m,)."""
    pieces = np.stack([points[:-1], points[1:]], axis=1)
    known = np.isfinite(pieces).all(axis=(1, 2))
    return pieces[known], values[:-1][known]


def _limits(path: FloatArray, names: Data) -> tuple[FloatArray, FloatArray]:
    shown = np.concatenate([path[np.isfinite(path).all(axis=1)], names["at"]])
    low, high = shown.min(axis=0), shown.max(axis=0)
    margin = 0.06 * float(np.linalg.norm(high - low))
    return low - margin, high + margin


def _overview(drawing: Drawing, data: Data) -> None:
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    path, truth, frustums, names, unit = _scene(data)
    drawing.set_size_inches(7.5, 5.0)
    # In the order given: matplotlib's own would lay lines as a whole before or behind each other.
    axes: Any = drawing.add_subplot(projection="3d", computed_zorder=False)
    if truth is not None:
        axes.plot(*truth.T, color=_COLOURS["faint"], linewidth=0.6, label="truth", zorder=1)
        axes.legend(loc="upper left", bbox_to_anchor=(0.12, 0.85), frameon=True, edgecolor="none", framealpha=1)
    pieces, time_s = _segments(path, _floats(data["path"]["time"]))
    if len(pieces):
        lines = Line3DCollection(list(pieces), array=time_s, cmap=_map(data), linewidth=1.3, zorder=2)
        axes.add_collection3d(lines)
        drawing.colorbar(lines, ax=axes, label="time [s]", shrink=0.6, pad=0.08, aspect=30)
    for points, colour in frustums:
        axes.plot(*points.T, color=colour, linewidth=1.0, zorder=3)
    for at, text in zip(names["at"], names["text"], strict=True):
        axes.text(*at, text, fontsize=8, color=_COLOURS["ink"], ha="center", va="top", zorder=4)
    low, high = _limits(path, names)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low, zoom=1.25)
    axes.view_init(elev=24, azim=-66)
    axes.set(xlabel=f"right [{unit}]", ylabel=f"forward [{unit}]", zlabel=f"up [{unit}]")
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
        axis.label.set_color(_COLOURS["muted"])


def _map(data: Data) -> Any:
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("time", [(at, colour) for at, colour in data["themes"]["light"]["scale"]])


def _views(drawing: Drawing, data: Data) -> None:
    from matplotlib.collections import LineCollection

    path, truth, frustums, names, unit = _scene(data)
    low, high = _limits(path, names)
    width, depth, height = high - low
    drawing.set_size_inches(6.5, min(max(6.5 * (depth + height) / width + 1.2, 4.0), 9.0))
    panels = drawing.subplots(2, 1, sharex=True, height_ratios=(depth, height))
    lines: Any = None
    for panel, (up, title) in zip(panels, ((1, "forward"), (2, "up")), strict=True):
        across = (0, up)
        if truth is not None:
            panel.plot(*truth[:, across].T, color=_COLOURS["faint"], linewidth=0.8, label="truth", zorder=1)
        pieces, time_s = _segments(path[:, across], _floats(data["path"]["time"]))
        if len(pieces):
            lines = panel.add_collection(LineCollection(list(pieces), array=time_s, cmap=_map(data), linewidth=1.1))
        for points, colour in frustums:
            panel.plot(*points[:, across].T, color=colour, linewidth=0.9)
        for at, text in zip(names["at"], names["text"], strict=True):
            panel.annotate(text, at[[0, up]], (0, -11), textcoords="offset points", ha="center", fontsize=7)
        panel.set(xlim=(low[0], high[0]), ylim=(low[up], high[up]), aspect="equal", ylabel=f"{title} [{unit}]")
    panels[1].set_xlabel(f"right [{unit}]")
    if truth is not None:
        panels[0].legend(loc="best")
    if lines is not None:
        drawing.colorbar(lines, ax=panels, label="time [s]", location="top", aspect=50)


def _error(drawing: Drawing, data: Data) -> None:
    from matplotlib.ticker import FormatStrFormatter

    drawing.set_size_inches(7.0, 2.6)
    axes = drawing.subplots()
    for trace in data["truth"]["error"]["data"]:
        x, y = _floats(trace["x"]), _floats(trace["y"])
        if trace["mode"] == "markers":
            axes.plot(x, y, ".", markersize=2.5, color=_COLOURS["accent"], label=trace["name"])
        else:
            axes.plot(x, y, linewidth=0.9, color=_COLOURS["ink"], label=trace["name"])
    axes.set(xlabel="time [s]", ylabel="error [cm]", yscale="log", xlim=data["timeline"]["layout"]["xaxis"]["range"])
    axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    axes.legend(ncols=2, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0)


def _residuals(drawing: Drawing, data: Data) -> None:
    cameras = data["cameras"]
    drawing.set_size_inches(7.5, 1.5 * len(cameras) + 0.4)
    grid = drawing.subplots(len(cameras), 2, squeeze=False, width_ratios=(2.2, 1))
    for row, camera in zip(grid, cameras, strict=True):
        _residuals_over_time(row[0], camera, data["timeline"]["layout"]["xaxis"]["range"])
        _residual_histogram(row[1], camera)
    grid[-1][0].set_xlabel("time [s]")
    grid[-1][1].set_xlabel("projected minus measured [px]")
    grid[0][1].legend(fontsize=6, loc="upper right", handlelength=1.2)


def _residuals_over_time(axes: Axes, camera: Data, range_s: Sequence[float]) -> None:
    from matplotlib.ticker import FormatStrFormatter

    for trace in camera["figures"]["time"]["data"]:
        x, y = _floats(trace["x"]), _floats(trace["y"])
        if trace["mode"] == "lines":
            axes.plot(x, y, color=_COLOURS["ink"], linewidth=1.0)
        else:
            colour = _named(trace["marker"]["color"])
            axes.plot(x, y, ".", markersize=1.5, color=colour, alpha=0.6)
    low, high = camera["figures"]["time"]["layout"]["yaxis"].get("range", (-1, 1))
    axes.set(yscale="log", xlim=range_s, ylim=(10**low, 10**high), ylabel=f"{_plain(camera['id'][:18])} [px]")
    axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))


def _residual_histogram(axes: Axes, camera: Data) -> None:
    for trace in camera["figures"]["histogram"]["data"]:
        line = trace["line"]
        style = ":" if line.get("dash") else "-"
        step = "steps-mid" if line.get("shape") else "default"
        x, y = _floats(trace["x"]), _floats(trace["y"])
        axes.plot(x, y, style, drawstyle=step, color=_named(line["color"]), linewidth=1.0, label=trace["name"])
    axes.set_ylim(bottom=0)
    axes.set_yticks([])


def _named(colour: str) -> str:
    return _COLOURS[colour[1:]] if colour.startswith("$") else colour


def _clocks(drawing: Drawing, data: Data) -> None:
    titles = {
        "offset": "offset [s]",
        "deviation": "deviation of the offset [ms]",
        "rate": "frame rate against the one given [ppm]",
        "readout": "readout time [ms]",
    }
    n = len(data["cameras"])
    drawing.set_size_inches(7.0, 2 * (0.24 * n + 0.7))
    grid = drawing.subplots(2, 2, sharey=True)
    for axes, (name, title) in zip(grid.ravel(), titles.items(), strict=True):
        trace = data["clocks"][name]["data"][0]
        value, place, colours = _floats(trace["x"]), np.arange(n), trace["marker"]["color"]
        if trace["type"] == "bar":
            axes.barh(place, value, height=0.55, color=colours)
        else:
            deviation = _floats(trace["error_x"]["array"])
            axes.errorbar(value, place, xerr=deviation, fmt="none", ecolor=_COLOURS["ink"], elinewidth=1, capsize=3)
            axes.scatter(value, place, color=colours, s=22, zorder=3)
        axes.set_xlabel(title)
        axes.set_yticks(place, [_plain(name) for name in trace["y"]])
        axes.set_ylim(n - 0.4, -0.6)
