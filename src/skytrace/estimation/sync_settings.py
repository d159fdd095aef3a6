"""Settings of the synchronisation."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

SyncMethod = Literal["exhaustive", "paper", "given"]


@dataclass(frozen=True, slots=True)
class GrowingSettings:
    """Of the synchronisation from rough offsets, see `growing_steps`."""

    frame_s: float = 1 / 30  # the shortest step, a video frame
    steps: int = 8  # each twice the one before: the longest is 128 frames
    reach: float = 3.0  # the shift may exceed the step by this factor
    samples: int = 200  # correspondences
    min_samples: int = 30
    draws: int = 300  # of eight of them, for each step
    rounds: int = 5
    settled_s: float = 0.5 / 30


@dataclass(frozen=True, slots=True)
class SyncSettings:
    """Angles are on the plane z = 1, so nearly radians.

    `method` says where offsets come from: searched everywhere, from rough ones as the paper does it, or as given.
    """

    method: SyncMethod = "exhaustive"
    rate_hz: float = 10.0
    min_overlap_s: float = 15.0
    first_candidates: int = 32  # of the algebraic search, tried before all others
    first_modes: int = 4  # refined among them
    convincing: float = 0.999  # confidence at which they are enough
    candidates: int = 100  # of each algebraic search, screened by geometry
    turn_candidates: int = 30  # of the search by turn rates
    screen_separation_s: float = 0.4
    screen_samples: int = 60
    screen_iterations: int = 15
    sharpen_iterations: int = 40
    verified: int = 16  # of the screened, verified thoroughly
    window_s: float = 240.0  # recordings longer than two of these are searched in windows too, where no rate matters
    most_windows: int = 6
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
    rate_prior: float = 1e-3
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
    growing: GrowingSettings = field(default_factory=GrowingSettings)
