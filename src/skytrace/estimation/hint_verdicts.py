"""What became of hints: whether the tracks bear them out, and what users should know."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from skytrace.estimation.hint_ties import HintTie
from skytrace.estimation.hints import CONTRADICTION, Hints, OffsetHint, SimultaneousHint, Source

Verdict = Literal["agrees", "contradicted", "relied on", "untested"]


@dataclass(frozen=True, slots=True)
class HintVerdict:
    """A hint beside what the tracks say.

    "relied on": it ties cameras that their tracks leave open; "untested": the tracks say nothing of it. `error_s` is
    what the tracks say less what was given, relative to the hints that it belongs with; none where untested.
    """

    name: str
    cameras: tuple[str, ...]
    verdict: Verdict
    error_s: float | None = None
    error_sigma_s: float | None = None
    text: str = ""  # a sentence for users, where they should know

    @property
    def as_dict(self) -> dict[str, object]:
        return {
            "name": self.name,
            "cameras": list(self.cameras),
            "verdict": self.verdict,
            "error_s": self.error_s,
            "error_sd_s": self.error_sigma_s,
        }


@dataclass(frozen=True, eq=False, slots=True)
class Clocks:
    """World time = offset + rate * camera time in groups of cameras, and how well that is known.

    `deviations` are of the offset at the camera's own time `middle_s`, and of the rate.
    """

    groups: Sequence[Mapping[str, tuple[float, float]]]
    deviations: Mapping[str, tuple[float, float]]
    middle_s: Mapping[str, float]

    def world_s(self, camera_id: str, camera_time_s: float) -> tuple[float, float]:
        """World time of a camera's time, and its deviation."""
        offset_s, rate = next(g[camera_id] for g in self.groups if camera_id in g)
        sigma_s, rate_sigma = self.deviations[camera_id]
        away_s = camera_time_s - self.middle_s[camera_id]
        return offset_s + rate * camera_time_s, float(np.hypot(sigma_s, rate_sigma * away_s))


def judge_hints(
    hints: Hints, clocks: Clocks, rate_sigma: float, ties: Sequence[HintTie] = ()
) -> tuple[HintVerdict, ...]:
    """A verdict on every hint, those that contradict the tracks beyond `CONTRADICTION` deviations with a sentence.

    Hints are compared inside the groups that were tied: offsets of one source with what most of them agree on, and the
    cameras' times of one moment with each other. `ties` are what was tried on the strength of hints alone.
    """
    found: list[HintVerdict] = []
    for source in ("offset_s", "start_time"):
        found += _judge_offsets(hints, source, clocks, rate_sigma)
    found += [_judge_moment(h, clocks) for h in hints.simultaneous]
    relied_on = {name for tie in ties if not tie.objected for name in tie.hint.sources}
    objected = {name for tie in ties if tie.objected for name in tie.hint.sources}

    def settled(v: HintVerdict) -> HintVerdict:
        if v.name in relied_on and v.verdict != "contradicted":
            return replace(v, verdict="relied on")
        return replace(v, verdict="contradicted") if v.name in objected and v.verdict == "untested" else v

    return tuple(settled(v) for v in found)


def tie_sentences(camera_ids: Sequence[str], ties: Sequence[HintTie]) -> list[str]:
    """What users should know of ties that rest on hints alone, and of hints that the tracks object to."""
    out = []
    for tie in ties:
        a, b = camera_ids[tie.i], camera_ids[tie.j]
        if tie.objected:
            out.append(f"{tie.hint.name} is not believed: with it the tracks of {a} and {b} fit no geometry.")
        else:
            out.append(
                f"{a} and {b} are tied by {tie.hint.name} alone, since their tracks do not tell the offset: it is as "
                "right as that."
            )
    return out


def decision_sentence(camera0: str, camera1: str, blind_confidence: float, rivals_s: Sequence[float]) -> str:
    """That the offset of two cameras would be open without hints; rivals by how far they are from it."""
    others = ", ".join(f"{away_s:+.2f}" for away_s in rivals_s)
    rivals = f"; offsets {others} s away fit nearly as well" if others else ""
    return (
        f"The offset of {camera0} and {camera1} rests on the hints: their tracks alone make it sure to "
        f"{100 * blind_confidence:.0f} %{rivals}."
    )


def _judge_offsets(hints: Hints, source: Source, clocks: Clocks, rate_sigma: float) -> list[HintVerdict]:
    given = {h.camera_id: h for h in hints.offsets if h.source == source}
    out = {c: HintVerdict(h.name, (c,), "untested") for c, h in given.items()}
    for group in clocks.groups:
        own = [c for c in group if c in given]
        if len(own) < 2:
            continue
        usual_s = float(np.median([given[c].offset_s for c in own]))
        difference, sigma = np.zeros(len(own)), np.zeros(len(own))
        for k, c in enumerate(own):
            world_s, sigma_s = clocks.world_s(c, 0.0)
            difference[k] = world_s - given[c].offset_s
            # The common clock of the hints and that of the reference camera may differ in rate.
            sigma[k] = np.hypot(np.hypot(given[c].sigma_s, sigma_s), rate_sigma * (given[c].offset_s - usual_s))
        error, error_sigma, lone = _against_the_others(difference, sigma)
        for k, c in enumerate(own):
            wrong = abs(error[k]) > CONTRADICTION * error_sigma[k]
            text = _offset_sentence(given[c], error[k], own[0] if lone else None) if wrong else ""
            verdict = "contradicted" if wrong else "agrees"
            # Of two that disagree, one sentence is enough.
            text = "" if lone and k == 0 else text
            out[c] = HintVerdict(given[c].name, (c,), verdict, float(error[k]), float(error_sigma[k]), text)
    return list(out.values())


def _judge_moment(hint: SimultaneousHint, clocks: Clocks) -> HintVerdict:
    worst = HintVerdict(hint.name, tuple(hint.camera_time_s), "untested")
    largest = -1.0
    for group in clocks.groups:
        own = [c for c in hint.camera_time_s if c in group]
        if len(own) < 2:
            continue
        world = [clocks.world_s(c, hint.camera_time_s[c]) for c in own]
        sigma = np.hypot([s for _, s in world], hint.sigma_s)
        error, error_sigma, lone = _against_the_others(np.array([t for t, _ in world]), sigma)
        k = int(np.argmax(np.abs(error) / error_sigma)) if not lone else len(own) - 1
        size = abs(error[k]) / error_sigma[k]
        if size <= largest:
            continue
        largest = size
        text = ""
        if size > CONTRADICTION:
            others = ", ".join(c for c in own if c != own[k])
            text = (
                f"{hint.name} contradicts the tracks: by them {own[k]} took its frame {_amount(error[k])} than "
                f"{others}. It was not used."
            )
        verdict = "contradicted" if text else "agrees"
        worst = HintVerdict(hint.name, tuple(hint.camera_time_s), verdict, float(error[k]), float(error_sigma[k]), text)
    return worst


def _against_the_others(value: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray, bool]:
    """How far each of several statements (n,) of one value is from what most of them agree on, and its deviation.

    Where no two agree nothing tells which is wrong: the last item is true, and each is compared with the first.
    """
    apart = np.abs(value[:, None] - value) / np.hypot(sigma[:, None], sigma)
    agree = apart <= CONTRADICTION
    if not np.triu(agree, 1).any():
        compared = np.r_[1, np.zeros(len(value) - 1, np.int64)]
        return value - value[compared], np.hypot(sigma, sigma[compared]), True
    # Most followers first, then the closest ones.
    best = min(range(len(value)), key=lambda k: (-agree[k].sum(), apart[k][agree[k]].sum()))
    weight = agree[best] / sigma**2
    middle = float(weight @ value / weight.sum())
    spread = np.where(agree[best], 0.0, 1 / weight.sum())
    return value - middle, np.sqrt(sigma**2 + spread), False


def _offset_sentence(given: OffsetHint, error_s: float, partner: str | None) -> str:
    """What contradicts an offset; with a partner, only the two together are known to be wrong."""
    of = given.name if partner is None else f"{given.source} of {partner} and {given.camera_id}"
    verb, they, why = ("contradicts the", "It was", "") if partner is None else ("contradict their", "They were", "")
    if given.source == "start_time":
        said = f"{given.camera_id} began {_amount(error_s)} than given"
        why = " A camera's clock may be off, and some videos tell when they ended."
    elif partner is None:
        said = f"it is {given.offset_s + error_s:.2f} s, not {given.offset_s:.2f} s"
    else:
        said = f"that of {given.camera_id} is {abs(error_s):.2f} s {'larger' if error_s > 0 else 'smaller'}"
    relative = "" if partner is None else f", relative to {partner}"
    return f"{of} {verb} tracks: by them {said}{relative}. {they} not used.{why}"


def _amount(seconds: float) -> str:
    return f"{abs(seconds):.2f} s {'later' if seconds > 0 else 'earlier'}"
