"""Settings of the synchronisation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class SyncSettings:
    """Angles are on the plane z = 1, so nearly radians."""

    rate_hz: float = 10.0
    min_overlap_s: float = 15.0
    candidates: int = 50  # of the algebraic search, verified by geometry
    turn_candidates: int = 10  # of the search by turn rates
    modes: int = 8  # kept for the consensus of all pairs
    distinct_s: float = 1.0  # offsets closer than this are one mode
    tolerance_s: float = 0.4
    verify_threshold: float = 0.012
    verify_samples: int = 150
    verify_iterations: int = 100
    mode_thresholds: tuple[float, ...] = (0.012, 0.004)
    mode_samples: int = 250
    mode_iterations: int = 6
    min_mode_overlap_s: float = 10.0
    refine_thresholds: tuple[float, ...] = (0.006, 0.003)
    rate_prior: float = 4e-4
    min_support: float = 0.6  # share of the overlap that must obey the refined geometry
    min_confidence: float = 0.95  # of a pair that ties two cameras by itself
    rival_evidence: float = 0.5  # share of the chosen mode's evidence from which another one is reported as its rival
    min_pair_support_s: float = 8.0
    # Stretches tried for a camera that fits at no offset: one per cent apart, and around the factors of slow motion.
    rate_factors: tuple[float, ...] = tuple(
        round(float(f), 6) for f in np.r_[0.25, 0.5, 2.0, 4.0, 1.01 ** np.arange(-45, 46)]
    )
    min_rate_contrast: float = 2.0  # of the best stretch's evidence to the median one's
    min_extent: float = 0.01  # of the image motion on the plane z = 1: below, the target hovers
    min_bend: float = 0.02  # of the image path, see motion_shape: below, it is a straight line
