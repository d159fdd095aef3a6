"""The tables of a synchronisation as HTML, from its document: cameras with their clocks, pairs with their evidence."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from skytrace.report.tables import cell, finite, table
from skytrace.report.theme import camera_colour
from skytrace.report.words import number, probability, seconds, with_deviation

CLOCK_HEADERS = ("clock offset [s]", "clock rate", "confidence")
PAIR_HEADERS = (
    "pair",
    "offset [s]",
    "clock rate",
    "common view [s]",
    "confidence",
    "used",
    "also plausible at [s]",
    "off the joint clocks [ms]",
)


def clock_table(
    document: Mapping[str, Any], frame_rates_hz: Mapping[str, float], seen_s: Mapping[str, float] | None = None
) -> str:
    """Every camera's clock, or why it has none; empty without cameras.

    Nominal frame rates are those of cameras whose frames are counted; `seen_s` is how long each saw the target.
    """
    references = [group["reference"] for group in document.get("groups") or ()]
    rows = []
    for index, (camera_id, camera) in enumerate((document.get("cameras") or {}).items()):
        swatch = f'<span class="swatch" style="background:{camera_colour(index)}"></span>'
        first = [] if seen_s is None else [cell(seconds(seen_s[camera_id]) if camera_id in seen_s else "never")]
        if "offset_s" not in camera:
            rows.append((swatch + cell(camera_id, "not tied in"), [*first, cell(str(camera.get("reason", "")))]))
            continue
        state = "reference" if camera_id in references else "tied in"
        if camera["group"]:
            state += f", group {camera['group'] + 1}"
        given_hz = frame_rates_hz.get(camera_id)
        found = "" if given_hz is None else f"{number(given_hz / camera['rate'], 6)} Hz, given {number(given_hz, 6)}"
        row = [
            *first,
            cell(with_deviation(camera["offset_s"], camera["offset_sd_s"])),
            cell(with_deviation(camera["rate"], camera["rate_sd"]), found),
            cell(probability(camera["confidence"])),
        ]
        rows.append((swatch + cell(camera_id, state), row))
    headers = ["camera", *(["saw the target"] if seen_s is not None else []), *CLOCK_HEADERS]
    return table("Clocks of the cameras", headers, rows) if rows else ""


def pair_table(document: Mapping[str, Any], linked: bool = False) -> str:
    """What is known of the pairs of cameras, used or not; empty without any.

    Entries that a pair lacks stay blank. With `linked` the names lead to the pair's pictures on the page.
    """
    off_s = disagreements(document)
    rows = []
    for k, pair in enumerate(document.get("pairs") or ()):
        key = (pair.get("camera0", "?"), pair.get("camera1", "?"))
        name = cell(f"{key[0]} – {key[1]}")
        if linked:
            name = f'<a href="#pair-title" data-pair="{k}">{name}</a>'
        rows.append((name, [*_pair_cells(pair), _number_or_blank(off_s.get(key), 1e3)]))
    return table("Pairs of cameras", PAIR_HEADERS, rows) if rows else ""


def _pair_cells(pair: Mapping[str, Any]) -> list[str]:
    offset, deviation = pair.get("offset_s"), pair.get("offset_sd_s")
    overlap, support = pair.get("overlap_s"), pair.get("support_s")
    share = f"{100 * support / overlap:.0f} % agree" if finite(overlap) and finite(support) and overlap > 0 else ""
    used = {True: "yes", False: "no"}.get(pair.get("accepted", ""), "")
    rivals = ", ".join(number(rival["offset_s"], 5) for rival in pair.get("rivals") or ())
    measured = with_deviation(offset, deviation) if finite(offset) and finite(deviation) else ""
    return [
        cell(measured) if measured else _number_or_blank(offset, 1, 6),
        _number_or_blank(pair.get("rate"), 1, 7),
        cell(number(overlap), share) if finite(overlap) else "",
        _confidence(pair.get("confidence"), pair.get("confidence_without_hints")),
        escape(used),
        cell(rivals),
    ]


def _confidence(value: Any, without_hints: Any) -> str:
    if not finite(value):
        return ""
    blind = probability(without_hints) if finite(without_hints) else ""
    return cell(probability(value), f"{blind} without hints" if blind not in ("", probability(value)) else "")


def hint_table(document: Mapping[str, Any]) -> str:
    """What became of the hints given, and by how much the tracks differ from them; empty without any."""
    rows = []
    for hint in document.get("hints") or ():
        error_s, deviation_s = hint.get("error_s"), hint.get("error_sd_s")
        difference = with_deviation(error_s, deviation_s) if finite(error_s) and finite(deviation_s) else ""
        rows.append(
            (cell(str(hint["name"])), [cell(", ".join(hint["cameras"])), cell(hint["verdict"]), cell(difference)])
        )
    return table("Hints", ("hint", "cameras", "verdict", "tracks less hint [s]"), rows) if rows else ""


def disagreements(document: Mapping[str, Any]) -> dict[tuple[str, str], float]:
    """How far pairs are off the joint clocks in seconds: those used in the first group, which the document lists."""
    groups, off_s = document.get("groups") or (), document.get("disagreement_s")
    first = set(groups[0]["cameras"]) if groups else set()
    used = [
        (pair["camera0"], pair["camera1"])
        for pair in document.get("pairs") or ()
        if pair.get("accepted") and {pair["camera0"], pair["camera1"]} <= first
    ]
    return dict(zip(used, off_s, strict=True)) if off_s is not None and len(off_s) == len(used) else {}


def _number_or_blank(value: Any, factor: float = 1.0, digits: int = 3) -> str:
    return cell(number(factor * value, digits)) if finite(value) else ""
