"""Numbers and findings in plain words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from skytrace.model.reconstruction import Reconstruction

MINUS = "\N{MINUS SIGN}"
PLUS_MINUS = "\N{PLUS-MINUS SIGN}"
NO_BREAK = "\N{NO-BREAK SPACE}"


def number(value: float, digits: int = 3) -> str:
    """A number to so many significant digits, without an exponent where it can be read without."""
    if not math.isfinite(value):
        return "unknown"
    if value == 0:
        return "0"
    magnitude = math.floor(math.log10(abs(value)))
    if not -5 <= magnitude <= 7:
        text = f"{value:.{digits - 1}e}"
    else:
        text = f"{value:,.{max(0, digits - 1 - magnitude)}f}"
    return text.replace("-", MINUS)


def with_deviation(value: float, deviation: float) -> str:
    """A value and its standard deviation, both to the second digit of the latter, which is 0 for a fixed value."""
    if not math.isfinite(deviation):
        return number(value, 6)
    if deviation == 0:
        return f"{number(value, 7)} (fixed)"
    decimals = min(max(1 - math.floor(math.log10(deviation)), 0), 12)
    value = round(value, decimals) + 0.0  # no "-0.00"
    return f"{value:,.{decimals}f} {PLUS_MINUS} {deviation:,.{decimals}f}".replace("-", MINUS)


def probability(value: float) -> str:
    """A probability to as many digits as tell it from none and from certainty: '0.42', '0.9974', '> 0.9999'."""
    if value > 0.9999:
        return f">{NO_BREAK}0.9999"
    if value < 0.0001:
        return f"<{NO_BREAK}0.0001"
    return f"{value:.2f}" if 0.01 <= value <= 0.99 else f"{value:.4f}"


def seconds(value: float) -> str:
    """A duration: '8.3 s', '2 min 5 s', never broken across lines."""
    if value < 60:
        return f"{value:.1f}{NO_BREAK}s"
    minutes, rest = divmod(round(value), 60)
    text = f"{minutes} min {rest} s" if rest else f"{minutes} min"
    return text.replace(" ", NO_BREAK)


def count(n: int, noun: str, plural: str | None = None) -> str:
    """'1 camera', '4 cameras', '12,345 detections'."""
    return f"{n:,} {noun if n == 1 else plural or noun + 's'}"


def listing(words: Sequence[str]) -> str:
    """'a', 'a and b', 'a, b and c'."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def unit_of(reconstruction: Reconstruction) -> str:
    """The unit of length for labels: 'm' or 'units'."""
    return "m" if reconstruction.gauge == "metric" else "units"


def pooled_median_px(reconstruction: Reconstruction) -> float:
    """Median length of the reprojection errors of all cameras' detections together, NaN without any."""
    lengths = [np.linalg.norm(c.residuals.error_px, axis=1) for c in reconstruction.cameras.values()]
    pooled = np.concatenate(lengths)
    return float(np.median(pooled)) if len(pooled) else float("nan")


def summary_sentences(reconstruction: Reconstruction, n_cameras: int) -> list[str]:
    """What the run found, in a few sentences; `n_cameras` were given, registered or not."""
    sentences = [_cameras(reconstruction, n_cameras), _coverage(reconstruction)]
    if math.isfinite(pooled_median_px(reconstruction)):
        sentences.append(_errors(reconstruction))
    return sentences


_WORTH_A_WORD_S = 0.5
_CUTS = {
    "too_few_cameras_s": "seen by too few cameras",
    "cameras_disagree_s": "in which cameras contradict each other",
    "too_uncertain_s": "too uncertain",
    "too_short_s": "in stretches too short to claim",
}


def cut_sentence(not_covered: Mapping[str, Any]) -> str:
    """How much of what was seen is not claimed, and why; empty where nothing is missing or nothing is told."""
    lengths = {words: not_covered.get(key) for key, words in _CUTS.items()}
    cut = {words: s for words, s in lengths.items() if isinstance(s, int | float) and s >= _WORTH_A_WORD_S}
    if not cut or "seen_s" not in not_covered:
        return ""
    parts = [f"{seconds(s)} {words}" for words, s in cut.items()]
    return (
        f"Of {seconds(not_covered['seen_s'])} in which any camera saw the target, these are left out: {listing(parts)}."
    )


def frame_sentences(reconstruction: Reconstruction) -> list[str]:
    """Which unit, frame and clock the numbers refer to."""
    reference = reconstruction.reference
    frame = reconstruction.frame_in_words
    if reconstruction.gauge == "metric":
        where = f"Lengths are in metres, and the frame is {frame}."
    elif reconstruction.frame == "level":
        where = f"Lengths are in an arbitrary unit: nothing tells the size of the flight. The frame is {frame}."
    else:
        where = (
            "Lengths are in an arbitrary unit: without a known distance, tracks tell the shape of a flight but not its "
            f"size. Positions refer to camera {reference}, with x to its right, y down and z forward."
        )
    return [where, f"Times are seconds on the clock of camera {reference}."]


def _cameras(reconstruction: Reconstruction, n_cameras: int) -> str:
    n = len(reconstruction.cameras)
    if n == n_cameras:
        return f"All {n} cameras were located and synchronised by the target they saw."
    missing = listing(list(reconstruction.unregistered)) or f"{n_cameras - n} more"
    return f"{n} of {n_cameras} cameras were located and synchronised by the target they saw; without {missing}."


def _coverage(reconstruction: Reconstruction) -> str:
    trajectory = reconstruction.trajectory
    if not trajectory.segments:
        return "No stretch of the flight is covered."
    span_s = trajectory.segments[-1].end_s - trajectory.segments[0].begin_s
    covered = f"The trajectory covers {seconds(trajectory.covered_s)}"
    if len(trajectory.segments) == 1:
        return f"{covered} without a gap."
    return (
        f"{covered} in {len(trajectory.segments)} segments spread over {seconds(span_s)}; nothing is claimed between."
    )


def _errors(reconstruction: Reconstruction) -> str:
    by_camera = [c.residuals.median_px for c in reconstruction.cameras.values() if len(c.residuals.frame)]
    text = f"Half of all detections lie within {number(pooled_median_px(reconstruction), 2)} px of where they should"
    low, high = number(min(by_camera), 2), number(max(by_camera), 2)
    return f"{text} ({low} to {high} px by camera)." if low != high else f"{text}."
