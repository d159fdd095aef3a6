"""Distance of reconstructed camera centres from surveyed ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import Similarity, align_similarity


@dataclass(frozen=True, eq=False, slots=True)
class CentreErrors:
    """Distances of camera centres under one similarity, in the unit of the known positions."""

    error: Mapping[str, float]  # camera id -> distance
    known_from_world: Similarity

    def __post_init__(self) -> None:
        object.__setattr__(self, "error", MappingProxyType(dict(self.error)))

    @property
    def mean(self) -> float:
        return float(np.mean(list(self.error.values())))

    @property
    def max(self) -> float:
        return float(np.max(list(self.error.values())))


def aligned_centre_errors(centre: Mapping[str, FloatArray], known: Mapping[str, FloatArray]) -> CentreErrors:
    """Errors of centres (3,) by camera id after the similarity that fits them best to the known positions.

    Raises ValueError when fewer than three cameras stand in both, or all in one place.
    """
    common = _common(centre, known)
    if len(common) < 3:
        raise ValueError(
            f"camera centres: a similarity needs at least 3 cameras with known positions, got {len(common)}"
        )
    points = np.array([centre[c] for c in common])
    return centre_errors(centre, known, align_similarity(points, np.array([known[c] for c in common])))


def centre_errors(
    centre: Mapping[str, FloatArray], known: Mapping[str, FloatArray], known_from_world: Similarity
) -> CentreErrors:
    """Errors of centres (3,) by camera id under a given similarity.

    Raises ValueError when no camera stands in both.
    """
    common = _common(centre, known)
    if not common:
        raise ValueError("camera centres: none of the reconstructed cameras has a known position")
    distance = {c: float(np.linalg.norm(known_from_world.apply(centre[c]) - known[c])) for c in common}
    return CentreErrors(distance, known_from_world)


def _common(centre: Mapping[str, FloatArray], known: Mapping[str, FloatArray]) -> list[str]:
    return [camera for camera in known if camera in centre]
