"""What a synchronisation rests on, in curves: the score of every offset, epipolar errors, who saw the target when."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from skytrace.estimation import two_view
from skytrace.estimation.correspond import ImagePath, common_grid
from skytrace.estimation.offset_search import peaks, score_shifts
from skytrace.estimation.strand import main_strand, tracklet_pieces
from skytrace.estimation.sync_settings import SyncSettings
from skytrace.estimation.synchronize import PairEvidence, Synchronisation
from skytrace.geometry import epipolar
from skytrace.geometry.arrays import FloatArray, frozen_array
from skytrace.geometry.rigid import Rigid


@dataclass(frozen=True, eq=False, slots=True)
class Sight:
    """When a camera filmed and when it saw the target, in its own time."""

    filmed_s: tuple[float, float]  # from its first to its last usable detection
    seen_s: FloatArray  # (k, 2) begin and end, short gaps closed

    def __post_init__(self) -> None:
        object.__setattr__(self, "seen_s", frozen_array(self.seen_s, (None, 2), "seen_s"))


@dataclass(frozen=True, eq=False, slots=True)
class ScoreCurve:
    """The score of every offset of two cameras that leaves enough overlap; see `offset_search.score_shifts`."""

    offset_s: FloatArray  # (m,) ascending; camera time 1 = offset_s + rate * camera time 0
    score: FloatArray  # (m,)
    overlap_s: FloatArray  # (m,)
    chance: float  # best score with one track run backwards, NaN where no offset leaves enough overlap

    def __post_init__(self) -> None:
        object.__setattr__(self, "offset_s", frozen_array(self.offset_s, (None,), "offset_s"))
        n = len(self.offset_s)
        object.__setattr__(self, "score", frozen_array(self.score, (n,), "score"))
        object.__setattr__(self, "overlap_s", frozen_array(self.overlap_s, (n,), "overlap_s"))

    @property
    def step_s(self) -> float:
        """The step of the grid, of which offsets without enough overlap are missing."""
        return float(np.diff(self.offset_s).min()) if len(self.offset_s) > 1 else float("inf")

    def score_at(self, offset_s: float) -> float | None:
        """The score on the grid next to an offset, None where it leaves too little overlap."""
        if not len(self.offset_s):
            return None
        nearest = int(np.argmin(np.abs(self.offset_s - offset_s)))
        return float(self.score[nearest]) if abs(self.offset_s[nearest] - offset_s) <= self.step_s else None


@dataclass(frozen=True, eq=False, slots=True)
class EpipolarErrors:
    """Sampson errors of a pair at the same times, without and with the refinement of offset, rate and pose."""

    time_s: FloatArray  # (n,) camera time 0
    before: FloatArray  # (n,) absolute, on the plane z = 1; NaN where the unrefined offset pairs nothing
    after: FloatArray  # (n,)

    def __post_init__(self) -> None:
        object.__setattr__(self, "time_s", frozen_array(self.time_s, (None,), "time_s"))
        n = len(self.time_s)
        object.__setattr__(self, "before", frozen_array(self.before, (n,), "before", finite=False))
        object.__setattr__(self, "after", frozen_array(self.after, (n,), "after"))


@dataclass(frozen=True, eq=False, slots=True)
class PairCurves:
    """Two cameras: the search over all offsets and what its chosen offset leaves of the epipolar error.

    `chosen_s` lies on the curve's axis, which for clocks of different rates is the offset in the middle of the overlap;
    None where no offset was plausible. `rank` counts the chosen offset's place among the curve's summits from 1, None
    where it is none of the best that were looked at. `joint_s` is, on the same axis, what the joint clocks of all
    cameras say, None for cameras that are not tied together.
    """

    camera0: str
    camera1: str
    curve: ScoreCurve
    chosen_s: float | None = None
    rank: int | None = None
    joint_s: float | None = None
    errors: EpipolarErrors | None = None


@dataclass(frozen=True, eq=False, slots=True)
class SyncCurves:
    """Everything a picture of a synchronisation is drawn from: every camera and every pair of them."""

    sights: Mapping[str, Sight]
    pairs: tuple[PairCurves, ...]


def sync_curves(paths: Mapping[str, ImagePath], found: Synchronisation, settings: SyncSettings) -> SyncCurves:
    """The curves behind what `synchronize` or `weigh_offsets` found from the same paths and settings."""
    strands = {c: main_strand(path) for c, path in paths.items()}
    evidence = {(p.camera0, p.camera1): p for p in found.evidence}
    pairs = [_pair_curves(strands, a, b, evidence.get((a, b)), found, settings) for a, b in combinations(paths, 2)]
    return SyncCurves({c: sight(path) for c, path in strands.items()}, tuple(pairs))


def sight(path: ImagePath, closed_s: float = 0.5) -> Sight:
    """When a path is defined, gaps of up to `closed_s` closed."""
    first, last = tracklet_pieces(path)
    begin, end = path.breaks_s[first], path.breaks_s[last + 1]
    apart = begin[1:] - end[:-1] > closed_s
    seen = np.column_stack([begin[np.r_[True, apart]], end[np.r_[apart, True]]])
    return Sight((path.begin_s, path.end_s), seen)


def score_curve(path0: ImagePath, path1: ImagePath, settings: SyncSettings, rate: float = 1.0) -> ScoreCurve:
    """The algebraic score at every offset, with camera 1's clock running at `rate` by camera 0's."""
    grid0, grid1 = common_grid([path0, path1.stretched(1 / rate)], settings.rate_hz)
    if not all(np.isfinite(xy[:, 0]).any() for _, xy in (grid0, grid1)):
        nothing = np.zeros(0)
        return ScoreCurve(nothing, nothing, nothing, float("nan"))
    found = score_shifts(grid0[1], grid1[1], settings.rate_hz, settings.min_overlap_s)
    backwards = score_shifts(grid0[1], grid1[1][::-1], settings.rate_hz, settings.min_overlap_s)
    return ScoreCurve(
        rate * (found.shift / settings.rate_hz + grid1[0] - grid0[0]),
        found.score,
        found.overlap / settings.rate_hz,
        float(backwards.score.max()) if len(backwards.score) else float("nan"),
    )


def epipolar_errors(
    path0: ImagePath,
    path1: ImagePath,
    offset_s: float,
    rate: float,
    unrefined_s: float,
    unrefined_rate: float,
    settings: SyncSettings,
    max_samples: int = 2000,
) -> EpipolarErrors | None:
    """Errors at a refined offset and rate, and with a five-point pose at the unrefined ones that the search gave.

    Both poses are those that fit best there. None where either leaves no pose at all.
    """
    before = _five_point(path0, path1, unrefined_s, unrefined_rate, settings)
    after = _refined(path0, path1, offset_s, rate, settings)
    if before is None or after is None:
        return None
    time_s = two_view.common_times(path0, path1, settings.rate_hz, after.offset_s, after.rate)
    time_s = two_view.evenly(time_s, max_samples)
    errors = EpipolarErrors(
        time_s,
        _errors(path0, path1, before, time_s, unrefined_s, unrefined_rate),
        _errors(path0, path1, after.camera1_from_camera0, time_s, after.offset_s, after.rate),
    )
    return errors if np.isfinite(errors.before).any() else None


_GROSS_RATE = 5e-3  # beyond what the search bears and no clock drifts: the nominal frame rate is another


def _pair_curves(
    paths: Mapping[str, ImagePath],
    a: str,
    b: str,
    pair: PairEvidence | None,
    found: Synchronisation,
    settings: SyncSettings,
) -> PairCurves:
    path0, path1, joint = paths[a], paths[b], _joint(a, b, found)
    chosen = None if pair is None else (pair.offset_s, pair.rate)
    rate = next((relation[1] for relation in (chosen, joint) if relation is not None), 1.0)
    searched_rate = rate if abs(rate - 1) > _GROSS_RATE else 1.0
    curve = score_curve(path0, path1, settings, searched_rate)

    def on_axis(relation: tuple[float, float]) -> float:
        time_s = two_view.common_times(path0, path1, settings.rate_hz, *relation)
        return relation[0] + (relation[1] - searched_rate) * (float(np.median(time_s)) if len(time_s) else 0.0)

    joint_s = None if joint is None else on_axis(joint)
    if chosen is None:
        return PairCurves(a, b, curve, joint_s=joint_s)
    chosen_s = on_axis(chosen)
    summit_s, rank = _summit(curve, chosen_s, settings)
    errors = epipolar_errors(path0, path1, *chosen, summit_s, searched_rate, settings)
    return PairCurves(a, b, curve, chosen_s, rank, joint_s, errors)


def _joint(a: str, b: str, found: Synchronisation) -> tuple[float, float] | None:
    """Camera time of b = offset + rate * camera time of a by the joint clocks."""
    for group in found.groups:
        if a in group and b in group:
            (offset0, rate0), (offset1, rate1) = group[a], group[b]
            return (offset0 - offset1) / rate1, rate0 / rate1
    return None


def _summit(curve: ScoreCurve, offset_s: float, settings: SyncSettings) -> tuple[float, int | None]:
    """The offset on the search's grid that stands for `offset_s`, and its place among the best summits."""
    reach_s = settings.distinct_s
    separation = max(1, round(settings.distinct_s * settings.rate_hz))
    summits = peaks(
        curve.score, np.rint(curve.offset_s * settings.rate_hz).astype(np.int64), settings.candidates, separation
    )
    for place, k in enumerate(summits):
        if abs(curve.offset_s[k] - offset_s) <= reach_s:
            return float(curve.offset_s[k]), place + 1
    if not len(curve.offset_s):
        return offset_s, None
    return float(curve.offset_s[np.argmin(np.abs(curve.offset_s - offset_s))]), None


def _five_point(path0: ImagePath, path1: ImagePath, offset_s: float, rate: float, settings: SyncSettings):
    """The pose by which the search verifies an offset."""
    sample = two_view.correspond(path0, path1, settings.rate_hz, offset_s, rate, settings.verify_samples)
    return two_view.five_point_pose(
        sample, settings.verify_threshold, seed=0, max_samples=settings.verify_iterations, min_samples=50
    )


def _refined(
    path0: ImagePath, path1: ImagePath, offset_s: float, rate: float, settings: SyncSettings
) -> two_view.PairGeometry | None:
    """The geometry at an offset that is refined already: offset and rate come back as they were, with their pose."""
    pose = _five_point(path0, path1, offset_s, rate, settings)
    if pose is None:
        return None
    return two_view.refine(
        path0,
        path1,
        pose,
        offset_s,
        rate,
        rate_hz=settings.rate_hz,
        thresholds=settings.refine_thresholds,
        rate_prior=settings.rate_prior,
        adapt=True,
    )


def _errors(
    path0: ImagePath, path1: ImagePath, pose: Rigid, time0_s: FloatArray, offset_s: float, rate: float
) -> FloatArray:
    xy0, xy1 = path0.evaluate(time0_s), path1.evaluate(offset_s + rate * time0_s)
    return np.abs(epipolar.sampson_error(epipolar.essential_matrix(pose), xy0, xy1))
