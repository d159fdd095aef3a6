"""Which tracklets of an image path follow one another as one target's would: false blobs between them are left out."""

from __future__ import annotations

import numpy as np

from skytrace.estimation.correspond import ImagePath
from skytrace.geometry.arrays import BoolArray, FloatArray, IntArray

_LOOK_BACK = 40  # tracklets before one that may precede it
_FLOOR = 0.004  # on the plane z = 1: jumps below this say nothing


def main_strand(path: ImagePath) -> ImagePath:
    """The path with only the tracklets of the most plausible sequence; the others become gaps.

    A stuck blob or a passing bird begins and ends with a jump that the target's motion does not explain. The sequence
    kept is the one with most seconds of tracklets after each jump has cost it up to a few seconds, so that a blob
    that lasts longer than what it interrupts is kept: nothing in one camera tells which of the two is the target.
    """
    first, last = tracklet_pieces(path)
    if len(first) < 3:
        return path
    keep = best_sequence(*_ends(path, first, last))
    seen = np.zeros(path.coefficients.shape[1], bool)
    for k in np.flatnonzero(keep):
        seen[first[k] : last[k] + 1] = True
    return ImagePath(path.breaks_s, np.where(seen[None, :, None], path.coefficients, np.nan))


def tracklet_pieces(path: ImagePath) -> tuple[IntArray, IntArray]:
    """First and last spline piece (k,), (k,) of each uninterrupted stretch of a path."""
    seen = np.r_[False, np.isfinite(path.coefficients[0, :, 0]), False]
    step = np.diff(seen.astype(int))
    return np.flatnonzero(step == 1), np.flatnonzero(step == -1) - 1


def best_sequence(
    time_s: FloatArray, position: FloatArray, velocity: FloatArray, typical_speed: float, cost_s: float = 1.0
) -> BoolArray:
    """Which of k tracklets, in order of time, belong to the best sequence (k,).

    Times (k, 2), positions (k, 2, 2) and velocities (k, 2, 2) at both ends of each. A sequence is worth the seconds of
    its tracklets less `cost_s` ln(1 + z^2) for each step between them, z the distance to where constant velocity leads
    in units of what the target may stray at its typical speed.
    """
    n = len(time_s)
    duration = time_s[:, 1] - time_s[:, 0]
    worth, before = duration.copy(), np.full(n, -1)
    for k in range(1, n):
        j = np.arange(max(0, k - _LOOK_BACK), k)
        gap = np.maximum(time_s[k, 0] - time_s[j, 1], 0.0)
        middle = 0.5 * (velocity[j, 1] + velocity[k, 0])
        miss = np.linalg.norm(position[k, 0] - position[j, 1] - middle * gap[:, None], axis=1)
        z = miss / (_FLOOR + typical_speed * gap)
        total = worth[j] + duration[k] - cost_s * np.log1p(z**2)
        best = int(np.argmax(total))
        if total[best] > worth[k]:
            worth[k], before[k] = total[best], j[best]
    keep = np.zeros(n, bool)
    k = int(np.argmax(worth))
    while k >= 0:
        keep[k] = True
        k = int(before[k])
    return keep


def _ends(path: ImagePath, first: IntArray, last: IntArray) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Times, positions and velocities at both ends of the tracklets, and the path's typical speed.

    Velocities are means over up to half a second: the spline's own derivative at its end follows the noise.
    """
    begin, end = path.breaks_s[first], path.breaks_s[last + 1]
    inside = 1e-9 * np.maximum(1.0, np.abs(end))
    begin, end = begin + inside, end - inside
    span = np.minimum(0.5, end - begin)
    at = {name: path.evaluate(t) for name, t in (("a", begin), ("b", begin + span), ("c", end - span), ("d", end))}
    velocity = np.stack([at["b"] - at["a"], at["d"] - at["c"]], axis=1) / span[:, None, None]
    speed = np.linalg.norm(velocity, axis=2).mean(axis=1)
    weight = end - begin
    order = np.argsort(speed)
    reached = np.cumsum(weight[order]) / weight.sum()
    typical = float(speed[order][np.searchsorted(reached, 0.75)])
    return np.stack([begin, end], axis=1), np.stack([at["a"], at["d"]], axis=1), velocity, typical
