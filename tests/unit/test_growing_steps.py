"""The paper's synchronisation of a pair: chords that grow, and what is kept of them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from skytrace.estimation import growing_steps
from skytrace.estimation.correspond import ImagePath
from skytrace.estimation.growing_steps import Iterate, chords, grow_step, rough_offsets, steps_s
from skytrace.estimation.hints import Hints, OffsetHint
from skytrace.estimation.sync_settings import GrowingSettings, SyncSettings
from skytrace.geometry.rigid import Rigid

SETTINGS = SyncSettings()


def path(begin_s: float, end_s: float, gap_s: tuple[float, float] | None = None) -> ImagePath:
    """x = t^2 / 1000, y = t / 100, in pieces of a second, not seen in a gap."""
    breaks = np.arange(begin_s, end_s + 1.0)
    t = breaks[:-1]
    c = np.zeros((4, len(t), 2))
    c[1, :, 0] = 1e-3
    c[2] = np.stack([2e-3 * t, np.full(len(t), 1e-2)], axis=1)
    c[3] = np.stack([1e-3 * t**2, 1e-2 * t], axis=1)
    if gap_s is not None:
        c[:, (t >= gap_s[0]) & (t < gap_s[1])] = np.nan
    return ImagePath(breaks, c)


def test_steps_double_from_a_frame() -> None:
    steps = np.array(steps_s(SETTINGS))
    assert steps[0] == SETTINGS.growing.frame_s
    np.testing.assert_array_equal(steps[1:], 2 * steps[:-1])
    assert len(steps) == SETTINGS.growing.steps


@pytest.mark.parametrize("step_s", [0.1, -0.5, 4.0])
def test_a_chord_ends_on_the_track(step_s: float) -> None:
    path1 = path(-10, 40)
    pairs = chords(path(0, 30), path1, 2.0, step_s, SETTINGS)
    np.testing.assert_allclose(pairs.time1_s, pairs.time0_s + 2.0, atol=1e-12)
    end = pairs.xy1 + step_s * pairs.velocity1
    np.testing.assert_allclose(end, path1.evaluate(pairs.time1_s + step_s), atol=1e-12)
    # The chord of a parabola has the slope of its middle.
    np.testing.assert_allclose(pairs.velocity1, path1.evaluate(pairs.time1_s + step_s / 2, 1), atol=1e-12)


def test_no_chord_ends_where_the_target_was_not_seen() -> None:
    path1 = path(0, 30, gap_s=(10, 15))
    every = dataclasses.replace(SETTINGS, growing=dataclasses.replace(SETTINGS.growing, samples=10_000))
    pairs = chords(path(0, 30), path1, 0.0, 2.0, every)
    assert np.isfinite(pairs.velocity1).all()
    assert path1.defined(pairs.time1_s + 2.0).all()
    # Two seconds before the gap and two before the end are lost, and the five in the gap itself.
    assert len(pairs) == pytest.approx((30 - 9) * SETTINGS.rate_hz, abs=3)
    assert len(chords(path(0, 30), path1, 0.0, 2.0, SETTINGS)) <= SETTINGS.growing.samples


def solver(outcomes: dict[int, tuple[float, float]], asked: list[float]):
    """Stands in for the solver: the (shift, inlier share) that each step in frames leads to; others lead to nothing."""

    def iterate(path0, path1, offset_s, step_s, settings, rng):
        asked.append(step_s)
        frames = round(step_s / settings.growing.frame_s)
        if frames not in outcomes:
            return None
        shift_s, share = outcomes[frames]
        return Iterate(step_s, shift_s, offset_s + shift_s, Rigid.identity(), share)

    return iterate


def test_steps_grow_until_a_shift_inside_its_chord_explains_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[float] = []
    # Four frames explain much with a shift beyond them; eight ahead are the first to hold what they found.
    outcomes = {1: (0.03, 0.2), -2: (0.1, 0.3), 4: (0.2, 0.9), 8: (0.21, 0.95), -8: (0.2, 0.5), 16: (0.2, 1.0)}
    monkeypatch.setattr(growing_steps, "_iterate", solver(outcomes, asked))
    found = grow_step(path(0, 30), path(0, 30), 1.0, SETTINGS, np.random.default_rng(0))
    assert found is not None
    assert (found.shift_s, found.offset_s, found.inlier_share) == (0.21, 1.21, 0.95)
    assert np.round(np.array(asked) * 30).tolist() == [1, -1, 2, -2, 4, -4, 8, -8]


def test_the_iterate_with_most_inliers_is_kept_where_none_explains_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[float] = []
    monkeypatch.setattr(growing_steps, "_iterate", solver({2: (0.01, 0.3), -32: (-0.9, 0.5), 128: (1.0, 0.1)}, asked))
    found = grow_step(path(0, 30), path(0, 30), 1.0, SETTINGS, np.random.default_rng(0))
    assert found is not None
    assert found.shift_s == -0.9
    assert len(asked) == 2 * SETTINGS.growing.steps
    monkeypatch.setattr(growing_steps, "_iterate", solver({}, []))
    assert grow_step(path(0, 30), path(0, 30), 1.0, SETTINGS, np.random.default_rng(0)) is None


def test_rounds_end_when_the_shift_settles_or_nothing_more_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def rounds_of(*outcomes: tuple[float, float] | None) -> growing_steps.GrowingSteps:
        waiting = iter(outcomes)

        def step(path0, path1, offset_s, settings, rng):
            outcome = next(waiting)
            if outcome is None:
                return None
            return Iterate(0.1, outcome[0], offset_s + outcome[0], Rigid.identity(), outcome[1])

        monkeypatch.setattr(growing_steps, "grow_step", step)
        monkeypatch.setattr(growing_steps.two_view, "refine", lambda *a, **k: None)
        return growing_steps.synchronise_by_growing_steps(
            path(0, 30), path(0, 30), 1.0, SETTINGS, np.random.default_rng(0)
        )

    assert [i.offset_s for i in rounds_of((0.5, 0.4), (0.25, 0.8), (0.001, 0.9)).iterates] == [1.5, 1.75, 1.751]
    assert [i.offset_s for i in rounds_of((0.5, 0.4), (0.25, 0.4)).iterates] == [1.5]
    assert [i.offset_s for i in rounds_of((0.5, 0.4), None).iterates] == [1.5]
    most = SETTINGS.growing.rounds
    assert len(rounds_of(*((0.5, 0.1 * k) for k in range(most + 1))).iterates) == most
    nothing = rounds_of(None)
    assert nothing.iterates == ()
    assert nothing.geometry is None
    assert "29.1 s in common view" in nothing.failure


def test_tracks_too_short_for_a_sample_say_so() -> None:
    found = growing_steps.synchronise_by_growing_steps(path(0, 2), path(0, 2), 0.0, SETTINGS, np.random.default_rng(0))
    assert found.geometry is None
    assert "no shift of the rough offset" in found.failure


def test_rough_offsets_name_the_camera_without_one() -> None:
    hints = Hints((OffsetHint("a", 1.0), OffsetHint("b", -2.0), OffsetHint("c", 3.0, source="start_time")))
    assert rough_offsets(["b", "a"], hints) == {"b": -2.0, "a": 1.0}
    with pytest.raises(ValueError, match="got none of c"):
        rough_offsets(["a", "c"], hints)


def test_settings_of_the_steps_belong_to_those_of_the_synchronisation() -> None:
    fewer = dataclasses.replace(SETTINGS, growing=GrowingSettings(frame_s=0.01, steps=3))
    assert steps_s(fewer) == (0.01, 0.02, 0.04)
