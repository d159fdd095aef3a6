"""What is known of the truth, added to the report of a run: the true path, errors along the track, their breakdown."""

from __future__ import annotations

from dataclasses import replace
from html import escape
from typing import Any

import numpy as np

from skytrace.evaluation.cameras import CentreErrors
from skytrace.evaluation.statistics import ErrorGroup, ErrorStatistics
from skytrace.evaluation.summary import Evaluation
from skytrace.evaluation.trajectory import TrajectoryErrors, TrajectoryEvaluation
from skytrace.geometry.arrays import FloatArray
from skytrace.report.container import Parts, take_apart
from skytrace.report.figures import TRUTH, Figure, numbers, resolution, significant, truth_trace
from skytrace.report.page import page_of
from skytrace.report.samples import MAX_TRUTH_SAMPLES, thin
from skytrace.report.tables import cell, table
from skytrace.report.words import number

_BEGIN, _END = "<!-- truth -->", "<!-- end of truth -->"
_CM = 100.0


def add_truth(html: str, evaluation: Evaluation, truth: FloatArray | None = None, rate_hz: float | None = None) -> str:
    """The report of a run with what `evaluation` says of it; what an earlier call added is replaced.

    `truth` (m, 3) in metres at `rate_hz` is the path that it was judged by, NaN where unknown. Raises ValueError where
    the page is not the report of a run that this version wrote.
    """
    parts = without_truth(take_apart(html))
    data, content = parts.data, _tables(evaluation)
    if evaluation.trajectory is not None and truth is not None and rate_hz is not None:
        errors = evaluation.trajectory.complete
        data["truth"] = {"scale": errors.truth_from_world.scale, "error": error_figure(errors, _range_s(data))}
        _add_path(data, errors, truth, rate_hz)
        content = _FIGURE + content
    before, _, after = parts.main.partition(_BEGIN)
    section = f'<section aria-labelledby="truth-title">\n<h2 id="truth-title">{_TITLE}</h2>\n{content}</section>\n'
    _, _, after = after.partition(_END)
    return page_of(replace(parts, main=f"{before}{_BEGIN}\n{section}{_END}{after}"))


_TITLE = "Against the truth"
_FIGURE = """<figure class="scripted">
<div id="truth-error" class="plot" role="group" aria-label="Error along the track"></div>
<figcaption>Distance from the true path, after fitting the truth's clock and a similarity: the truth only judges, the
run never saw it. Line: the posterior standard deviation that the run claims. A click or tap moves the target
there.</figcaption>
</figure>
"""


def without_truth(parts: Parts) -> Parts:
    """The parts of a report without what `add_truth` adds. Raises ValueError where there is no place for it."""
    before, begun, rest = parts.main.partition(_BEGIN)
    _, ended, after = rest.partition(_END)
    data = parts.data
    if not (begun and ended and "picture" in data):
        raise ValueError("not the report of a run that this version of skytrace wrote: reconstruct it again")
    data = {key: value for key, value in data.items() if key != "truth"}
    traces = [trace for trace in data["scene"]["data"] if trace.get("meta") != TRUTH]
    data["scene"] = {**data["scene"], "data": traces}
    data["path"] = {key: values for key, values in data["path"].items() if key != "error"}
    data["colours"] = [choice for choice in data["colours"] if choice["key"] != "error"]
    return Parts(parts.title, f"{before}{_BEGIN}{_END}{after}", data)


def _range_s(data: dict[str, Any]) -> list[float]:
    return data["timeline"]["layout"]["xaxis"]["range"]


def _add_path(data: dict[str, Any], errors: TrajectoryErrors, truth: FloatArray, rate_hz: float) -> None:
    """The true path in the picture, and the errors as a colour of the path."""
    shown = truth[thin(len(truth), MAX_TRUTH_SAMPLES)]
    in_picture = errors.truth_from_world.inverse().apply(shown) @ np.array(data["picture"]).T
    known = in_picture[np.isfinite(in_picture).all(axis=1)]
    data["scene"]["data"].insert(1, truth_trace(in_picture, resolution(known)))
    time_s = np.array([np.nan if t is None else t for t in data["path"]["time"]])
    step_s = errors.clock.scale / rate_hz
    error_cm = _CM * _along(time_s, errors, 1.5 * step_s)
    data["path"]["error"] = significant(error_cm, 3)
    finite = error_cm[np.isfinite(error_cm)]
    if len(finite):
        high = max(float(np.percentile(finite, 98)), 1e-6)
        data["colours"].append({"key": "error", "label": "error [cm]", "min": 0.0, "max": float(f"{high:.4g}")})


def _along(time_s: FloatArray, errors: TrajectoryErrors, gap_s: float) -> FloatArray:
    """Errors (m,) in the truth's unit at times (m,), linear between samples no farther apart than `gap_s`."""
    known_s, error = errors.time_s, errors.error
    after = np.clip(np.searchsorted(known_s, time_s), 1, len(known_s) - 1)
    near = (known_s[after] - known_s[after - 1] <= gap_s) & (time_s >= known_s[0]) & (time_s <= known_s[-1])
    with np.errstate(invalid="ignore"):
        return np.where(near, np.interp(time_s, known_s, error), np.nan)


def error_figure(errors: TrajectoryErrors, range_s: list[float]) -> Figure:
    """The error in cm over time on a logarithmic axis, beside the deviation claimed."""
    shown = thin(len(errors.time_s), MAX_TRUTH_SAMPLES)
    error_cm = _CM * errors.error
    points = {
        "type": "scatter",
        "mode": "markers",
        "name": "error",
        "x": numbers(errors.time_s[shown], 1e-3),
        "y": significant(error_cm[shown], 3),
        "marker": {"size": 4, "color": "$accent"},
        "hovertemplate": "%{x:.2f} s: %{y:.2~r} cm<extra></extra>",
    }
    data, low = [points], np.percentile(error_cm, 1)
    if errors.sigma is not None and np.isfinite(errors.sigma).any():
        claimed_cm = _CM * errors.sigma
        data.append(_claimed(errors.time_s, claimed_cm))
        low = min(low, np.nanmin(claimed_cm))
    bounds = np.log10([max(low, 1e-3), max(float(error_cm.max()), 2e-3)])
    layout = {
        "margin": {"l": 8, "r": 12, "t": 8, "b": 40},
        "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
        "hovermode": "closest",
        "height": 300,
        "xaxis": {"title": {"text": "time [s]"}, "range": range_s},
        "yaxis": {
            "title": {"text": "error [cm]"},
            "type": "log",
            "dtick": 1,
            "range": [round(float(bounds[0]) - 0.1, 3), round(float(bounds[1]) + 0.15, 3)],
        },
    }
    return {"data": data, "layout": layout}


def _claimed(time_s: FloatArray, claimed_cm: FloatArray) -> dict[str, Any]:
    step_s = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 1.0
    breaks = np.flatnonzero(np.diff(time_s) > 2 * step_s) + 1
    return {
        "type": "scatter",
        "mode": "lines",
        "name": "deviation claimed",
        "x": numbers(np.insert(time_s, breaks, np.nan), 1e-3),
        "y": significant(np.insert(claimed_cm, breaks, np.nan), 3),
        "line": {"width": 1.5, "color": "$ink"},
        "hovertemplate": "%{x:.2f} s: ± %{y:.2~r} cm<extra></extra>",
    }


def _tables(evaluation: Evaluation) -> str:
    parts = [_trajectory_table(evaluation.trajectory)] if evaluation.trajectory is not None else []
    if evaluation.centres_aligned is not None:
        parts.append(_centre_table(evaluation.centres_aligned))
    if evaluation.orientations is not None:
        angles = evaluation.orientations.error_deg.items()
        rows = [(cell(camera), [cell(number(angle))]) for camera, angle in angles]
        headers = ("camera orientation, aligned by the orientations", "error [°]")
        parts.append(table("Errors of the camera orientations", headers, rows))
    if evaluation.synchronisation is not None:
        errors = evaluation.synchronisation
        rows = [(cell(c), [cell(number(1e3 * e.mean_s)), cell(number(1e3 * e.max_s))]) for c, e in errors.error.items()]
        parts.append(table("Errors of the clocks", (f"clock against {errors.base}", "mean [ms]", "largest [ms]"), rows))
    notes = "".join(f"<li>{escape(note)}</li>\n" for note in evaluation.notes)
    return "\n".join(parts) + (f"\n<ul>\n{notes}</ul>\n" if notes else "\n")


def _trajectory_table(found: TrajectoryEvaluation) -> str:
    complete, kept = found.complete, found.without_large
    rows = [_row("all covered samples", complete.statistics)]
    rows.append(_row(f"{kept.n_dropped} above 10 × mean left out", kept.statistics))
    rows += [_row(f"seen by {_cameras(group)}", group.statistics) for group in complete.by_n_cameras]
    rows += [_row(_deviation(group), group.statistics) for group in complete.by_sigma]
    if complete.velocity is not None:
        rows.append(_row("velocity, in cm/s", complete.velocity))
    headers = ("error [cm]", "mean", "RMSE", "median", "largest", "above 3 RMSE", "samples")
    return table("Errors of the trajectory", headers, rows)


def _row(name: str, s: ErrorStatistics) -> tuple[str, list[str]]:
    lengths = (number(_CM * value) for value in (s.mean, s.rmse, s.median, s.max))
    return cell(name), [*map(cell, lengths), cell(f"{s.outlier_percent:.1f} %"), cell(f"{s.n:,}")]


def _cameras(group: ErrorGroup) -> str:
    return f"{group.low:.0f} camera{'' if group.low == 1 else 's'}"


def _deviation(group: ErrorGroup) -> str:
    return f"deviation {number(_CM * group.low)} to {number(_CM * group.high)} cm"


def _centre_table(errors: CentreErrors) -> str:
    rows = [(cell(camera), [cell(number(_CM * error))]) for camera, error in errors.error.items()]
    return table("Errors of the camera centres", ("camera centre, aligned by the centres", "error [cm]"), rows)
