"""An evaluation as plain text."""

from __future__ import annotations

from math import isfinite

from skytrace.evaluation.cameras import CentreErrors, OrientationErrors
from skytrace.evaluation.clocks import SynchronisationErrors
from skytrace.evaluation.statistics import ErrorGroup, ErrorStatistics
from skytrace.evaluation.summary import Evaluation
from skytrace.evaluation.trajectory import TrajectoryEvaluation

_LABEL_WIDTH = 38


def format_table(evaluation: Evaluation, unit: str = "m") -> str:
    """The evaluation for reading; lengths in `unit`, the truth's own, but centimetres where that is metres."""
    factor, shown = (100.0, "cm") if unit == "m" else (1.0, unit)
    lines: list[str] = []
    if evaluation.trajectory is not None:
        lines += _trajectory_lines(evaluation.trajectory, factor, shown, unit)
    if evaluation.centres_aligned is not None:
        title = "Camera centres after aligning them"
        lines += _centre_lines(evaluation.centres_aligned, factor, f"{title} ({shown})")
    if evaluation.centres_in_truth_frame is not None:
        title = "Camera centres under the trajectory's alignment"
        lines += _centre_lines(evaluation.centres_in_truth_frame, factor, f"{title} ({shown})")
    if evaluation.orientations is not None:
        lines += _orientation_lines(evaluation.orientations)
    if evaluation.synchronisation is not None:
        lines += _synchronisation_lines(evaluation.synchronisation)
    lines += [f"Note: {note}" for note in evaluation.notes]
    return "\n".join(lines).strip("\n") + "\n"


def _trajectory_lines(evaluation: TrajectoryEvaluation, factor: float, shown: str, unit: str) -> list[str]:
    complete, kept = evaluation.complete, evaluation.without_large
    names = ("mean", "RMSE", "median", "max", ">3 RMSE", "N")
    lines = [f"{f'Trajectory error ({shown})':<{_LABEL_WIDTH}}" + "".join(f"{name:>9}" for name in names)]
    lines.append(_row("all covered samples", complete.statistics, factor))
    lines.append(_row(f"{kept.n_dropped} above 10 x mean dropped", kept.statistics, factor))
    lines += [_row(f"  seen by {_cameras(group)}", group.statistics, factor) for group in complete.by_n_cameras]
    for group in complete.by_sigma:
        label = f"  deviation {factor * group.low:.3g} to {factor * group.high:.3g} {shown}"
        lines.append(_row(label, group.statistics, factor))
    if complete.velocity is not None:
        lines.append(_row(f"velocity ({shown}/s)", complete.velocity, factor))
    clock = kept.clock
    uncertainty = f" +- {1e3 * clock.shift_sd_s:.2g} ms" if isfinite(clock.shift_sd_s) else ", undetermined"
    share = 100 * complete.statistics.n / complete.n_total
    lines += [
        f"Covered: {complete.statistics.n} of {complete.n_total} truth samples ({share:.0f} %)",
        f"Truth's clock: first sample at {clock.offset_s:.4f} s{uncertainty}, "
        f"rate off by {1e6 * (clock.scale - 1):+.0f} ppm",
        f"Scale: {kept.truth_from_world.scale:.6g} {unit} per unit of the reconstruction",
        "",
    ]
    return lines


def _row(label: str, statistics: ErrorStatistics, factor: float) -> str:
    lengths = (statistics.mean, statistics.rmse, statistics.median, statistics.max)
    cells = "".join(f"{factor * value:>9.2f}" for value in lengths)
    return f"{label:<{_LABEL_WIDTH}}{cells}{statistics.outlier_percent:>7.1f} %{statistics.n:>9d}"


def _cameras(group: ErrorGroup) -> str:
    return f"{group.low:.0f} camera{'' if group.low == 1 else 's'}"


def _centre_lines(errors: CentreErrors, factor: float, title: str) -> list[str]:
    lines = [title, f"  mean {factor * errors.mean:.2f}, max {factor * errors.max:.2f}"]
    lines += [f"  {camera:<{_LABEL_WIDTH - 2}}{factor * distance:>9.2f}" for camera, distance in errors.error.items()]
    return [*lines, ""]


def _orientation_lines(errors: OrientationErrors) -> list[str]:
    lines = ["Camera orientations after aligning them (degrees)"]
    lines.append(f"  mean {errors.mean_deg:.3f}, max {errors.max_deg:.3f}")
    lines += [f"  {camera:<{_LABEL_WIDTH - 2}}{angle:>9.3f}" for camera, angle in errors.error_deg.items()]
    return [*lines, ""]


def _synchronisation_lines(errors: SynchronisationErrors) -> list[str]:
    names = ("mean ms", "max ms", "frames", "@30 fps")
    lines = [f"{f'Synchronisation with {errors.base}':<{_LABEL_WIDTH}}" + "".join(f"{name:>9}" for name in names)]
    for camera, e in errors.error.items():
        cells = f"{1e3 * e.mean_s:>9.2f}{1e3 * e.max_s:>9.2f}{e.mean_base_frames:>9.2f}{e.mean_frames_30fps:>9.2f}"
        lines.append(f"  {camera:<{_LABEL_WIDTH - 2}}{cells}")
    cells = f"{1e3 * errors.mean_s:>9.2f}{1e3 * errors.max_s:>9.2f}"
    cells += f"{errors.mean_base_frames:>9.2f}{errors.mean_frames_30fps:>9.2f}"
    return [*lines, f"  {'all':<{_LABEL_WIDTH - 2}}{cells}", ""]
