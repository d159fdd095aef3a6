"""Where an adjusted scene lies in the frame of what is known, what of that holds, and what it leaves open."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from skytrace.estimation.adjust.driver import Adjusted
from skytrace.estimation.adjust.problem import State
from skytrace.estimation.known import Known
from skytrace.estimation.scene import CameraState, Scene
from skytrace.estimation.similarity_fit import Fit, fit_similarity
from skytrace.estimation.similarity_problem import Item, LengthItem, PointItem, UpItem
from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import Similarity

# Widening of the deviations beyond which it is not deviations that were a little optimistic.
_CONTRADICTORY = 5.0
UP_IN_CAMERA = np.array([0.0, -1.0, 0.0])  # of a camera held upright; y points down


@dataclass(frozen=True, eq=False, slots=True)
class Placed:
    """A scene in the frame of what is known of it, up to `known.undetermined` and, where it is unknown, the unit."""

    adjusted: Adjusted
    known: Known  # what of it holds
    given: Known  # everything that was told of cameras that are there, positions counted alike
    fit: Fit | None  # none where nothing tells of a frame
    absent: tuple[str, ...] = ()  # what was told of cameras that are not

    @property
    def contradictory(self) -> bool:
        """Whether so much of what is known is wrong that nothing of it can be used."""
        return self.fit is not None and self.fit.contradictory and self.fit.factor > _CONTRADICTORY


def place(adjusted: Adjusted, known: Known, centre_covariance: FloatArray) -> Placed:
    """Move an adjusted scene of an arbitrary gauge to where what is known puts it.

    `centre_covariance` (c, 3, 3) is that of the scene's own centres, whatever frame they are in. What contradicts the
    rest is left out, deviations are widened where the rest agrees worse than they allow, and nothing is used where that
    would take far wider ones; nor are positions and distances where they do not tell the unit of length.
    """
    given = _centred(_of_registered(known, adjusted.camera_ids))
    absent = tuple(name for name in _names(known) if name not in _names(given))
    items = _items(given, adjusted.camera_ids, adjusted.state, centre_covariance)
    if not items:
        return Placed(adjusted, replace(given, undetermined=None), given, None, absent)
    fit = fit_similarity(items, _upright(adjusted.state))
    unplaced = Placed(adjusted, Known(readouts=given.readouts), given, fit, absent)
    if unplaced.contradictory:
        return unplaced
    if not fit.unit_known:
        items = [item for item in items if isinstance(item, UpItem)]
        if not items:
            return unplaced
        fit = replace(fit_similarity(items, _upright(adjusted.state), with_scale=False), unit_known=False)
    names = {item.name for item in fit.items}
    held = Known(
        tuple(
            replace(p, sigma_m=fit.factor * p.sigma_m) for p in given.positions if position_name(p.camera_id) in names
        ),
        tuple(
            replace(d, sigma_m=fit.factor * d.sigma_m) for d in given.distances if distance_name(*d.camera_ids) in names
        ),
        tuple(replace(u, sigma_rad=fit.factor * u.sigma_rad) for u in given.ups if up_name(u.camera_id) in names),
        given.readouts,
        fit.undetermined,
        fit.unit_known,
        given.origin_m,
        given.earth,
    )
    return Placed(in_frame(adjusted, fit.move), held, given, fit, absent)


def in_frame(adjusted: Adjusted, move: Similarity) -> Adjusted:
    """The same adjustment in another frame and unit, to start another one from."""
    state = adjusted.state
    moved = State(
        state.rotation @ move.rotation.T, move.apply(state.centre), state.clock, state.lens, move.apply(state.control)
    )
    cameras: dict[str, CameraState] = {
        c: replace(camera, camera_from_world=move.apply_to_pose(camera.camera_from_world))
        for c, camera in adjusted.scene.cameras.items()
    }
    scene = Scene(adjusted.scene.reference, cameras, adjusted.scene.grid, moved.control)
    motion = adjusted.motion.weighted(adjusted.motion.weight / move.scale**2)
    return replace(adjusted, scene=scene, state=moved, motion=motion)


def _of_registered(known: Known, camera_ids: tuple[str, ...]) -> Known:
    """What is known of cameras that are there, in the order of their names."""
    distances = (d for d in known.distances if set(d.camera_ids) <= set(camera_ids))
    return replace(
        known,
        positions=tuple(sorted((p for p in known.positions if p.camera_id in camera_ids), key=lambda p: p.camera_id)),
        distances=tuple(sorted(distances, key=lambda d: d.camera_ids)),
        ups=tuple(sorted((u for u in known.ups if u.camera_id in camera_ids), key=lambda u: u.camera_id)),
        readouts=tuple(r for r in known.readouts if r.camera_id in camera_ids),
    )


def _centred(known: Known) -> Known:
    """Positions counted from their median, near which numbers are small whatever the frame (UTM)."""
    if not known.positions:
        return known
    origin_m = np.median([p.position_m for p in known.positions], axis=0)
    positions = tuple(replace(p, position_m=p.position_m - origin_m) for p in known.positions)
    return replace(known, positions=positions, origin_m=known.origin_m + origin_m)


def _items(known: Known, camera_ids: tuple[str, ...], state: State, centre_covariance: FloatArray) -> list[Item]:
    index = {c: i for i, c in enumerate(camera_ids)}
    items: list[Item] = [
        PointItem(position_name(p.camera_id), state.centre[i], centre_covariance[i], p.position_m, p.sigma_m)
        for p in known.positions
        for i in [index[p.camera_id]]
    ]
    for d in known.distances:
        i, j = (index[c] for c in d.camera_ids)
        spread = centre_covariance[i] + centre_covariance[j]
        items.append(
            LengthItem(distance_name(*d.camera_ids), state.centre[j] - state.centre[i], spread, d.metres, d.sigma_m)
        )
    items += [
        UpItem(up_name(u.camera_id), state.rotation[index[u.camera_id]].T @ u.up_in_camera, u.sigma_rad)
        for u in known.ups
    ]
    return items


def _upright(state: State) -> FloatArray:
    """Where most cameras' pictures have their upper edge."""
    ups = (state.rotation.transpose(0, 2, 1) @ UP_IN_CAMERA).sum(axis=0)
    return ups / max(float(np.linalg.norm(ups)), 1e-300)


def _names(known: Known) -> list[str]:
    names = [position_name(p.camera_id) for p in known.positions]
    names += [distance_name(*d.camera_ids) for d in known.distances]
    return names + [up_name(u.camera_id) for u in known.ups]


def position_name(camera_id: str) -> str:
    return f"position of {camera_id}"


def distance_name(one: str, other: str) -> str:
    return f"distance from {one} to {other}"


def up_name(camera_id: str) -> str:
    return f"vertical of {camera_id}"


def residuals(placed: Placed, state: State, camera_ids: tuple[str, ...]) -> dict[str, float]:
    """How many given deviations each known thing lies from an adjusted state, by its name."""
    index = {c: i for i, c in enumerate(camera_ids)}
    out: dict[str, float] = {}
    if placed.known.unit_known:
        for p in placed.given.positions:
            away = (state.centre[index[p.camera_id]] - p.position_m) / p.sigma_m
            out[position_name(p.camera_id)] = float(np.linalg.norm(away))
        for d in placed.given.distances:
            i, j = (index[c] for c in d.camera_ids)
            apart = float(np.linalg.norm(state.centre[j] - state.centre[i]))
            out[distance_name(*d.camera_ids)] = (apart - d.metres) / d.sigma_m
    for u in placed.given.ups if placed.known.placed else ():
        up = state.rotation[index[u.camera_id]].T @ u.up_in_camera
        angle = float(np.arctan2(np.linalg.norm(up[:2]), up[2]))
        out[up_name(u.camera_id)] = angle / u.sigma_rad
    for r in placed.given.readouts:
        out[f"readout of {r.camera_id}"] = float(state.clock[index[r.camera_id], 2] - r.readout_s) / r.sigma_s
    return out
