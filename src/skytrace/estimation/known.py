"""What is known of a flight's cameras beforehand: places, distances, verticals, readouts; and what that leaves open.

Knowledge enters the adjustment as priors with deviations of its own, once the scene lies in the frame it refers to
(`estimation.known_placement`). What it leaves undetermined of that frame stays a gauge and is held.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from skytrace.estimation.adjust.camera_priors import CameraTerm
from skytrace.estimation.adjust.distance_term import DistanceTerm
from skytrace.estimation.adjust.held_motion import HeldMotion
from skytrace.estimation.adjust.problem import CENTRE, READOUT, State
from skytrace.estimation.adjust.up_term import UpTerm
from skytrace.geometry.arrays import FloatArray, frozen_array
from skytrace.model.georeference import Georeference


@dataclass(frozen=True, eq=False, slots=True)
class KnownPosition:
    """Where a camera's centre lies."""

    camera_id: str
    position_m: FloatArray  # (3,)
    sigma_m: FloatArray  # (3,) along each axis

    def __post_init__(self) -> None:
        object.__setattr__(self, "position_m", frozen_array(self.position_m, (3,), "position_m"))
        object.__setattr__(self, "sigma_m", frozen_array(self.sigma_m, (3,), "sigma_m"))
        if not (self.sigma_m > 0).all():
            raise ValueError(f"sigma_m: expected positive deviations, got {self.sigma_m.tolist()}")


@dataclass(frozen=True, slots=True)
class KnownDistance:
    """How far apart two cameras stand."""

    camera_ids: tuple[str, str]
    metres: float
    sigma_m: float


@dataclass(frozen=True, eq=False, slots=True)
class KnownUp:
    """Which direction of a camera's frame (x right, y down, z forward) points up."""

    camera_id: str
    up_in_camera: FloatArray  # (3,), of any length
    sigma_rad: float

    def __post_init__(self) -> None:
        up = frozen_array(self.up_in_camera, (3,), "up_in_camera")
        if not np.linalg.norm(up) > 0:
            raise ValueError("up_in_camera: expected a direction, got zero")
        object.__setattr__(self, "up_in_camera", frozen_array(up / np.linalg.norm(up), (3,), "up_in_camera"))


@dataclass(frozen=True, slots=True)
class KnownReadout:
    """How long a camera takes from the first to the last row."""

    camera_id: str
    readout_s: float
    sigma_s: float


@dataclass(frozen=True, eq=False, slots=True)
class Known:
    """All that is known of a flight's cameras; of places only what holds in the frame the scene lies in.

    `undetermined` (6, q) are the motions of that frame (translation, rotation about the origin) which nothing
    determines; None stands for a scene that lies in a frame of its own, where only readout times are used. Positions
    count from `origin_m` in the frame they were given in.
    """

    positions: tuple[KnownPosition, ...] = ()
    distances: tuple[KnownDistance, ...] = ()
    ups: tuple[KnownUp, ...] = ()
    readouts: tuple[KnownReadout, ...] = ()
    undetermined: FloatArray | None = field(default=None, repr=False)
    unit_known: bool = False
    origin_m: FloatArray = field(default_factory=lambda: np.zeros(3))  # (3,)
    earth: Georeference | None = None  # where the frame of the positions lies

    @property
    def placed(self) -> bool:
        """Whether the scene lies in the frame that the knowledge refers to."""
        return self.undetermined is not None

    @property
    def complete(self) -> bool:
        """Whether nothing of the frame of the positions is left open."""
        return self.undetermined is not None and not self.undetermined.shape[1] and self.unit_known

    @property
    def of_places(self) -> bool:
        """Whether anything is known that tells of a frame."""
        return bool(self.positions or self.distances or self.ups)

    def enter(self, mean: FloatArray, deviation: FloatArray, camera_ids: Sequence[str], rolling_shutter: bool) -> None:
        """Write what is known of single parameters into priors (c, 16), in place."""
        index = {c: i for i, c in enumerate(camera_ids)}
        for known in self.readouts:
            if known.camera_id in index:
                mean[index[known.camera_id], READOUT] = known.readout_s
                deviation[index[known.camera_id], READOUT] = known.sigma_s if rolling_shutter else 0.0
        for known in self.positions if self.placed else ():
            if known.camera_id in index:
                mean[index[known.camera_id], CENTRE] = known.position_m
                deviation[index[known.camera_id], CENTRE] = known.sigma_m

    def terms(self, state: State, camera_ids: Sequence[str]) -> tuple[CameraTerm, ...]:
        """What is known of several parameters together, and what holds the rest of the gauge where it is at a state."""
        if self.undetermined is None:
            return ()
        index = {c: i for i, c in enumerate(camera_ids)}
        terms: list[CameraTerm] = [
            DistanceTerm(index[d.camera_ids[0]], index[d.camera_ids[1]], d.metres, d.sigma_m)
            for d in self.distances
            if all(c in index for c in d.camera_ids)
        ]
        terms += [UpTerm(index[u.camera_id], u.up_in_camera, u.sigma_rad) for u in self.ups if u.camera_id in index]
        if self.undetermined.shape[1]:
            terms.append(HeldMotion.at(state, self.undetermined))
        return tuple(terms)

    def started(self, state: State, mean: FloatArray, deviation: FloatArray) -> State:
        """The state with readout times that are held (deviation (c, 16) zero) at their means."""
        if not self.readouts:
            return state
        clock = np.array(state.clock)
        held = deviation[:, READOUT] == 0
        clock[held, 2] = mean[held, READOUT]
        return State(state.rotation, state.centre, clock, state.lens, state.control)
