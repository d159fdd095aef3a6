"""Weighted least squares over similarities, for points, lengths and directions of a scene that are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import Similarity, align_similarity, hat, so3_exp

_UPRIGHT = 1.0  # radians: how far people hold cameras from upright, which decides only what nothing else does
_ITERATIONS = 30
_YAWS = 6


@dataclass(frozen=True, eq=False, slots=True)
class PointItem:
    """A point of the scene whose position is known."""

    name: str
    at: FloatArray  # (3,) in the scene
    covariance: FloatArray  # (3, 3) of the scene there
    position_m: FloatArray  # (3,)
    sigma_m: FloatArray  # (3,)

    degrees = 3


@dataclass(frozen=True, eq=False, slots=True)
class LengthItem:
    """The known length of a vector of the scene."""

    name: str
    vector: FloatArray  # (3,) in the scene
    covariance: FloatArray  # (3, 3)
    metres: float
    sigma_m: float

    degrees = 1


@dataclass(frozen=True, eq=False, slots=True)
class UpItem:
    """A direction of the scene that is known to point up, along z."""

    name: str
    direction: FloatArray  # (3,) unit, in the scene
    sigma_rad: float

    degrees = 2


Item = PointItem | LengthItem | UpItem


@dataclass(frozen=True, eq=False, slots=True)
class Solved:
    """A similarity and how well it fits."""

    move: Similarity
    items: tuple[Item, ...]
    chi2: float
    redundancy: int  # degrees of freedom that are not spent on the similarity


@dataclass(frozen=True, eq=False, slots=True)
class SimilarityProblem:
    """What is fitted beside the items: `upright` (3,) probably points up; without scale the scene is in metres."""

    upright: FloatArray | None
    with_scale: bool

    def rows(self, move: Similarity, item: Item) -> tuple[FloatArray, FloatArray]:
        """Residuals (k,) in deviations and their derivatives (k, 7) by a similarity applied after `move`."""
        J = np.zeros((1 if isinstance(item, LengthItem) else 3, 7))
        turn = move.scale * move.rotation
        if isinstance(item, PointItem):
            at = move.apply(item.at)
            spread = np.diag(item.sigma_m**2) + turn @ item.covariance @ turn.T
            whiten = np.linalg.inv(np.linalg.cholesky(spread))
            J[:, :3], J[:, 3:6], J[:, 6] = np.eye(3), -hat(at), at
            r = whiten @ (at - item.position_m)
            J = whiten @ J
        elif isinstance(item, LengthItem):
            vector = turn @ item.vector
            length = float(np.linalg.norm(vector))
            along = vector / max(length, 1e-300)
            sigma = np.sqrt(item.sigma_m**2 + along @ turn @ item.covariance @ turn.T @ along)
            r, J[0, 6] = np.array([(length - item.metres) / sigma]), length / sigma
        else:
            up = move.rotation @ item.direction
            r = (up - [0.0, 0.0, 1.0]) / item.sigma_rad
            J[:, 3:6] = -hat(up) / item.sigma_rad
        if not self.with_scale:
            J[:, 6] = 0.0
        return r, J

    def solve(self, items: tuple[Item, ...]) -> Solved:
        """The best of the solutions from several starts."""
        weighed = items if self.upright is None else (*items, UpItem("", self.upright, _UPRIGHT))
        candidates = [self._descend(start, weighed) for start in self._starts(items)]
        move = min(candidates, key=lambda c: c[1])[0]
        r, J = self.stacked(move, items)
        degrees = sum(item.degrees for item in items)
        return Solved(move, items, float(r @ r), degrees - int(np.linalg.matrix_rank(J, 1e-6 * np.abs(J).max())))

    def stacked(self, move: Similarity, items: tuple[Item, ...]) -> tuple[FloatArray, FloatArray]:
        rows = [self.rows(move, item) for item in items]
        return np.concatenate([r for r, _ in rows]), np.concatenate([J for _, J in rows])

    def _descend(self, move: Similarity, items: tuple[Item, ...]) -> tuple[Similarity, float]:
        """Gauss-Newton with steps of least norm, halved until they improve."""
        r, J = self.stacked(move, items)
        cost = float(r @ r)
        for _ in range(_ITERATIONS):
            size = np.linalg.norm(J, axis=0)
            size[size == 0] = 1.0
            step = np.linalg.lstsq(J / size, -r, rcond=1e-9)[0] / size
            for halving in range(12):
                after = composed(0.5**halving * step, move)
                trial_r, trial_J = self.stacked(after, items)
                if trial_r @ trial_r < cost:
                    break
            else:
                return move, cost
            gain, move, r, J = cost - float(trial_r @ trial_r), after, trial_r, trial_J
            cost = float(r @ r)
            if gain < 1e-12 * cost + 1e-15:
                break
        return move, cost

    def _starts(self, items: tuple[Item, ...]) -> list[Similarity]:
        points = [i for i in items if isinstance(i, PointItem)]
        at = np.array([i.at for i in points]).reshape(-1, 3)
        given = np.array([i.position_m for i in points]).reshape(-1, 3)
        scale = self._scale(items, at, given)
        moves = []
        if len(points) >= 3 and np.ptp(at, axis=0).max() > 0 and np.ptp(given, axis=0).max() > 0:
            weights = np.array([1 / float(np.mean(i.sigma_m**2)) for i in points])
            close = align_similarity(at, given, weights, self.with_scale)
            if close.scale > 1e-6 * scale:
                moves.append(close)
        ups = [i.direction / i.sigma_rad**2 for i in items if isinstance(i, UpItem)]
        guess = self.upright if self.upright is not None else np.array([0.0, 0.0, 1.0])
        level = _taking_to_z(np.sum(ups, axis=0) if ups else guess)
        for k in range(_YAWS if len(points) > 1 else 1):
            R = so3_exp(np.array([0.0, 0.0, 2 * np.pi * k / _YAWS])) @ level
            offset = given.mean(axis=0) - scale * R @ at.mean(axis=0) if points else np.zeros(3)
            moves.append(Similarity(scale, R, offset))
        return moves

    def _scale(self, items: tuple[Item, ...], at: FloatArray, given: FloatArray) -> float:
        if not self.with_scale:
            return 1.0
        ratios = [i.metres / max(float(np.linalg.norm(i.vector)), 1e-300) for i in items if isinstance(i, LengthItem)]
        if len(at) > 1:
            i, j = np.triu_indices(len(at), 1)
            apart = np.linalg.norm(at[i] - at[j], axis=1)
            ratios += list(np.linalg.norm(given[i] - given[j], axis=1)[apart > 0] / apart[apart > 0])
        ratios = [ratio for ratio in ratios if ratio > 0]
        return float(np.median(ratios)) if ratios else 1.0


def composed(step: FloatArray, move: Similarity) -> Similarity:
    """The similarity of a step (7,) (translation, rotation vector, log of the scale), applied after `move`."""
    scale, rotation = float(np.exp(np.clip(step[6], -3, 3))), so3_exp(step[3:6])
    return Similarity(scale * move.scale, rotation @ move.rotation, scale * rotation @ move.translation + step[:3])


def _taking_to_z(direction: FloatArray) -> FloatArray:
    """A rotation (3, 3) that takes a direction (3,) to z."""
    up = np.asarray(direction, float) / np.linalg.norm(direction)
    helper = np.eye(3)[np.argmin(np.abs(up))]
    x = np.cross(helper, up)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(up, x), up])
