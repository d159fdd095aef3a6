"""A made-up synchronisation of five cameras for the tests of its page: two groups, one camera in none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from skytrace.estimation.sync_curves import EpipolarErrors, PairCurves, ScoreCurve, Sight, SyncCurves
from skytrace.model.camera import Intrinsics
from skytrace.model.track import Recording

IDS = ("north", "south", "east", "hill", "lake")


def make_document(ids: Sequence[str] = IDS) -> dict[str, Any]:
    """Three cameras tied to the first, two to each other; the third's pair with the second is at another offset."""
    a, b, c, d, e = ids
    cameras = {
        a: _camera(0, 0.0, 0.0, 0.998),
        b: _camera(0, 12.5, 0.002, 0.998),
        c: _camera(0, -31.25, 0.004, 0.9712, rate=1.4),
        d: {"tied": False, "reason": "its track is too short"},
        e: {"tied": False, "reason": "it has no usable detections"},
    }
    pairs = [
        _pair(
            a, b, -12.5, 0.998, True, rivals=[{"offset_s": 47.5, "score": 310.0}, {"offset_s": 107.5, "score": 90.0}]
        ),
        _pair(a, c, 31.25, 0.9712, True, score=120.0),
        _pair(b, c, 80.0, 0.62, False, score=40.0),
        _pair(a, d, 5.0, 0.001, False, score=12.0, support_s=20.0),
    ]
    return {
        "reference": a,
        "cameras": cameras,
        "groups": [{"reference": a, "cameras": sorted([a, b, c])}],
        "pairs": pairs,
        "disagreement_s": [0.0012, 0.0345],
        "hints": [
            {"name": f"offset_s of {b}", "cameras": [b], "verdict": "contradicted", "error_s": 8.25, "error_sd_s": 0.5}
        ],
        "warnings": [f"The offset given for {b} is contradicted by the tracks"],
    }


def unsolved(document: Mapping[str, Any]) -> dict[str, Any]:
    """The same where nothing was tied."""
    reason = "its track shares too little"
    return {
        **document,
        "cameras": {c: {"tied": False, "reason": reason} for c in document["cameras"]},
        "groups": [],
        "pairs": [{**pair, "accepted": False} for pair in document["pairs"]],
        "disagreement_s": [],
        "warnings": [],
    }


def _camera(group: int, offset_s: float, sd_s: float, confidence: float, rate: float = 1.0) -> dict[str, Any]:
    clock = {"offset_s": offset_s, "rate": rate, "offset_sd_s": sd_s, "rate_sd": 1e-2 * sd_s}
    return {"tied": group == 0, "group": group, **clock, "confidence": confidence}


def _pair(a: str, b: str, offset_s: float, confidence: float, accepted: bool, **more: Any) -> dict[str, Any]:
    return {
        "camera0": a,
        "camera1": b,
        "accepted": accepted,
        "confidence": confidence,
        "confidence_without_hints": None,
        "offset_s": offset_s,
        "rate": 1.0,
        "offset_sd_s": 0.002,
        "overlap_s": 80.0,
        "support_s": 78.4,
        "score": 300.0,
        "rivals": [],
        **more,
    }


def make_curves(document: Mapping[str, Any], n_shifts: int = 3000, n_errors: int = 800) -> SyncCurves:
    """Curves with a summit at each pair's offset; the last camera saw nothing, the last but one too little."""
    rng = np.random.default_rng(3)
    ids = list(document["cameras"])
    known = {(p["camera0"], p["camera1"]): p for p in document["pairs"]}
    sights = {
        c: Sight((0.0, 90.0), np.array([[0.0, 40.0 + 3 * k], [50.0 + 2 * k, 90.0]])) for k, c in enumerate(ids[:-1])
    }
    pairs = []
    for a, b in combinations(ids[:-1], 2):
        pair = known.get((a, b))
        if pair is None:
            nothing = np.zeros(0)
            pairs.append(PairCurves(a, b, ScoreCurve(nothing, nothing, nothing, float("nan"))))
            continue
        offset_s = np.linspace(-150.0, 150.0, n_shifts)
        score = 100 + 30 * rng.random(n_shifts) + 900 * np.exp(-np.abs(offset_s - pair["offset_s"]))
        curve = ScoreCurve(offset_s, score, np.full(n_shifts, 60.0), 180.0)
        time_s = np.linspace(0.0, 80.0, n_errors)
        before = 4e-3 * np.abs(rng.normal(size=n_errors))
        before[:5] = np.nan
        errors = EpipolarErrors(time_s, before, 5e-4 * np.abs(rng.normal(size=n_errors)))
        joint_s = -43.75 if (a, b) == (ids[1], ids[2]) else pair["offset_s"] if pair["accepted"] else None
        pairs.append(PairCurves(a, b, curve, pair["offset_s"], 1, joint_s, errors))
    return SyncCurves(sights, tuple(pairs))


def make_recordings(ids: Sequence[str] = IDS) -> dict[str, Recording]:
    lens = Intrinsics([1500.0, 1500.0], [960.0, 540.0], np.zeros(5), (1920, 1080))
    return {c: Recording(c, lens, 30.0, ()) for c in ids}
