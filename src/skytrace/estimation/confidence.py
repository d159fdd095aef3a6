"""How sure the offset of a pair is."""

from __future__ import annotations

import numpy as np

__all__ = ["COEFFICIENTS", "EVIDENCE_PER_NAT", "confidence", "confidence_features"]


def confidence(evidence: float, rival: float, support: float, overlap_s: float, hinted_nats: float = 0.0) -> float:
    """Probability that a mode is right to a frame, from its evidence, that of the best other mode, and its support.

    A logistic regression on 800 simulated pairs with 15 to 120 s in common or none (benchmarks/sync_confidence.py).
    Overlaps too short to tell flights apart never count as sure, and a figure flown twice, which leaves two modes of
    equal evidence, counts as a choice between them. A hint that says the same makes up for a short overlap as far as it
    goes.
    """
    features = confidence_features(evidence, rival, support)
    found = float(1 / (1 + np.exp(-np.clip(features @ COEFFICIENTS, -30, 30))))
    found /= 1 + float(np.exp(-np.clip((evidence - rival) / EVIDENCE_PER_NAT, -30, 30)))
    if overlap_s >= _SURE_OVERLAP_S:
        return found
    return min(found, _UNSURE / (_UNSURE + (1 - _UNSURE) * float(np.exp(-hinted_nats))))


def confidence_features(evidence: float, rival: float, support: float) -> np.ndarray:
    """Constant, logarithms of evidence and contrast above a floor of a few seconds, and support."""
    own, other = max(evidence, 0.0) + _EVIDENCE_FLOOR, max(rival, 0.0) + _EVIDENCE_FLOOR
    return np.array([1.0, np.log(own / _EVIDENCE_FLOOR), np.log(own / other), support])


_EVIDENCE_FLOOR = 20.0
EVIDENCE_PER_NAT = 8.0  # errors are correlated in time, so evidence comes in larger units
_SURE_OVERLAP_S, _UNSURE = 20.0, 0.85
COEFFICIENTS = np.array([-19.36, 3.40, 1.77, 16.85])
