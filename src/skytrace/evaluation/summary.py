"""Everything that can be judged of a run, in one object."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

from skytrace.evaluation.cameras import (
    CentreErrors,
    OrientationErrors,
    aligned_centre_errors,
    centre_errors,
    orientation_errors,
)
from skytrace.evaluation.clocks import SynchronisationErrors, synchronisation_errors
from skytrace.evaluation.path import SampledPath
from skytrace.evaluation.search import CHANCE_LEVEL
from skytrace.evaluation.statistics import ErrorGroup, ErrorStatistics
from skytrace.evaluation.trajectory import MAX_SCALE_ERROR, TrajectoryErrors, TrajectoryEvaluation, evaluate_trajectory
from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import Similarity
from skytrace.model.camera import Clock

_RIVAL_WARNING = 0.9
_SHIFT_WARNING_S = 0.02


@dataclass(frozen=True, eq=False, slots=True)
class Evaluation:
    """What was compared; none stands for what could not be, or was not asked for. `notes` are sentences for people."""

    trajectory: TrajectoryEvaluation | None = None
    centres_aligned: CentreErrors | None = None  # the centres fitted to the known positions by themselves
    centres_in_truth_frame: CentreErrors | None = None  # under the trajectory's similarity
    synchronisation: SynchronisationErrors | None = None
    orientations: OrientationErrors | None = None  # the rotations fitted to the known ones by themselves
    notes: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers, lists and strings for JSON, without the errors of single samples; infinite becomes None."""
        out: dict[str, Any] = {"notes": list(self.notes)}
        if self.trajectory is not None:
            out["trajectory"] = {
                "all": _errors_dict(self.trajectory.complete),
                "without_errors_above_10_means": _errors_dict(self.trajectory.without_large),
                "rival_score": self.trajectory.rival_score,
            }
        if self.centres_aligned is not None:
            out["camera_centres_aligned"] = _centres_dict(self.centres_aligned)
        if self.centres_in_truth_frame is not None:
            out["camera_centres_in_truth_frame"] = _centres_dict(self.centres_in_truth_frame)
        if self.orientations is not None:
            out["camera_orientations_aligned"] = {
                "mean_deg": self.orientations.mean_deg,
                "max_deg": self.orientations.max_deg,
                "by_camera_deg": dict(self.orientations.error_deg),
            }
        if self.synchronisation is not None:
            out["synchronisation"] = _synchronisation_dict(self.synchronisation)
        return out


def evaluate(
    path: SampledPath,
    *,
    truth: FloatArray | None = None,
    rate_hz: float | None = None,
    centres: Mapping[str, FloatArray] | None = None,
    known_centres: Mapping[str, FloatArray] | None = None,
    centres_share_truth_frame: bool = False,
    rotations: Mapping[str, FloatArray] | None = None,
    known_rotations: Mapping[str, FloatArray] | None = None,
    clocks: Mapping[str, Clock] | None = None,
    known_synchronisation: Mapping[str, tuple[float, float]] | None = None,
    row_fraction: float = 0.5,
) -> Evaluation:
    """Judge a run by whatever is known: true positions (m, 3) at `rate_hz`, camera centres (3,) and
    camera_from_world rotations (3, 3) by camera id, corresponding frames.

    `centres_share_truth_frame` says that the known centres and the true path were surveyed in one frame. Centres or
    clocks that cannot be judged end in a note. Raises ValueError when the path and the truth cannot be brought to
    overlap (`evaluate_trajectory`), or the truth comes without its rate.
    """
    notes: list[str] = []
    trajectory = aligned = in_truth_frame = orientations = synchronisation = None
    if truth is not None:
        if rate_hz is None:
            raise ValueError("rate_hz: expected the truth's sampling rate")
        trajectory = evaluate_trajectory(path, truth, rate_hz)
        notes += _trajectory_notes(trajectory, path.covered_s * rate_hz)
    if known_centres is not None:
        notes += _absent("known position", known_centres, centres or {})
        try:
            aligned = aligned_centre_errors(centres or {}, known_centres)
            if trajectory is not None and centres_share_truth_frame:
                similarity = trajectory.without_large.truth_from_world
                in_truth_frame = centre_errors(centres or {}, known_centres, similarity)
        except ValueError as error:
            notes.append(str(error))
    if known_rotations is not None:
        notes += _absent("known orientation", known_rotations, rotations or {})
        try:
            orientations = orientation_errors(rotations or {}, known_rotations)
        except ValueError as error:
            notes.append(str(error))
    if known_synchronisation is not None:
        notes += _absent("known synchronisation", known_synchronisation, clocks or {})
        try:
            synchronisation = synchronisation_errors(
                clocks or {}, known_synchronisation, path.even_times(10.0), row_fraction
            )
        except ValueError as error:
            notes.append(str(error))
    return Evaluation(trajectory, aligned, in_truth_frame, synchronisation, orientations, tuple(notes))


def _trajectory_notes(evaluation: TrajectoryEvaluation, n_possible: float) -> list[str]:
    errors, notes = evaluation.without_large, []
    if errors.unexplained > CHANCE_LEVEL:
        share = f"{100 * errors.unexplained:.0f} %"
        notes.append(
            f"the errors are {share} of the truth's variance: reconstruction and truth may not belong together"
        )
    if evaluation.complete.statistics.n < 0.5 * min(n_possible, evaluation.complete.n_total):
        notes.append("the matched stretch is less than half of what could overlap: it may match by chance")
    if evaluation.rival_score > _RIVAL_WARNING:
        notes.append("another offset of the truth's clock fits nearly as well: the errors may belong to a wrong one")
    if abs(errors.clock.scale - 1) > 0.999 * MAX_SCALE_ERROR:
        notes.append("the truth's clock scale stopped at its limit of 1 %: check the sampling rate given for the truth")
    if errors.clock.shift_sd_s > _SHIFT_WARNING_S:
        notes.append("the motion hardly determines the truth's clock: too short, too slow, or the same everywhere")
    return notes


def _absent(what: str, known: Mapping[str, object], reconstructed: Mapping[str, object]) -> list[str]:
    missing = [camera for camera in known if camera not in reconstructed]
    return [f"cameras with {what} that were not reconstructed: {', '.join(missing)}"] if missing else []


def _number(value: float) -> float | None:
    return float(value) if isfinite(value) else None


def _statistics_dict(statistics: ErrorStatistics) -> dict[str, Any]:
    return {name: getattr(statistics, name) for name in ErrorStatistics.__slots__}


def _groups_list(groups: tuple[ErrorGroup, ...]) -> list[dict[str, Any]]:
    return [{"low": g.low, "high": g.high, **_statistics_dict(g.statistics)} for g in groups]


def _similarity_dict(similarity: Similarity) -> dict[str, Any]:
    return {
        "scale": similarity.scale,
        "rotation": similarity.rotation.tolist(),
        "translation": similarity.translation.tolist(),
    }


def _errors_dict(errors: TrajectoryErrors) -> dict[str, Any]:
    return {
        **_statistics_dict(errors.statistics),
        "n_total": errors.n_total,
        "n_dropped": errors.n_dropped,
        "unexplained": errors.unexplained,
        "clock": {
            "offset_s": errors.clock.offset_s,
            "scale": errors.clock.scale,
            "shift_sd_s": _number(errors.clock.shift_sd_s),
            "scale_sd": _number(errors.clock.scale_sd),
        },
        "truth_from_world": _similarity_dict(errors.truth_from_world),
        "velocity": None if errors.velocity is None else _statistics_dict(errors.velocity),
        "by_n_cameras": _groups_list(errors.by_n_cameras),
        "by_posterior_deviation": _groups_list(errors.by_sigma),
    }


def _centres_dict(errors: CentreErrors) -> dict[str, Any]:
    return {
        "mean": errors.mean,
        "max": errors.max,
        "by_camera": dict(errors.error),
        "known_from_world": _similarity_dict(errors.known_from_world),
    }


def _synchronisation_dict(errors: SynchronisationErrors) -> dict[str, Any]:
    by_camera = {
        camera: {
            "mean_s": e.mean_s,
            "median_s": e.median_s,
            "max_s": e.max_s,
            "mean_base_frames": e.mean_base_frames,
            "mean_own_frames": e.mean_own_frames,
            "mean_frames_30fps": e.mean_frames_30fps,
        }
        for camera, e in errors.error.items()
    }
    return {
        "base": errors.base,
        "mean_s": errors.mean_s,
        "median_s": errors.median_s,
        "max_s": errors.max_s,
        "mean_base_frames": errors.mean_base_frames,
        "mean_frames_30fps": errors.mean_frames_30fps,
        "by_camera": by_camera,
    }
