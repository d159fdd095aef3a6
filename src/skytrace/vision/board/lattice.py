"""Chessboards among the saddle points of a picture: lattices grown corner by corner from a seed.

No size and no camera is assumed: a board is followed as far as its corners are seen, through perspective, distortion
and where it leaves the picture. Two corners are neighbours when one edge joins them: the same side of it is bright all
the way; and between neighbours dark and bright corners change places.
"""

from __future__ import annotations

import cv2
import numpy as np

from skytrace.geometry.arrays import BoolArray, FloatArray
from skytrace.vision.board.saddles import Saddles, sample

Node = tuple[int, int]  # column and row on the lattice, from an arbitrary corner

_STEPS: tuple[Node, ...] = ((1, 0), (-1, 0), (0, 1), (0, -1))
_CONE_COSINE = np.cos(np.radians(20.0))  # about an edge's direction, where the seed's neighbours are looked for
_TOLERANCE = 0.3  # of the spacing, between a predicted and a found corner
_SURE_TOLERANCE = 0.15  # the same where a line of three corners predicts it: a board's outer edge lies elsewhere
_ALONG = np.linspace(0.25, 0.75, 7)  # places on an edge where its two sides are compared
_ASIDE = 0.18  # of the edge's length, from the edge into the squares
_LEAST_STEP = 0.25  # of the median contrast along an edge, at each of these places
_FEWEST_IN_LINE = 3  # corners in a row or column of the lattice; shorter ones are often false


def largest_lattice(blurred: np.ndarray, saddles: Saddles) -> tuple[dict[Node, int], float]:
    """The lattice that covers most of the picture, as index into `saddles` of each node, and its area in pixels.

    Without any three by three corners: an empty one, and 0.
    """
    best: dict[Node, int] = {}
    largest = 0.0
    used = np.zeros(len(saddles), bool)
    for seed in range(len(saddles)):
        if used[seed]:
            continue
        used[seed] = True
        lattice = _Lattice(blurred, saddles, ~used)
        if not lattice.start(seed):
            continue
        lattice.grow()
        nodes = prune(lattice.nodes)
        if not nodes:
            continue
        members = list(nodes.values())
        used[members] = True
        area = float(cv2.contourArea(cv2.convexHull(saddles.xy_px[members].astype(np.float32))))
        if area > largest:
            best, largest = nodes, area
    return best, largest


def prune(nodes: dict[Node, int]) -> dict[Node, int]:
    """The nodes in rows and columns with enough corners."""
    while True:
        kept = dict(nodes)
        for axis in (0, 1):
            lines, counts = np.unique([node[axis] for node in kept], return_counts=True)
            short = set(lines[counts < _FEWEST_IN_LINE].tolist())
            kept = {node: k for node, k in kept.items() if node[axis] not in short}
        if len(kept) == len(nodes):
            return kept
        nodes = kept


class _Lattice:
    """A lattice while it grows."""

    def __init__(self, blurred: np.ndarray, saddles: Saddles, free: BoolArray) -> None:
        self._blurred = blurred
        self._saddles = saddles
        self._free = free
        self.nodes: dict[Node, int] = {}
        self._axes: dict[Node, FloatArray] = {}  # (2, 2) directions of the edges towards +column and +row
        self._parity = False

    def start(self, seed: int) -> bool:
        """Take a seed and its neighbours along both edges; False where it has none on either."""
        axes = self._saddles.edges[seed].copy()
        self._take((0, 0), seed, axes)
        self._parity = self._between_bright(seed, axes)
        for step in _STEPS:
            found = self._nearest_along(seed, axes[0] * step[0] + axes[1] * step[1])
            if found is not None:
                self._take(step, found, self._oriented(found, axes))
        return any(n in self.nodes for n in _STEPS[:2]) and any(n in self.nodes for n in _STEPS[2:])

    def grow(self) -> None:
        """Add corners at the rim, best predicted first, until no more are found."""
        hopeless: dict[Node, int] = {}  # empty nodes, and the number of neighbours they had when none was found
        while True:
            rim: dict[Node, int] = {}
            for i, j in self.nodes:
                for di, dj in _STEPS:
                    node = (i + di, j + dj)
                    if node not in self.nodes:
                        rim[node] = rim.get(node, 0) + 1
            added = False
            for node in sorted(rim, key=lambda n: -rim[n]):
                if hopeless.get(node) == rim[node]:
                    continue
                if self._try(node):
                    added = True
                else:
                    hopeless[node] = rim[node]
            if not added:
                return

    def _take(self, node: Node, saddle: int, axes: FloatArray) -> None:
        self.nodes[node] = saddle
        self._axes[node] = axes
        self._free[saddle] = False

    def _try(self, node: Node) -> bool:
        i, j = node
        neighbours = [(i + di, j + dj) for di, dj in _STEPS if (i + di, j + dj) in self.nodes]
        predictions = [self._predictions(node, n) for n in neighbours]
        places = [p for p, _ in predictions if len(p)]
        if not places:
            return False
        place = np.concatenate(places).mean(axis=0)
        tolerance = _SURE_TOLERANCE if any(sure for _, sure in predictions) else _TOLERANCE
        spacing = min(float(np.linalg.norm(place - self._at(n))) for n in neighbours)
        distance = np.linalg.norm(self._saddles.xy_px - place, axis=1)
        near = np.flatnonzero(self._free & (distance < tolerance * spacing))
        for found in near[np.argsort(distance[near])]:
            axes = self._oriented(int(found), self._axes[neighbours[0]])
            alternates = self._between_bright(int(found), axes) == (self._parity != bool((i + j) % 2))
            if alternates and all(self._joined(self.nodes[n], int(found)) for n in neighbours):
                self._take(node, int(found), axes)
                return True
        return False

    def _at(self, node: Node) -> FloatArray:
        return self._saddles.xy_px[self.nodes[node]]

    def _predictions(self, node: Node, neighbour: Node) -> tuple[list[FloatArray], bool]:
        """Where a node should lie by the line through a neighbour, or else by those beside it, and if that is sure."""
        di, dj = node[0] - neighbour[0], node[1] - neighbour[1]
        line = [(neighbour[0] - k * di, neighbour[1] - k * dj) for k in range(3)]
        if line[1] in self.nodes:
            p0, p1 = self._at(line[0]), self._at(line[1])
            if line[2] not in self.nodes:
                return [2 * p0 - p1], False
            # Half the change of the step: whole, noise grows threefold; none, bent lines run away.
            return [2 * p0 - p1 + 0.5 * (p0 - 2 * p1 + self._at(line[2]))], True
        beside = []
        for side in (-1, 1):
            a = (neighbour[0] + side * dj, neighbour[1] + side * di)
            b = (node[0] + side * dj, node[1] + side * di)
            if a in self.nodes and b in self.nodes:
                beside.append(self._at(neighbour) + self._at(b) - self._at(a))
        return beside, False

    def _nearest_along(self, start: int, direction: FloatArray) -> int | None:
        """The nearest saddle joined to `start` by an edge in a direction, dark and bright exchanged."""
        offset = self._saddles.xy_px - self._saddles.xy_px[start]
        distance = np.linalg.norm(offset, axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            ahead = offset @ direction > _CONE_COSINE * distance
        ahead &= self._free & (distance > 0)
        candidates = np.flatnonzero(ahead)
        axes = self._axes[0, 0]
        for found in candidates[np.argsort(distance[candidates])][:8]:
            other = self._between_bright(int(found), self._oriented(int(found), axes)) != self._parity
            if other and self._joined(start, int(found)):
                return int(found)
        return None

    def _oriented(self, saddle: int, like: FloatArray) -> FloatArray:
        """The edge directions (2, 2) of a saddle, ordered and signed like those of its neighbour."""
        edges = self._saddles.edges[saddle]
        likeness = like @ edges.T
        straight = abs(likeness[0, 0]) + abs(likeness[1, 1]) >= abs(likeness[0, 1]) + abs(likeness[1, 0])
        ordered = edges if straight else edges[::-1]
        signs = np.sign((ordered * like).sum(1))
        return ordered * np.where(signs == 0, 1.0, signs)[:, None]

    def _between_bright(self, saddle: int, axes: FloatArray) -> bool:
        """Whether the corner between the two axes is a bright one."""
        bright = self._saddles.bright[saddle]
        return bool(abs(bright @ (axes[0] + axes[1])) > abs(bright @ (axes[0] - axes[1])))

    def _joined(self, a: int, b: int) -> bool:
        """Whether one straight edge runs from a saddle to another, one side of it bright, the other dark."""
        p, q = self._saddles.xy_px[a], self._saddles.xy_px[b]
        along = q - p
        aside = _ASIDE * np.array([-along[1], along[0]])
        places = p + _ALONG[:, None] * along
        both = np.stack([places + aside, places - aside])
        grey = sample(self._blurred, both[..., 0], both[..., 1])
        step = grey[0] - grey[1]
        middle = float(np.median(step))
        contrast = np.pi * min(self._saddles.strength[a], self._saddles.strength[b])
        return bool((step * np.sign(middle) > _LEAST_STEP * abs(middle)).all() and abs(middle) > 0.4 * contrast)
