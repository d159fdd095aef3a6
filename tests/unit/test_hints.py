"""Hints: what they say of a pair, how much that counts, and what becomes of them beside the tracks."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest

from skytrace.estimation.confidence import EVIDENCE_PER_NAT, confidence
from skytrace.estimation.correspond import ImagePath
from skytrace.estimation.hint_search import favoured, hinted_modes
from skytrace.estimation.hint_ties import HINT_CONFIDENCE, HintTie, decided_by_hints, join_by_hints
from skytrace.estimation.hint_verdicts import Clocks, decision_sentence, judge_hints, tie_sentences
from skytrace.estimation.hints import (
    MOST_NATS,
    Hints,
    OffsetHint,
    PairHint,
    SimultaneousHint,
    Source,
    from_start_times,
)
from skytrace.estimation.pair_modes import PairMode
from skytrace.estimation.pair_refine import RefinedPair
from skytrace.estimation.sync_groups import Measured, tie_groups
from skytrace.estimation.sync_settings import SyncSettings
from skytrace.estimation.two_view import PairGeometry
from skytrace.geometry.rigid import Rigid

RATE_SIGMA = 4e-4
SETTINGS = SyncSettings()


def moment(name="m", sigma_s=0.02, **times_s):
    return SimultaneousHint(name, times_s, sigma_s)


def mode(offset_s, evidence=100.0, centre_s=50.0, rate=1.0):
    pose = Rigid(np.eye(3), np.array([1.0, 0.0, 0.0]))
    geometry = PairGeometry(pose, offset_s - (rate - 1) * centre_s, rate, centre_s, 54.0, 60.0, 1e-3, 1e-5, 0.5)
    return PairMode(geometry, evidence)


class TestPairs:
    def test_offsets_of_a_common_clock(self):
        hints = Hints((OffsetHint("a", 10.0, 0.3), OffsetHint("b", 4.0, 0.4), OffsetHint("c", 1.0, 1.0, "start_time")))
        (pair,) = hints.between("a", "b", RATE_SIGMA)
        # The moment 12 on the common clock is 2 on a's and 8 on b's.
        assert pair.time1_s(2.0) == 8.0
        assert pair.sigma_at(0.0) == pytest.approx(0.5)
        (back,) = hints.between("b", "a", RATE_SIGMA)
        assert back.time1_s(8.0) == 2.0
        assert hints.between("a", "c", RATE_SIGMA) == ()  # different sources share no clock
        assert hints.between("a", "z", RATE_SIGMA) == ()
        assert hints.offsets_s == {"a": 10.0, "b": 4.0}

    def test_a_moment_counts_most_where_it_is(self):
        (pair,) = Hints((), (moment(a=100.0, b=30.0, c=7.0),)).between("a", "b", RATE_SIGMA)
        assert pair.time1_s(100.0) == 30.0
        assert pair.sigma_at(100.0) == pytest.approx(np.sqrt(2) * 0.02)
        assert pair.sigma_at(1100.0) == pytest.approx(0.4, rel=0.01)

    def test_two_moments_tell_the_rate(self):
        rate = 1.0003
        moments = [moment(str(t), 1e-3, a=t, b=5.0 + rate * t) for t in (10.0, 400.0)]
        *_, line = Hints((), moments).between("a", "b", RATE_SIGMA)
        assert line.sources == ("10.0", "400.0")
        assert line.rate == pytest.approx(rate, abs=1e-5)
        assert line.rate_sigma < 1e-5
        assert line.time1_s(200.0) == pytest.approx(5.0 + rate * 200.0, abs=2e-3)
        assert Hints((), moments).stretch("b", "a", RATE_SIGMA) is None  # the tracks find so little by themselves

    def test_moments_close_together_do_not_bend_the_rate(self):
        moments = [moment("1", 0.02, a=10.0, b=15.0), moment("2", 0.02, a=11.0, b=16.05)]
        *_, line = Hints((), moments).between("a", "b", RATE_SIGMA)
        assert abs(line.rate - 1) < RATE_SIGMA

    def test_a_plainly_wrong_rate_is_taken_as_measured(self):
        moments = [moment(str(t), 0.02, a=t, b=5.0 + 1.3 * t) for t in (10.0, 40.0, 100.0)]
        hints = Hints((), moments)
        *_, line = hints.between("a", "b", RATE_SIGMA)
        assert line.rate == pytest.approx(1.3, abs=1e-9)
        factor = hints.stretch("b", "a", RATE_SIGMA)
        assert factor is not None
        assert factor == pytest.approx(1 / 1.3)
        *_, even = hints.stretched("b", factor).between("a", "b", RATE_SIGMA)
        assert even.rate == pytest.approx(1.0)

    def test_moments_at_one_time_tell_no_rate(self):
        moments = [moment("1", a=10.0, b=15.0), moment("2", a=10.0, b=15.01)]
        assert len(Hints((), moments).between("a", "b", RATE_SIGMA)) == 2

    def test_moments_that_disagree_are_known_less_well(self):
        exact = [moment(str(t), 0.02, a=t, b=t) for t in (0.0, 50.0, 100.0)]
        bent = [*exact[:1], moment("x", 0.02, a=50.0, b=51.0), exact[2]]
        one, other = (Hints((), m).between("a", "b", RATE_SIGMA)[-1].sigma_s for m in (exact, bent))
        assert other > 5 * one

    def test_start_times(self):
        start = {
            "a": datetime(2024, 5, 3, 12, 0, 7, tzinfo=timezone(timedelta(hours=2))),
            "b": datetime(2024, 5, 3, 10, tzinfo=UTC),
        }
        hints = Hints(from_start_times(start, {"a": 100.0}))
        (pair,) = hints.between("a", "b", RATE_SIGMA)
        assert pair.time1_s(100.0) == pytest.approx(7.0)  # a's first frame, at 100 s of its own clock, is 7 s into b
        assert pair.heavy_tail
        assert pair.sigma_at(0.0) > 4
        assert from_start_times({}) == ()
        with pytest.raises(ValueError, match="time zone"):
            from_start_times({"a": datetime(2024, 5, 3), "b": datetime(2024, 5, 3, tzinfo=UTC)})

    @pytest.mark.parametrize(
        "wrong",
        [
            lambda: OffsetHint("a", np.nan),
            lambda: OffsetHint("a", 1.0, 0.0),
            lambda: OffsetHint("a", 1.0, np.inf),
            lambda: moment(a=1.0),
            lambda: moment(a=1.0, b=np.inf),
            lambda: moment(sigma_s=-1.0, a=1.0, b=2.0),
            lambda: Hints((OffsetHint("a", 1.0), OffsetHint("a", 2.0))),
        ],
    )
    def test_nonsense_is_refused(self, wrong):
        with pytest.raises(ValueError, match=r"expected|twice"):
            wrong()


class TestFavour:
    def test_it_is_bounded_falls_with_the_distance_and_never_speaks_against(self):
        hint = PairHint(("h",), 20.0, 1.0, 0.0, 0.5, RATE_SIGMA)
        nats = [hint.favour(0.0, 20.0 + d, 300.0) for d in (0.0, 0.5, 1.0, 2.0, 3.0, 100.0)]
        assert nats[0] == MOST_NATS
        assert np.all(np.diff(nats) <= 0)
        assert 0 <= nats[-1] < 1e-6

    def test_wall_clocks_have_heavier_tails(self):
        sharp, wide = (PairHint(("h",), 0.0, 1.0, 0.0, 3.0, RATE_SIGMA, tail) for tail in (False, True))
        assert wide.favour(0.0, 20.0, 300.0) > sharp.favour(0.0, 20.0, 300.0) + 0.5

    def test_a_vague_hint_says_less(self):
        sharp, vague = (PairHint(("h",), 0.0, 1.0, 0.0, sigma_s, RATE_SIGMA) for sigma_s in (1.0, 200.0))
        assert vague.favour(0.0, 0.0, 300.0) < 2.0 < sharp.favour(0.0, 0.0, 300.0)

    def test_the_hint_that_suits_a_mode_best_counts_once(self):
        one = PairHint(("h",), 20.0, 1.0, 0.0, 0.5, RATE_SIGMA)
        other = PairHint(("g",), 80.0, 1.0, 0.0, 0.5, RATE_SIGMA)
        for hints in ((one,), (one, one), (one, other)):
            got = favoured(mode(20.1), hints, 300.0)
            assert got.evidence == pytest.approx(100.0 + EVIDENCE_PER_NAT * got.hinted_nats)
            assert got.hinted_nats == MOST_NATS

    def test_what_the_tracks_speak_against_gains_nothing(self):
        hint = PairHint(("h",), 20.0, 1.0, 0.0, 0.5, RATE_SIGMA)
        assert favoured(mode(20.0, evidence=-1.0), (hint,), 300.0).evidence == -1.0

    def test_it_gains_no_more_than_the_tracks_say(self):
        hint = PairHint(("h",), 20.0, 1.0, 0.0, 0.5, RATE_SIGMA)
        assert favoured(mode(20.0, evidence=6.0), (hint,), 300.0).evidence == pytest.approx(12.0)

    def test_without_hints_the_blind_modes_stand(self):
        path = ImagePath(np.array([0.0, 60.0]), np.zeros((4, 1, 2)))
        modes = [mode(20.0), mode(40.0, 30.0)]
        assert hinted_modes(path, path, (), modes, SETTINGS) == modes

    def test_a_hint_cannot_make_the_rival_of_what_is_sure_sure(self):
        """The tracks alone are 95 % sure of one mode; a wrong hint unsettles that and convinces of nothing else."""
        gap = EVIDENCE_PER_NAT * np.log(0.95 / 0.05)
        sure = confidence(400.0, 400.0 - gap, 1.0, 60.0)
        assert sure == pytest.approx(0.95, abs=0.01)
        assert confidence(400.0 - gap + EVIDENCE_PER_NAT * MOST_NATS, 400.0, 1.0, 60.0, MOST_NATS) < 0.95

    def test_it_makes_up_for_a_short_overlap(self):
        assert confidence(1000.0, 0.0, 1.0, 15.0) == 0.85
        assert confidence(1000.0, 0.0, 1.0, 15.0, 1.0) == pytest.approx(0.939, abs=1e-3)
        assert confidence(1000.0, 0.0, 1.0, 15.0, 4.0) > 0.99


def clocks(deviation=(1e-3, 0.0), **offsets_s):
    group = {c: (offset_s, 1.0) for c, offset_s in offsets_s.items()}
    return Clocks([group], dict.fromkeys(group, deviation), dict.fromkeys(group, 0.0))


def offsets(sigma_s: float = 0.5, source: Source = "offset_s", **given_s: float) -> Hints:
    return Hints(tuple(OffsetHint(c, offset_s, sigma_s, source) for c, offset_s in given_s.items()))


class TestVerdicts:
    def test_right_offsets_agree_whatever_their_common_clock(self):
        found = judge_hints(offsets(a=1000.3, b=1012.0, c=1020.0), clocks(a=0.0, b=12.1, c=20.0), RATE_SIGMA)
        assert [v.verdict for v in found] == ["agrees"] * 3
        assert not any(v.text for v in found)
        assert [v.name for v in found] == ["offset_s of a", "offset_s of b", "offset_s of c"]

    def test_the_one_that_most_others_contradict_is_named(self):
        a, b, c = judge_hints(offsets(a=100.0, b=112.0, c=132.0), clocks(a=0.0, b=12.0, c=20.0), RATE_SIGMA)
        assert (a.verdict, b.verdict, c.verdict) == ("agrees", "agrees", "contradicted")
        assert c.error_s == pytest.approx(-12.0)
        assert c.text == "offset_s of c contradicts the tracks: by them it is 120.00 s, not 132.00 s. It was not used."

    def test_of_two_that_disagree_both_are_named_once(self):
        a, b = judge_hints(offsets(a=0.0, b=12.0), clocks(a=0.0, b=7.0), RATE_SIGMA)
        assert (a.verdict, b.verdict) == ("contradicted", "contradicted")
        assert a.text == ""
        assert b.text == (
            "offset_s of a and b contradict their tracks: by them that of b is 5.00 s smaller, relative to a. "
            "They were not used."
        )

    def test_the_deviation_given_decides_what_is_a_contradiction(self):
        true = clocks(a=0.0, b=7.0)
        assert [v.verdict for v in judge_hints(offsets(1.0, a=0.0, b=12.0), true, RATE_SIGMA)] == ["agrees"] * 2
        assert [v.verdict for v in judge_hints(offsets(0.8, a=0.0, b=12.0), true, RATE_SIGMA)] == ["contradicted"] * 2
        unsure = clocks((3.0, 0.0), a=0.0, b=7.0)
        assert [v.verdict for v in judge_hints(offsets(0.1, a=0.0, b=12.0), unsure, RATE_SIGMA)] == ["agrees"] * 2

    def test_a_precise_wrong_one_does_not_outvote_several(self):
        given = Hints((OffsetHint("a", 0.0, 0.01), OffsetHint("b", 20.0, 0.5), OffsetHint("c", 25.0, 0.5)))
        a, b, c = judge_hints(given, clocks(a=0.0, b=12.0, c=17.0), RATE_SIGMA)
        assert (a.verdict, b.verdict, c.verdict) == ("contradicted", "agrees", "agrees")

    def test_start_times_say_who_began_when(self):
        hints = offsets(3.0, "start_time", a=0.0, b=5.0, c=100.0)
        *_, c = judge_hints(hints, clocks(a=0.0, b=5.0, c=40.0), RATE_SIGMA)
        assert c.verdict == "contradicted"
        assert "by them c began 60.00 s earlier than given" in c.text

    def test_cameras_without_a_tie_leave_hints_untested(self):
        apart = Clocks(
            [{"a": (0.0, 1.0)}, {"b": (0.0, 1.0)}], dict.fromkeys("ab", (0.0, 0.0)), dict.fromkeys("ab", 0.0)
        )
        found = judge_hints(offsets(a=0.0, b=99.0, z=1.0), apart, RATE_SIGMA)
        assert [(v.verdict, v.error_s) for v in found] == [("untested", None)] * 3
        (found,) = judge_hints(Hints((), (moment(a=0.0, b=99.0),)), apart, RATE_SIGMA)
        assert found.verdict == "untested"

    def test_moments(self):
        true = clocks(a=0.0, b=-20.0, c=5.0)
        good, bad = (moment(a=50.0, b=70.01, c=45.0), moment("[[simultaneous]] 2", a=50.0, b=71.2, c=45.0))
        found = judge_hints(Hints((), (good, bad)), true, RATE_SIGMA)
        assert [v.verdict for v in found] == ["agrees", "contradicted"]
        assert found[1].error_s == pytest.approx(1.2)
        assert found[1].text.startswith(
            "[[simultaneous]] 2 contradicts the tracks: by them b took its frame 1.20 s later than a, c."
        )
        (pair,) = judge_hints(Hints((), (moment(a=50.0, b=71.2),)), true, RATE_SIGMA)
        assert "b took its frame 1.20 s later than a" in pair.text

    def test_clocks_are_less_sure_far_from_where_they_were_found(self):
        true = Clocks(
            [{"a": (0.0, 1.0), "b": (0.0, 1.0)}], dict.fromkeys("ab", (1e-3, 1e-3)), dict.fromkeys("ab", 1000.0)
        )
        near, far = moment(a=1000.0, b=1000.5), moment(a=0.0, b=0.5)
        found = judge_hints(Hints((), (near, far)), true, RATE_SIGMA)
        assert [v.verdict for v in found] == ["contradicted", "agrees"]

    def test_what_was_relied_on_and_what_the_tracks_object_to(self):
        hints = Hints((), (moment("m1", a=0.0, b=0.0), moment("m2", a=0.0, c=0.0)))
        first, second = (hints.between("a", other, RATE_SIGMA)[0] for other in "bc")
        ties = [HintTie(0, 1, first, None, objected=False), HintTie(0, 2, second, None, objected=True)]
        found = judge_hints(hints, clocks(a=0.0, b=0.0), RATE_SIGMA, ties)
        assert [v.verdict for v in found] == ["relied on", "contradicted"]
        one, other = tie_sentences(["a", "b", "c"], ties)
        assert one.startswith("a and b are tied by m1 alone")
        assert other == "m2 is not believed: with it the tracks of a and c fit no geometry."

    def test_the_sentence_on_a_decision_names_the_rivals(self):
        text = decision_sentence("a", "b", 0.497, [17.21, 33.0])
        assert "sure to 50 %; offsets +17.21, +33.00 s away fit nearly as well." in text

    def test_verdicts_are_plain_values(self):
        (a, _) = judge_hints(offsets(a=0.0, b=12.0), clocks(a=0.0, b=12.0), RATE_SIGMA)
        assert a.as_dict == {
            "name": "offset_s of a",
            "cameras": ["a"],
            "verdict": "agrees",
            "error_s": 0.0,
            "error_sd_s": pytest.approx(0.5, rel=0.01),
        }


def circling(begin_s, end_s, radius=0.2):
    """A path whose pieces of a second are straight: enough for ties that look at nothing but overlaps."""
    breaks = np.arange(begin_s, end_s + 1.0)
    corners = radius * np.column_stack([np.cos(breaks / 3), np.sin(breaks / 5)])
    coefficients = np.zeros((4, len(breaks) - 1, 2))
    coefficients[2], coefficients[3] = np.diff(corners, axis=0), corners[:-1]
    return ImagePath(breaks, coefficients)


def measured(i, j, sure, blind=None, offset_s=0.0):
    found = mode(offset_s)
    return Measured(i, j, found, RefinedPair(found.geometry, 100.0, 3.0, sure, blind), True)


class TestTies:
    APART = {"a": circling(0.0, 30.0), "b": circling(100.0, 130.0), "c": circling(200.0, 230.0)}  # noqa: RUF012

    def test_cameras_that_saw_nothing_together_are_tied_by_a_precise_hint(self):
        groups, ties = join_by_hints([], self.APART, Hints((), (moment(a=5.0, b=45.0),)), SETTINGS)
        (group,) = groups
        assert group.reference == 0
        assert group.clocks == {0: (0.0, 1.0), 1: (-40.0, 1.0)}
        assert group.confidence == {0: HINT_CONFIDENCE, 1: HINT_CONFIDENCE}
        assert group.deviations[1] == pytest.approx((np.sqrt(2) * 0.02, SETTINGS.rate_prior))
        assert [(t.i, t.j, t.objected, t.measured) for t in ties] == [(0, 1, False, None)]

    def test_a_vague_hint_ties_nothing(self):
        assert join_by_hints([], self.APART, Hints((), (moment(sigma_s=0.2, a=5.0, b=45.0),)), SETTINGS) == ([], [])
        starts = from_start_times({"a": datetime(2024, 5, 3), "b": datetime(2024, 5, 3)}, sigma_s=0.01)
        assert join_by_hints([], self.APART, Hints(starts), SETTINGS) == ([], [])

    def test_groups_are_joined_on_the_clock_of_the_larger(self):
        paths = {**self.APART, "d": circling(300.0, 330.0), "e": circling(400.0, 430.0)}
        tied = [measured(0, 1, 0.99, offset_s=7.0), measured(2, 3, 0.99), measured(3, 4, 0.99)]
        groups = tie_groups(tied, 5, SETTINGS)
        (group,), _ = join_by_hints(groups, paths, Hints((), (moment(b=10.0, d=25.0),)), SETTINGS)
        assert group.reference == 2
        assert set(group.clocks) == {0, 1, 2, 3, 4}
        (o1, r1), (o3, r3) = group.clocks[1], group.clocks[3]
        assert o1 + r1 * 10.0 == pytest.approx(o3 + r3 * 25.0)  # the moment
        (o0, r0) = group.clocks[0]
        assert o0 + r0 * 50.0 == pytest.approx(o1 + r1 * 57.0, abs=1e-6)  # what the tracks say of the smaller group
        assert len(group.pairs) == len(group.disagreement_s) == 3
        assert group.confidence[1] == pytest.approx(HINT_CONFIDENCE * 0.99 * 0.99, rel=0.02)

    def test_gross_rates_carry_over(self):
        moments = [moment(str(t), a=t, b=100.0 + 0.5 * t) for t in (0.0, 60.0)]
        (group,), _ = join_by_hints([], self.APART, Hints((), moments), SETTINGS)
        offset_s, rate = group.clocks[1]
        assert rate == pytest.approx(2.0)
        assert offset_s + rate * 115.0 == pytest.approx(30.0)

    def test_decisions_of_hints(self):
        blind_enough = measured(0, 1, 0.99, 0.97)
        decided = measured(0, 2, 0.97, 0.5)
        confirmed = measured(1, 2, 0.6, None)
        tied = [blind_enough, decided, confirmed]
        assert decided_by_hints(tied, tie_groups(tied, 3, SETTINGS), SETTINGS) == [decided]
        assert decided_by_hints([confirmed], [], SETTINGS) == []
