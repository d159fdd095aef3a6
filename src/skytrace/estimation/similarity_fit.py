"""The similarity that takes a scene to a frame in which points, lengths and the vertical are known, and who disagrees.

Weighted least squares over the seven freedoms of a similarity, each item counted by its deviation and by that of the
scene itself. One item that is grossly wrong (a phone that shows the position of yesterday) would drag all others along:
items are removed one after another, each time the one without which the rest agrees best, until the rest agrees. Those
removed stay out if each of them contradicts the rest by far and no other choice explains the contradiction as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from skytrace.estimation.similarity_problem import Item, LengthItem, PointItem, SimilarityProblem, Solved
from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import Similarity, hat

_AGREES = 3.0  # squared deviations per degree of freedom: beyond, somebody is wrong
_CONTRADICTS = 5.0  # deviations from what the others say
_TELLS_APART = 3.0  # deviations by which one choice of the culprit must explain more than any other
_TRUSTED_SPREAD = 3  # degrees of freedom from which on the spread of the residuals corrects the deviations
_VAGUE = 0.3  # radians, or of the scene's size: a freedom known no better is not known


@dataclass(frozen=True, eq=False, slots=True)
class Fit:
    """A similarity to the known frame, and how well it is determined."""

    move: Similarity
    items: tuple[Item, ...]  # those that agree, in the order given
    discounted: tuple[Item, ...]  # those that contradict the others
    residual: dict[str, float]  # deviations from what is given, by name, the discounted ones against the others
    factor: float  # by which deviations must be wider for the items to agree, 1 where they do
    contradictory: bool  # the items disagree and none can be blamed
    unit_known: bool
    undetermined: FloatArray  # (6, q) unit motions (translation, rotation about the origin) that nothing determines
    covariance: FloatArray = field(repr=False)  # (7, 7) of translation, rotation, log of the scale; 0 where unknown


def fit_similarity(items: Sequence[Item], upright: FloatArray | None = None, with_scale: bool = True) -> Fit:
    """The similarity that the items agree on.

    `upright` (3,) is a direction of the scene that probably points up: it fixes what the items leave open. Without
    `with_scale` the scene is in metres already. Points must not lie far from the origin in comparison with their
    distances. Raises ValueError without any item.
    """
    if not items:
        raise ValueError("items: expected at least one")
    problem = SimilarityProblem(upright, with_scale)
    found = problem.solve(tuple(items))
    whole, contradictory = found, False
    if not _agree(found):
        blamed = _blame(problem, found)
        contradictory = blamed is None
        found = found if blamed is None else blamed
    spread = _spread(found)
    names = {item.name for item in found.items}
    discounted = tuple(item for item in items if item.name not in names)
    residual = {item.name: float(np.linalg.norm(problem.rows(found.move, item)[0])) for item in whole.items}
    unit_known, undetermined, covariance = _determined(problem, found)
    return Fit(
        found.move,
        found.items,
        discounted,
        residual,
        float(np.sqrt(spread)),
        contradictory,
        unit_known,
        undetermined,
        spread * covariance,
    )


def _agree(found: Solved) -> bool:
    return found.redundancy < 1 or found.chi2 <= _AGREES * found.redundancy


def _spread(found: Solved) -> float:
    """Squared deviations per degree of freedom where there are enough to tell, at least 1."""
    if found.redundancy >= _TRUSTED_SPREAD or not _agree(found):
        return max(1.0, found.chi2 / max(found.redundancy, 1))
    return 1.0


def _blame(problem: SimilarityProblem, found: Solved) -> Solved | None:
    """The solution without the items that are wrong; none where it cannot be told which."""
    current = found
    while not _agree(current):
        tried = [problem.solve(tuple(i for i in current.items if i is not out)) for out in current.items]
        tried = sorted((t for t in tried if t.redundancy >= 1), key=lambda t: t.chi2)
        if not tried or len(tried[0].items) < len(found.items) / 2:
            return None
        spread = max(1.0, tried[0].chi2 / tried[0].redundancy)
        if len(tried) > 1 and tried[1].chi2 - tried[0].chi2 < _TELLS_APART**2 * spread:
            return None
        current = tried[0]
    spread = max(1.0, current.chi2 / current.redundancy)
    out = [item for item in found.items if all(item is not kept for kept in current.items)]
    gains = [problem.solve((*current.items, item)).chi2 - current.chi2 for item in out]
    return current if min(gains) > _CONTRADICTS**2 * spread else None


def _determined(problem: SimilarityProblem, found: Solved) -> tuple[bool, FloatArray, FloatArray]:
    """Whether the unit is known, the rigid motions (6, q) that are not, and the covariance (7, 7) of the rest."""
    _, J = problem.stacked(found.move, found.items)
    points = [found.move.apply(i.at) for i in found.items if isinstance(i, PointItem)]
    # Motions are counted about the middle of the points and in units of their size, or vague ones would look mixed.
    centre = np.mean(points, axis=0) if points else np.zeros(3)
    about = np.eye(7)
    about[:3, :3] *= _size(found.items, np.array(points).reshape(-1, 3) - centre)
    about[:3, 3:6], about[:3, 6] = hat(centre), -centre
    N = (J @ about).T @ (J @ about)
    rigid, by_scale = N[:6, :6], N[:6, 6]
    left = N[6, 6] - by_scale @ np.linalg.pinv(rigid, rcond=1e-12, hermitian=True) @ by_scale
    unit_known = not problem.with_scale or left > 1 / _VAGUE**2
    if unit_known and problem.with_scale:
        rigid = rigid - np.outer(by_scale, by_scale) / N[6, 6]
    values, vectors = np.linalg.eigh(rigid)
    vague = values < 1 / _VAGUE**2
    if not len(points):
        vague |= np.linalg.norm(vectors[:3], axis=0) > 0.5  # nothing is known of places
    undetermined = about[:6, :6] @ vectors[:, vague]
    kept = np.zeros((7, int((~vague).sum()) + 1))
    kept[:6, :-1], kept[6, -1] = vectors[:, ~vague], 1.0
    if not (unit_known and problem.with_scale):
        kept = kept[:, :-1]
    inner = kept @ np.linalg.pinv(kept.T @ N @ kept, rcond=1e-12, hermitian=True) @ kept.T
    return bool(unit_known), undetermined / np.linalg.norm(undetermined, axis=0), about @ inner @ about.T


def _size(items: tuple[Item, ...], points: FloatArray) -> float:
    """How large the scene is at least, and far more than the deviations of its place: a known place is never vague."""
    metres = [i.metres for i in items if isinstance(i, LengthItem)]
    metres += [10 * float(i.sigma_m.max()) for i in items if isinstance(i, PointItem)]
    if len(points):
        metres.append(float(np.sqrt((points**2).sum(axis=1).mean())))
    return max(metres, default=1.0)
