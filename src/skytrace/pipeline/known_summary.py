"""What became of the known things of a flight: how far each lies from the result, what was left out, what is open."""

from __future__ import annotations

from typing import Any

import numpy as np

from skytrace.estimation.known import Known
from skytrace.estimation.known_placement import Placed, position_name, residuals
from skytrace.pipeline.offline import Outcome

_ODD = 4.0  # deviations from the result at which a used thing is named
_WIDENED = 2.0  # widening of the deviations that is worth a word


def known_section(outcome: Outcome) -> dict[str, Any] | None:
    """`known` of summary.json: plain values; None where nothing was given."""
    placed = outcome.placed
    if placed is None:
        return None
    discounted = [] if placed.fit is None else [item.name for item in placed.fit.discounted]
    found = residuals(placed, outcome.adjusted.state, outcome.adjusted.camera_ids)
    # Of what was not used, how far it lay from everything else, or in vain from a scene in a frame of its own.
    before = {} if placed.fit is None else placed.fit.residual
    things = {
        name: {
            "residual_sd": before[name] if name in discounted or name not in found else found[name],
            "used": name in found and name not in discounted,
            "metres_off": _metres_off(outcome, placed, name),
        }
        for name in {**before, **found}
    }
    return {
        "frame": outcome.reconstruction.frame,
        "things": things,
        "deviations_widened_by": 1.0 if placed.fit is None else placed.fit.factor,
        "contradictory": placed.contradictory,
        "left_open": left_open(placed.known) if placed.given.of_places else "",
        "of_missing_cameras": list(placed.absent),
    }


def known_warnings(outcome: Outcome) -> list[str]:
    """What a user should know of it, in words."""
    placed, section = outcome.placed, known_section(outcome)
    if placed is None or section is None:
        return []
    out, fit = [], placed.fit
    for name, thing in section["things"].items():
        off = "" if thing["metres_off"] is None else f" ({thing['metres_off']:.3g} m)"
        if thing["used"] and abs(thing["residual_sd"]) > _ODD:
            out.append(f"The {name} lies {abs(thing['residual_sd']):.1f} deviations{off} from the result.")
    for item in () if fit is None else fit.discounted:
        thing = section["things"][item.name]
        off = "" if thing["metres_off"] is None else f" ({thing['metres_off']:.3g} m)"
        out.append(
            f"The {item.name} is not used: it lies {thing['residual_sd']:.1f} deviations{off} from where everything "
            "else puts it. Check it in flight.toml."
        )
    if placed.contradictory:
        out.append(
            "The known positions, distances and verticals contradict each other and the flight by far, and it cannot "
            "be told which is wrong: none is used. Check them in flight.toml."
        )
    elif section["deviations_widened_by"] > _WIDENED:
        out.append(
            f"The known positions, distances and verticals agree only if they are "
            f"{section['deviations_widened_by']:.1f} times as uncertain as given, as which they are taken."
        )
    unused = placed.given.positions or placed.given.distances
    if unused and not placed.contradictory and not (placed.known.placed and placed.known.unit_known):
        out.append(
            "What is given does not tell the unit of length, which takes a known distance, or two positions that are "
            "far apart in comparison with their deviations: lengths are in an arbitrary unit, positions are not used."
        )
    elif placed.known.positions and not placed.known.complete:
        out.append(
            f"The known positions leave open {section['left_open']}: it is chosen without knowledge and is no result. "
            "More positions, or up_in_camera, would tell it."
        )
    for name in placed.absent:
        out.append(f"The {name} is not used: the camera is left out.")
    return out


def left_open(known: Known) -> str:
    """What of the world's frame the knowledge does not determine, in words; empty where it determines all."""
    if known.undetermined is None:
        return "everything: place, orientation and unit of length"
    parts = []
    if known.undetermined.shape[1]:
        if known.positions and known.unit_known:
            turns = int(np.linalg.matrix_rank(known.undetermined[3:], 1e-6))
            alone = "the heading" if known.ups else "the turn about the line through them"
            parts.append(alone if turns == 1 else "the orientation")
        else:
            parts.append("the place and the heading" if known.ups else "the place and the orientation")
    if not known.unit_known:
        parts.append("the unit of length")
    return " and ".join(parts)


def _metres_off(outcome: Outcome, placed: Placed, name: str) -> float | None:
    """How far a known position lies from the result."""
    if not placed.known.unit_known:
        return None
    index = {c: i for i, c in enumerate(outcome.adjusted.camera_ids)}
    for known in placed.given.positions:
        if position_name(known.camera_id) == name:
            return float(np.linalg.norm(outcome.adjusted.state.centre[index[known.camera_id]] - known.position_m))
    return None
