"""The page's tables and lists as HTML. Every text that comes from outside is escaped here."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from html import escape
from typing import Any, TypeGuard

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.model.reconstruction import CameraEstimate, Reconstruction
from skytrace.report.theme import camera_colour
from skytrace.report.words import MINUS, count, number, with_deviation

MOST_ITEMS = 20  # of a list of values written out


def cell(text: str, note: str = "") -> str:
    """The escaped content of a table cell, with a second, quieter line."""
    return escape(text) + (f'<span class="note">{escape(note)}</span>' if note else "")


def table(caption: str, headers: Sequence[str], rows: Iterable[tuple[str, Sequence[str]]]) -> str:
    """A table that scrolls sideways on narrow screens.

    Rows are a head and cells, both already HTML; the last cell of a shorter row reaches to the end.
    """
    head = "".join(f'<th scope="col">{escape(header)}</th>' for header in headers)
    body = "".join(_row(first, cells, len(headers) - 1) for first, cells in rows)
    name = escape(caption, quote=True)
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{name}"><table><caption>{name}</caption>\n'
        f"<thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody></table></div>"
    )


def _row(first: str, cells: Sequence[str], width: int) -> str:
    spans = ["" for _ in cells]
    if len(cells) < width:
        spans[-1] = f' colspan="{width - len(cells) + 1}"'
    columns = "".join(f"<td{span}>{content}</td>" for span, content in zip(spans, cells, strict=True))
    return f'<tr><th scope="row">{first}</th>{columns}</tr>\n'


def camera_ids(reconstruction: Reconstruction, summary: Mapping[str, Any]) -> list[str]:
    """Every camera known to the reconstruction or the summary: the registered ones first."""
    return list(dict.fromkeys([*reconstruction.cameras, *reconstruction.unregistered, *_of_cameras(summary)]))


def camera_table(reconstruction: Reconstruction, summary: Mapping[str, Any], unit: str) -> str:
    """What was estimated of each camera."""
    rows = []
    for index, camera_id in enumerate(camera_ids(reconstruction, summary)):
        known = _of_cameras(summary).get(camera_id, {})
        camera = reconstruction.cameras.get(camera_id)
        if camera is None:
            reason = reconstruction.unregistered.get(camera_id) or known.get("reason") or "no reason was recorded"
            rows.append((cell(camera_id, "left out"), [cell(str(reason))]))
        else:
            state = "reference" if camera_id == reconstruction.reference else "registered"
            swatch = f'<span class="swatch" style="background:{camera_colour(index)}"></span>'
            rows.append((swatch + cell(camera_id, state), _estimates(camera, known, unit)))
    return table("Cameras", _CAMERA_HEADERS, rows)


_CAMERA_HEADERS = (
    "camera",
    "clock offset [s]",
    "frame period [ms]",
    "readout [ms]",
    "focal length [px]",
    "median error [px]",
    "detections used",
    "centre ±",
)


def _estimates(camera: CameraEstimate, known: Mapping[str, Any], unit: str) -> list[str]:
    clock, deviation = camera.clock, camera.clock_deviation
    given_hz = known.get("frame_rate_given_hz")
    rate = f"{number(1 / clock.period_s, 6)} Hz"
    if finite(given_hz):
        rate += f", given {number(given_hz, 6)}"
    period = with_deviation(1e3 * clock.period_s, 1e3 * deviation.period_s)
    readout = with_deviation(1e3 * clock.readout_s, 1e3 * deviation.readout_s)
    residuals = camera.residuals
    agreeing = int(residuals.inlier.sum())
    share = f"{agreeing:,} agree" + (f" ({100 * agreeing / len(residuals.frame):.1f} %)" if agreeing else "")
    return [
        cell(with_deviation(clock.offset_s, deviation.offset_s)),
        cell(period, rate),
        cell(readout, f"{number(clock.readout_s / clock.period_s, 2)} of a frame"),
        _focal(camera),
        cell(number(residuals.median_px, 2), f"σ {number(camera.sigma_px, 2)}"),
        cell(f"{len(residuals.frame):,}", share),
        cell(f"{number(float(np.linalg.norm(camera.centre_deviation)), 2)} {unit}"),
    ]


def _focal(camera: CameraEstimate) -> str:
    before, after = camera.calibrated.focal_px, camera.refined.focal_px
    changes = dict.fromkeys(f"{100 * (b / a - 1):+.2f}" for a, b in zip(before, after, strict=True))
    change = f"changed by {', '.join(changes)} %".replace("-", MINUS)
    return cell(_times(after), f"calibrated {_times(before)}") + f'<span class="note">{escape(change)}</span>'


def _times(focal_px: FloatArray) -> str:
    return " × ".join(f"{f:.1f}" for f in focal_px)


def dropped_table(reconstruction: Reconstruction, summary: Mapping[str, Any]) -> str:
    """How many detections were dropped from each camera and why; empty when the summary does not tell."""
    cameras = _of_cameras(summary)
    ids = camera_ids(reconstruction, summary)
    known = {c: cameras[c] for c in ids if isinstance(cameras.get(c, {}).get("dropped"), Mapping)}
    if not known:
        return ""
    reasons = [r for r in dict.fromkeys(r for c in known.values() for r in c["dropped"]) if _any(known, r)]
    rows = []
    for camera_id, camera in known.items():
        given, total = camera.get("n_detections"), sum(camera["dropped"].values())
        share = f"{100 * total / given:.1f} %" if given else ""
        estimate = reconstruction.cameras.get(camera_id)
        aside = "" if estimate is None else f"{int((~estimate.residuals.inlier).sum()):,}"
        counts = [f"{camera['dropped'].get(reason, 0):,}" for reason in reasons]
        given_text = "" if given is None else f"{given:,}"
        rows.append((cell(camera_id), [cell(given_text), cell(f"{total:,}", share), *map(cell, counts), cell(aside)]))
    headers = ["camera", "given", "dropped", *(r.replace("_", " ") for r in reasons), "set aside later"]
    return table("Detections dropped before the reconstruction, by reason", headers, rows)


def _any(cameras: Mapping[str, Mapping[str, Any]], reason: str) -> bool:
    return any(camera["dropped"].get(reason, 0) for camera in cameras.values())


def observability_table(observability: Mapping[str, Any], ids: Sequence[str]) -> str:
    """What determined each parameter of each camera, cameras in the order of `ids`; empty without any.

    Entries that are not verdicts by camera and parameter follow as a list.
    """
    by_camera = {c: observability[c] for c in ids if _are_verdicts(observability.get(c))}
    rest = definitions({key: value for key, value in observability.items() if key not in by_camera})
    if not by_camera:
        return rest
    parameters = dict.fromkeys(parameter for verdicts in by_camera.values() for parameter in verdicts)
    rows = [
        (cell(parameter.replace("_", " ")), [_verdict(verdicts.get(parameter)) for verdicts in by_camera.values()])
        for parameter in parameters
    ]
    return table("What determined each parameter", ["parameter", *by_camera], rows) + rest


def _are_verdicts(verdicts: Any) -> bool:
    return isinstance(verdicts, Mapping) and all(
        isinstance(v, Mapping) and "determined" in v for v in verdicts.values()
    )


def _verdict(verdict: Mapping[str, Any] | None) -> str:
    if verdict is None:
        return ""
    value, deviation = verdict.get("value"), verdict.get("posterior_sd")
    note = ""
    if finite(value) and finite(deviation):
        note = with_deviation(value, deviation) if deviation > 0 else number(value)
    return cell(str(verdict["determined"]), note)


def definitions(values: Mapping[str, Any]) -> str:
    """Nested values as a flat list of dotted names and their values; empty without any."""
    pairs = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(_written(value))}</dd></div>\n" for name, value in _flat(values)
    )
    return f'<dl class="pairs">\n{pairs}</dl>' if pairs else ""


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _written(value: Any) -> str:
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        rest = len(value) - MOST_ITEMS
        words = [_written(item) for item in value[:MOST_ITEMS]]
        return ", ".join([*words, f"and {count(rest, 'more', 'more')}"] if rest > 0 else words) or "none"
    return str(value)


def _of_cameras(summary: Mapping[str, Any]) -> Mapping[str, Mapping[str, Any]]:
    return summary.get("cameras") or {}


def finite(value: Any) -> TypeGuard[float]:
    """Whether a value of a document is a number that can be written."""
    return isinstance(value, int | float | np.number) and math.isfinite(value)
