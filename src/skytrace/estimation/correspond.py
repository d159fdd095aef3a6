"""Where a camera saw the target at a time between its frames: local splines through each tracklet.

Li et al. 2020, section III-A: the detections of the other camera are interpolated by a spline in time, so that any
frame of one camera has a correspondence in the other, and never across a gap in the detections.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import factorial

import numpy as np

from skytrace.geometry.arrays import BoolArray, FloatArray
from skytrace.model.track import Recording


@dataclass(frozen=True, eq=False, slots=True)
class ImagePath:
    """The target's image path on the plane z = 1 as a function of the camera's own time; NaN where not seen.

    Camera time is the camera's clock (time stamp, or frame / nominal rate) plus the assumed readout delay of the row.
    """

    breaks_s: FloatArray  # (m + 1,)
    coefficients: FloatArray  # (4, m, 2) of powers of (t - break), highest first; NaN on the pieces between tracklets

    @property
    def begin_s(self) -> float:
        return float(self.breaks_s[0])

    @property
    def end_s(self) -> float:
        return float(self.breaks_s[-1])

    @property
    def seen_s(self) -> float:
        """Seconds during which the target was seen."""
        return float(np.diff(self.breaks_s)[np.isfinite(self.coefficients[0, :, 0])].sum())

    def stretched(self, factor: float) -> ImagePath:
        """The same path on a clock that runs `factor` times as fast."""
        powers = np.array([3, 2, 1, 0])[:, None, None]
        return ImagePath(self.breaks_s * factor, self.coefficients / factor**powers)

    def clipped(self, begin_s: float, end_s: float) -> ImagePath:
        """The pieces of the path that touch an interval of camera time; the path itself where that is all of it."""
        if begin_s <= self.begin_s and end_s >= self.end_s:
            return self
        last = len(self.breaks_s) - 2
        a, b = np.clip(np.searchsorted(self.breaks_s, [begin_s, end_s], side="right") - 1, 0, last)
        return ImagePath(self.breaks_s[a : b + 2], self.coefficients[:, a : b + 1])

    def defined(self, camera_time_s: FloatArray) -> BoolArray:
        """Whether the target was seen at camera times (n,)."""
        piece = np.clip(np.searchsorted(self.breaks_s, camera_time_s, side="right") - 1, 0, len(self.breaks_s) - 2)
        seen = np.isfinite(self.coefficients[0, :, 0])[piece]
        return seen & (camera_time_s >= self.breaks_s[0]) & (camera_time_s <= self.breaks_s[-1])

    def evaluate(self, camera_time_s: FloatArray, derivative: int = 0) -> FloatArray:
        """Coordinates (n, 2), or their derivative per second, at camera times (n,)."""
        t = np.asarray(camera_time_s, float)
        piece = np.clip(np.searchsorted(self.breaks_s, t, side="right") - 1, 0, len(self.breaks_s) - 2)
        s = (t - self.breaks_s[piece])[:, None]
        c3, c2, c1, c0 = self.coefficients[:, piece]
        if derivative == 0:
            value = ((c3 * s + c2) * s + c1) * s + c0
        elif derivative == 1:
            value = (3 * c3 * s + 2 * c2) * s + c1
        else:
            raise ValueError(f"derivative: expected 0 or 1, got {derivative}")
        outside = (t < self.breaks_s[0]) | (t > self.breaks_s[-1])
        return np.where(outside[:, None], np.nan, value)


def image_path(
    recording: Recording, readout_fraction: float, knot_spacing_s: float = 0.1, samples_per_knot: int = 2
) -> ImagePath:
    """Least-squares cubic splines through a recording's tracklets of at least four detections each.

    Knots lie on detections, at least `knot_spacing_s` and `samples_per_knot` detections apart: pixel quantisation is
    averaged where frames are dense and nothing is lost where they are not. Raises ValueError without a usable tracklet.
    """
    breaks: list[FloatArray] = []
    pieces: list[FloatArray] = []
    for track in recording.tracks:
        xy_norm, valid = recording.intrinsics.undistort(track.xy_px)
        row = track.xy_px[:, 1] / recording.intrinsics.height_px
        t = recording.camera_time_s(track) + readout_fraction / recording.frame_rate_hz * row
        order = np.argsort(t, kind="stable")
        t, xy_norm = t[order][valid[order]], xy_norm[order][valid[order]]
        if len(t) < 4 or (np.diff(t) <= 0).any():
            continue
        x, c = _fit_pieces(t, xy_norm, knot_spacing_s, samples_per_knot)
        if breaks:
            pieces.append(np.full((4, 1, 2), np.nan))
        breaks.append(x)
        pieces.append(c)
    if not breaks:
        raise ValueError(f"recording {recording.camera_id}: no tracklet of at least four detections")
    return ImagePath(np.concatenate(breaks), np.concatenate(pieces, axis=1))


def _fit_pieces(t: FloatArray, xy: FloatArray, spacing_s: float, per_knot: int) -> tuple[FloatArray, FloatArray]:
    """Breaks (m + 1,) and polynomial coefficients (4, m, 2) of a least-squares cubic spline through one tracklet."""
    from scipy.interpolate import make_lsq_spline

    knots = _knots_on_samples(t, spacing_s, per_knot)
    spline = make_lsq_spline(t, xy, np.r_[[t[0]] * 4, knots, [t[-1]] * 4], k=3)
    breaks = np.r_[t[0], knots, t[-1]]
    return breaks, np.stack([spline(breaks[:-1], nu=k) / factorial(k) for k in (3, 2, 1, 0)])


def _knots_on_samples(t: FloatArray, spacing_s: float, per_knot: int) -> FloatArray:
    """Interior knots at samples, leaving two samples free at either end so that the fit stays determined."""
    knots: list[float] = []
    last = 0
    for i in range(2, len(t) - 2):
        if i - last >= per_knot and t[i] - t[last] >= spacing_s and t[-1] - t[i] >= 0.5 * spacing_s:
            knots.append(t[i])
            last = i
    return np.array(knots)


def common_grid(paths: Sequence[ImagePath], rate_hz: float) -> list[tuple[float, FloatArray]]:
    """Each path sampled at multiples of 1 / rate on its own clock: (time of the first sample, coordinates (n, 2))."""
    out = []
    for path in paths:
        first, last = np.ceil(path.begin_s * rate_hz), np.floor(path.end_s * rate_hz)
        times = np.arange(first, last + 1) / rate_hz
        out.append((first / rate_hz, path.evaluate(times)))
    return out
