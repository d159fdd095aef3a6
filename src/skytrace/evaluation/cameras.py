"""Distance of reconstructed camera centres from surveyed ones, and angles between orientations and known ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from skytrace.geometry.arrays import FloatArray, frozen_array
from skytrace.geometry.rigid import Similarity, align_similarity, nearest_rotation, so3_log


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


@dataclass(frozen=True, eq=False, slots=True)
class OrientationErrors:
    """Angles in degrees between orientations and known ones, after the rotation that fits them best."""

    error_deg: Mapping[str, float]  # camera id -> angle
    known_from_world: FloatArray  # (3, 3)

    def __post_init__(self) -> None:
        object.__setattr__(self, "error_deg", MappingProxyType(dict(self.error_deg)))
        object.__setattr__(self, "known_from_world", frozen_array(self.known_from_world, (3, 3), "known_from_world"))

    @property
    def mean_deg(self) -> float:
        return float(np.mean(list(self.error_deg.values())))

    @property
    def max_deg(self) -> float:
        return float(np.max(list(self.error_deg.values())))


def orientation_errors(
    camera_from_world: Mapping[str, FloatArray], camera_from_known: Mapping[str, FloatArray]
) -> OrientationErrors:
    """Errors of rotations (3, 3) by camera id, the worlds turned onto each other by the chordal mean of all cameras.

    Hartley et al., "Rotation averaging", IJCV 2013, section 5. Raises ValueError when fewer than two cameras stand in
    both: a single one can always be turned to fit.
    """
    common = _common(camera_from_world, camera_from_known)
    if len(common) < 2:
        raise ValueError(
            f"camera orientations: at least 2 cameras with a known orientation are needed, got {len(common)}"
        )
    turns = np.sum([camera_from_known[c].T @ camera_from_world[c] for c in common], axis=0)
    known_from_world = nearest_rotation(turns)
    angles = {c: _angle_deg(camera_from_world[c] @ known_from_world.T @ camera_from_known[c].T) for c in common}
    return OrientationErrors(angles, known_from_world)


def _angle_deg(rotation: FloatArray) -> float:
    return float(np.degrees(np.linalg.norm(so3_log(rotation))))


def _common(centre: Mapping[str, FloatArray], known: Mapping[str, FloatArray]) -> list[str]:
    return [camera for camera in known if camera in centre]
