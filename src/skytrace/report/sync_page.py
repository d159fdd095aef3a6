"""The page of a synchronisation: what was found, who is tied to whom, and the evidence of every pair."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from skytrace.errors import ReconstructionError
from skytrace.estimation.sync_curves import PairCurves, SyncCurves
from skytrace.estimation.sync_settings import SyncSettings
from skytrace.model.track import Recording
from skytrace.report.shell import filled, options, section, tiles, warnings_card, whole_page
from skytrace.report.sync_figures import (
    clock_figures,
    error_histogram_figure,
    error_time_figure,
    score_figure,
    zoom_range_s,
)
from skytrace.report.sync_graph import graph_figure
from skytrace.report.sync_tables import clock_table, hint_table, pair_table
from skytrace.report.sync_words import finding_sentences, notes, pair_name, pair_words
from skytrace.report.theme import themes
from skytrace.report.words import NO_BREAK, number, probability

MAX_POINTS, ALL_POINTS = 1200, 16_000  # of one score curve, and of all
MAX_ERRORS, ALL_ERRORS = 500, 10_000  # likewise of the epipolar errors over time


def render_sync_report(
    document: Mapping[str, Any],
    curves: SyncCurves,
    recordings: Mapping[str, Recording],
    settings: SyncSettings,
    *,
    name: str,
    failure: ReconstructionError | None = None,
) -> str:
    """The page of a synchronisation: HTML text that holds all it needs, plotly.js included.

    `document` is what `skytrace sync` writes, `curves` belong to the same synchronisation, `recordings` are those of
    its cameras. `failure` is shown at the top: where nothing could be tied, the page tells what there is.
    The same input gives the same text.
    """
    rates = {c: r.frame_rate_hz for c, r in recordings.items() if all(t.time_s is None for t in r.tracks)}
    seen_s = {c: float((s.seen_s[:, 1] - s.seen_s[:, 0]).sum()) for c, s in curves.sights.items()}
    clocks = clock_figures(document, curves.sights)
    pairs = [_pair(k, curves, document, recordings, settings) for k in range(len(curves.pairs))]
    remarks = "".join(f"<li>{escape(text)}</li>\n" for text in notes(document, rates))
    main = filled(
        "sync_page.html",
        failure="" if failure is None else _failure(failure),
        warnings=warnings_card(document["warnings"]),
        summary=escape(" ".join(finding_sentences(document, settings.min_confidence))),
        notes=f'<ul class="notes">\n{remarks}</ul>' if remarks else "",
        tiles=_tiles(document),
        timelines="".join(_timeline(k, title) for k, (title, _) in enumerate(clocks)),
        clocks=clock_table(document, rates, seen_s),
        pair=_pair_section(curves, document, settings),
        pairs=section("pairs", "All pairs", pair_table(document, linked=True), _PAIRS),
        hints=section("hints", "What became of the hints", hint_table(document), _HINTS),
    )
    data = {
        "themes": themes(),
        "graph": {
            key: graph_figure(document, settings.min_confidence, key == "upright") for key in ("wide", "upright")
        },
        "clocks": [figure for _, figure in clocks],
        "pairs": pairs,
        "start": _most_telling(curves, document),
    }
    return whole_page(name, "skytrace synchronisation", main, data, ["sync_page.js"], ["sync_page.css"])


_PAIRS = (
    "Time of the second camera = offset + rate · time of the first. Only pairs with a plausible offset are listed. The "
    "confidence is the probability that the offset is right to a frame, from this pair alone."
)
_HINTS = "Hints say where to look and decide where the tracks cannot; what the tracks contradict is not believed."


def _pair(
    k: int,
    curves: SyncCurves,
    document: Mapping[str, Any],
    recordings: Mapping[str, Recording],
    settings: SyncSettings,
) -> dict[str, Any]:
    """What the page's script needs of one pair, in JSON's types."""
    pair = curves.pairs[k]
    edge = _entry(pair, document)
    entry = None if edge is None else document["pairs"][edge]
    focal_px = tuple(float(recordings[c].intrinsics.focal_px.mean()) for c in (pair.camera0, pair.camera1))
    max_points = min(MAX_POINTS, ALL_POINTS // len(curves.pairs))
    max_errors = min(MAX_ERRORS, ALL_ERRORS // len(curves.pairs))
    return {
        "words": pair_words(entry, pair, settings, focal_px),
        "edge": edge,
        "zoom": zoom_range_s(pair),
        "score": score_figure(pair, entry["rivals"] if entry else (), max_points) if len(pair.curve.score) else None,
        "errors": None
        if pair.errors is None
        else {
            "histogram": error_histogram_figure(pair.errors),
            "time": error_time_figure(pair.errors, pair.camera0, max_errors),
        },
    }


def _entry(pair: PairCurves, document: Mapping[str, Any]) -> int | None:
    """The place of a pair among those of the document."""
    names = [(p["camera0"], p["camera1"]) for p in document["pairs"]]
    key = (pair.camera0, pair.camera1)
    return names.index(key) if key in names else None


def _most_telling(curves: SyncCurves, document: Mapping[str, Any]) -> int:
    """The pair to show first: that with the most evidence."""
    score = {(p["camera0"], p["camera1"]): p["score"] for p in document["pairs"]}
    places = range(len(curves.pairs))
    return max(places, key=lambda k: score.get((curves.pairs[k].camera0, curves.pairs[k].camera1), 0.0), default=0)


def _failure(failure: ReconstructionError) -> str:
    counts = "; ".join(f"{name}: {value:g}" for name, value in failure.counts.items())
    texts = [f"{failure.reason[:1].upper()}{failure.reason[1:]}.", f"{counts}." if counts else ""]
    texts.append(f"{failure.hint}." if failure.hint else "")
    paragraphs = "".join(f"<p>{escape(text)}</p>\n" for text in texts if text)
    heading = '<h2 id="failure-title">The cameras could not be synchronised</h2>'
    return f'<section class="card failure" aria-labelledby="failure-title">\n{heading}\n{paragraphs}</section>\n'


def _timeline(k: int, title: str) -> str:
    name = escape(title)
    return f'<h3>{name}</h3>\n<div id="clock-{k}" class="plot" role="group" aria-label="Timeline: {name}"></div>\n'


def _tiles(document: Mapping[str, Any]) -> str:
    cameras, pairs = document["cameras"], document["pairs"]
    tied = [c for c in cameras.values() if c["tied"]]
    shown = [("cameras tied together", f"{len(tied)} of {len(cameras)}")]
    if len(document["groups"]) > 1:
        shown.append(("groups without a tie between them", str(len(document["groups"]))))
    shown.append(("pairs used", f"{sum(p['accepted'] for p in pairs)} of {len(pairs)}"))
    if tied:
        shown.append(("least confidence of a camera", probability(min(c["confidence"] for c in tied))))
        sigma_ms = 1e3 * max(c["offset_sd_s"] for c in tied)
        shown.append(("largest deviation of an offset", f"{number(sigma_ms, 2)}{NO_BREAK}ms"))
    return tiles(shown)


def _pair_section(curves: SyncCurves, document: Mapping[str, Any], settings: SyncSettings) -> str:
    if not curves.pairs:
        return ""
    labels = []
    for pair in curves.pairs:
        edge = _entry(pair, document)
        if edge is None:
            labels.append(f"{pair.camera0} – {pair.camera1}: no plausible offset")
            continue
        entry = document["pairs"][edge]
        used = "used" if entry["accepted"] else "not used"
        labels.append(f"{pair_name(entry)}: {probability(entry['confidence'])}, {used}")
    return filled(
        "sync_pair.html",
        pair_options=options(map(str, range(len(labels))), labels),
        overlap_s=number(settings.min_overlap_s, 2),
    )
