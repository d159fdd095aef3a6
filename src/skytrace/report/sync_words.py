"""What a synchronisation found, in plain words, from its document and curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from skytrace.estimation.sync_curves import PairCurves
from skytrace.estimation.sync_settings import SyncSettings
from skytrace.report.words import NO_BREAK, count, listing, number, probability, seconds, with_deviation

_ODD_RATE = 5e-3
_MOST_RIVALS = 4
_WORTH_A_WORD = 0.1  # confidence from which a pair that was not used may be what a reader looks for


def finding_sentences(document: Mapping[str, Any], threshold: float) -> list[str]:
    """Which cameras are tied together, by how much evidence; `threshold` is the confidence that ties two cameras."""
    cameras, pairs = document["cameras"], document["pairs"]
    tied = [c for c, camera in cameras.items() if camera["tied"]]
    if not tied:
        return _nothing(pairs, len(cameras), threshold)
    reference, used = document["reference"], sum(pair["accepted"] for pair in pairs)
    if len(tied) == len(cameras):
        sentences = [f"All {len(cameras)} cameras are tied to the clock of {reference}."]
    else:
        missing = listing([c for c in cameras if c not in tied])
        sentences = [f"{len(tied)} of {len(cameras)} cameras are tied to the clock of {reference}; without {missing}."]
    for group in document["groups"][1:]:
        sentences.append(
            f"{listing(group['cameras'])} are tied to each other, on the clock of {group['reference']}, but to none of "
            "the others."
        )
    sentences.append(f"{used} of {count(len(pairs), 'pair')} with a plausible offset agree with this.")
    return [*sentences, *_certainty(cameras, tied, reference)]


def _nothing(pairs: Sequence[Mapping[str, Any]], n_cameras: int, threshold: float) -> list[str]:
    sentences = [f"None of the {n_cameras} cameras is tied to another."]
    if not pairs:
        return [*sentences, "No pair of them has a plausible offset."]
    best = max(pairs, key=lambda pair: pair["confidence"])
    return [
        *sentences,
        f"{count(len(pairs), 'pair')} of them {'has' if len(pairs) == 1 else 'have'} a plausible offset. The most "
        f"convincing is {pair_name(best)} with a confidence of {probability(best['confidence'])}, where "
        f"{number(threshold, 2)} would tie two cameras together.",
    ]


def _certainty(cameras: Mapping[str, Any], tied: Sequence[str], reference: str) -> list[str]:
    others = [c for c in tied if c != reference]
    sigma_ms = [1e3 * cameras[c]["offset_sd_s"] for c in others]
    low, high = number(min(sigma_ms), 2), number(max(sigma_ms), 2)
    spread = f"{low} to {high}" if low != high else low
    least = min(others, key=lambda c: cameras[c]["confidence"])
    confidence = cameras[least]["confidence"]
    sure = "the least sure camera is " + least if len(others) > 1 and confidence <= 0.9999 else "each is tied in"
    return [
        f"Offsets are known to within {spread}{NO_BREAK}ms (one standard deviation); {sure} with a confidence of "
        f"{probability(confidence)}."
    ]


def notes(document: Mapping[str, Any], frame_rates_hz: Mapping[str, float]) -> list[str]:
    """What a reader should look at: cameras without a tie, frame rates that are not those given, rival offsets."""
    cameras, out = document["cameras"], []
    for camera_id, camera in cameras.items():
        if document["groups"] and "offset_s" not in camera:
            out.append(f"{camera_id} is not tied in: {camera['reason']}.")
        given_hz = frame_rates_hz.get(camera_id)
        if given_hz is not None and abs(camera.get("rate", 1.0) - 1) > _ODD_RATE:
            found_hz = number(given_hz / camera["rate"], 4)
            out.append(f"{camera_id} runs at {found_hz} frames a second, not at the {number(given_hz, 4)} given.")
    for pair in document["pairs"]:
        if pair["rivals"] and (pair["accepted"] or pair["confidence"] >= _WORTH_A_WORD):
            settled = " The other pairs decide." if pair["accepted"] and len(document["pairs"]) > 1 else ""
            out.append(f"{pair_name(pair)} is ambiguous: {rival_words(pair)}{settled}")
    return out


def pair_name(pair: Mapping[str, Any]) -> str:
    """The two cameras of a pair."""
    return f"{pair['camera0']} – {pair['camera1']}"


def rival_words(pair: Mapping[str, Any]) -> str:
    """The offsets that fit a pair nearly as well as the chosen one, or better."""
    rivals = pair["rivals"]
    better = "as well or better" if rivals[0]["score"] >= pair["score"] else "nearly as well"
    shown = [f"{number(rival['offset_s'], 5)}{NO_BREAK}s" for rival in rivals[:_MOST_RIVALS]]
    rest = len(rivals) - len(shown)
    return f"offsets of {listing([*shown, f'{rest} more'] if rest else shown)} fit {better}."


def pair_words(
    pair: Mapping[str, Any] | None, curves: PairCurves, settings: SyncSettings, focal_px: Sequence[float]
) -> list[str]:
    """What is known of one pair; `pair` is its entry in the document, None where no offset was plausible."""
    a, b = curves.camera0, curves.camera1
    if pair is None:
        if not len(curves.curve.offset_s):
            return ["No offset leaves enough time in which both cameras saw the target."]
        return ["At no offset do the two tracks look like views of one flight."]
    words = [
        f"{b}'s time is {with_deviation(pair['offset_s'], pair['offset_sd_s'])} s + {number(pair['rate'], 7)} × {a}'s "
        f"time, with a confidence of {probability(pair['confidence'])}.",
        _verdict(pair, curves, settings),
        f"With it both saw the target for {seconds(pair['overlap_s'])}; "
        f"{100 * pair['support_s'] / max(pair['overlap_s'], 1e-9):.0f}{NO_BREAK}% of that obeys one geometry.",
    ]
    if curves.chosen_s is None or curves.curve.score_at(curves.chosen_s) is None:
        words.append("So short an overlap is not among the offsets searched below: other cameras or hints led to it.")
    elif curves.rank is None:
        words.append(
            "It is not among the best offsets by the score below: another search, or the other cameras, led to it."
        )
    else:
        words.append(f"By the score below it is {_place(curves.rank)} of all offsets.")
    if pair["rivals"]:
        words.append(rival_words(pair).capitalize())
    if curves.errors is not None:
        before, after = (1e3 * float(np.nanmedian(e)) for e in (curves.errors.before, curves.errors.after))
        words.append(
            f"The median epipolar error is {number(before, 2)}{NO_BREAK}mrad before the refinement and "
            f"{number(after, 2)}{NO_BREAK}mrad after."
        )
        px = [f"{number(1e-3 * f, 2)}{NO_BREAK}px in {c}" for f, c in zip(focal_px, (a, b), strict=True)]
        words.append(f"1{NO_BREAK}mrad is {listing(px)}.")
    return words


def _verdict(pair: Mapping[str, Any], curves: PairCurves, settings: SyncSettings) -> str:
    threshold = settings.min_confidence
    sure = pair["confidence"] >= threshold
    if pair["accepted"]:
        return "It is used." if sure else "It is used because the other pairs agree with it; it would not count alone."
    if curves.joint_s is not None and curves.chosen_s is not None:
        off_s = curves.chosen_s - curves.joint_s
        if abs(off_s) > settings.distinct_s:
            return f"It is not used: the other pairs put it at {number(curves.joint_s, 5)}{NO_BREAK}s."
        return "It is not used: too little of its common view obeys one geometry."
    if not sure:
        return f"It is not used: a tie takes a confidence of {number(threshold, 2)}."
    return "It is not used: too little of its common view obeys one geometry, or it contradicts surer pairs."


def _place(rank: int) -> str:
    return {1: "the best", 2: "the second best", 3: "the third best"}.get(rank, f"number {rank}")
