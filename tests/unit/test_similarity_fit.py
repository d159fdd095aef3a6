"""The similarity to a known frame: exact, robust against one culprit, and aware of what is not determined."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from skytrace.estimation.similarity_fit import fit_similarity
from skytrace.estimation.similarity_problem import LengthItem, PointItem, UpItem
from skytrace.geometry.rigid import Similarity, so3_exp

NONE = np.zeros((3, 3))
SCENE = np.array([[0.0, 0, 0], [1, 0.1, 0], [0.9, 1.1, 0.1], [-0.2, 1, 0.05], [0.4, -0.7, 0.2]])
UP = np.array([0.1, -0.9, 0.3]) / np.linalg.norm([0.1, -0.9, 0.3])


def known_frame(rng) -> Similarity:
    """Takes UP to z."""
    axis = np.cross(UP, [0, 0, 1.0])
    angle = np.arctan2(np.linalg.norm(axis), UP[2])
    level = so3_exp(angle * axis / np.linalg.norm(axis))
    return Similarity(50.0, so3_exp(np.array([0, 0, rng.uniform(-3, 3)])) @ level, rng.normal(size=3))


def points(move, sigma_m=0.05, rng=None, chosen: Sequence[int] = (0, 1, 2, 3, 4), spread=NONE):
    noise = np.zeros((len(SCENE), 3)) if rng is None else sigma_m * rng.normal(size=(len(SCENE), 3))
    return [PointItem(f"p{k}", SCENE[k], spread, move.apply(SCENE[k]) + noise[k], np.full(3, sigma_m)) for k in chosen]


def length(move, i, j, sigma_m=0.01):
    vector = SCENE[j] - SCENE[i]
    return LengthItem(f"length {i} {j}", vector, NONE, move.scale * float(np.linalg.norm(vector)), sigma_m)


def assert_equal(found, move, atol=1e-6):
    assert found.scale == pytest.approx(move.scale, rel=1e-8)
    np.testing.assert_allclose(found.apply(SCENE), move.apply(SCENE), atol=atol)


def test_exact_points_give_the_exact_similarity(rng):
    move = known_frame(rng)
    fit = fit_similarity(points(move))
    assert_equal(fit.move, move)
    assert fit.unit_known
    assert fit.undetermined.shape == (6, 0)
    assert (fit.discounted, fit.factor, fit.contradictory) == ((), 1.0, False)


def test_two_points_and_the_vertical_give_the_exact_similarity(rng):
    move = known_frame(rng)
    fit = fit_similarity([*points(move, chosen=[0, 1]), UpItem("up", UP, 0.01)])
    assert_equal(fit.move, move)
    assert fit.undetermined.shape == (6, 0)


def test_one_point_a_length_and_the_vertical_leave_the_heading_open(rng):
    move = known_frame(rng)
    fit = fit_similarity([*points(move, chosen=[2]), length(move, 0, 1), UpItem("up", UP, 0.01)])
    assert fit.move.scale == pytest.approx(move.scale)
    np.testing.assert_allclose(fit.move.apply(SCENE[2]), move.apply(SCENE[2]), atol=1e-6)
    np.testing.assert_allclose(fit.move.rotation @ UP, [0, 0, 1], atol=1e-6)
    assert fit.unit_known
    # A turn about the vertical through the point, which stays where it is.
    assert fit.undetermined.shape == (6, 1)
    shift, turn = fit.undetermined[:3, 0], fit.undetermined[3:, 0]
    np.testing.assert_allclose(np.cross(turn / np.linalg.norm(turn), [0, 0, 1]), 0, atol=1e-6)
    np.testing.assert_allclose(shift + np.cross(turn, fit.move.apply(SCENE[2])), 0, atol=1e-6)


def test_two_points_leave_the_turn_about_their_line_open_which_uprightness_decides(rng):
    move = known_frame(rng)
    fit = fit_similarity(points(move, chosen=[0, 1]), upright=UP)
    assert fit.unit_known
    assert fit.undetermined.shape == (6, 1)
    shift, turn = fit.undetermined[:3, 0], fit.undetermined[3:, 0]
    for k in (0, 1):
        np.testing.assert_allclose(shift + np.cross(turn, fit.move.apply(SCENE[k])), 0, atol=1e-6)
    assert (fit.move.rotation @ UP)[2] > 0.98


def test_a_length_alone_gives_the_unit_and_nothing_else(rng):
    move = known_frame(rng)
    fit = fit_similarity([length(move, 0, 1)], upright=UP)
    assert fit.move.scale == pytest.approx(move.scale)
    assert fit.unit_known
    assert fit.undetermined.shape == (6, 6)


def test_verticals_alone_level_and_give_no_unit(rng):
    tilted = [so3_exp(0.01 * rng.normal(size=3)) @ UP for _ in range(4)]
    fit = fit_similarity([UpItem(f"up {k}", up, 0.01) for k, up in enumerate(tilted)])
    assert not fit.unit_known
    assert fit.move.scale == 1.0
    assert (fit.move.rotation @ UP)[2] > np.cos(0.02)
    assert fit.undetermined.shape == (6, 4)
    np.testing.assert_allclose(fit.undetermined[3:5], 0, atol=1e-6)  # no turn but that about z


def test_points_too_close_for_their_deviations_tell_no_unit(rng):
    move = known_frame(rng)
    assert not fit_similarity(points(move, 80.0, rng)).unit_known
    assert not fit_similarity(points(move, chosen=[0])).unit_known


def test_points_on_a_line_leave_the_turn_about_it_open(rng):
    move = known_frame(rng)
    on_line = [SCENE[0] + k * (SCENE[1] - SCENE[0]) for k in range(4)]
    items = [PointItem(f"p{k}", x, NONE, move.apply(x), np.full(3, 0.05)) for k, x in enumerate(on_line)]
    assert fit_similarity(items, upright=UP).undetermined.shape == (6, 1)


@pytest.mark.parametrize("wrong", range(5))
@pytest.mark.parametrize("off_m", [5.0, 1e5])
def test_one_wrong_point_is_found_and_does_no_harm(rng, wrong, off_m):
    move = known_frame(rng)
    items = points(move, 0.1, rng)
    bad = items[wrong]
    items[wrong] = PointItem(bad.name, bad.at, NONE, bad.position_m + off_m * np.array([0.6, -0.5, 0.62]), bad.sigma_m)
    fit = fit_similarity(items)
    assert [i.name for i in fit.discounted] == [f"p{wrong}"]
    assert not fit.contradictory
    assert fit.factor < 2
    np.testing.assert_allclose(fit.move.apply(SCENE), move.apply(SCENE), atol=1.0)
    assert fit.residual[f"p{wrong}"] > 0.7 * off_m / 0.1


def test_a_wrong_length_among_points_is_found(rng):
    move = known_frame(rng)
    good = length(move, 0, 2)
    bad = LengthItem("bad", good.vector, NONE, 1.2 * good.metres, 0.1)
    fit = fit_similarity([*points(move, 0.1, rng), bad])
    assert [i.name for i in fit.discounted] == ["bad"]


def test_two_wrong_points_of_seven_are_found(rng):
    scene = rng.normal(size=(7, 3))
    move = known_frame(rng)
    items = [
        PointItem(f"p{k}", x, NONE, move.apply(x) + 0.1 * rng.normal(size=3), np.full(3, 0.1))
        for k, x in enumerate(scene)
    ]
    for k in (1, 4):
        shift = 30 * rng.normal(size=3)
        items[k] = PointItem(f"p{k}", scene[k], NONE, items[k].position_m + shift, items[k].sigma_m)
    assert {i.name for i in fit_similarity(items).discounted} == {"p1", "p4"}


def test_where_the_culprit_cannot_be_told_nobody_is_blamed(rng):
    """Two lengths that contradict each other."""
    move = known_frame(rng)
    one = length(move, 0, 1)
    fit = fit_similarity([one, LengthItem("other", one.vector, NONE, 1.3 * one.metres, 0.01)], upright=UP)
    assert fit.contradictory
    assert fit.discounted == ()
    assert fit.factor > 5


def test_deviations_that_are_too_small_throughout_blame_nobody(rng):
    """Phones that are twice as wrong as they claim; a few of such flights may look like one wrong phone."""
    blamed = 0
    for _ in range(20):
        move = known_frame(rng)
        items = [
            PointItem(i.name, i.at, NONE, i.position_m + 3 * rng.normal(size=3), np.full(3, 1.5)) for i in points(move)
        ]
        blamed += bool(fit_similarity(items).discounted)
    assert blamed <= 3


def test_the_scene_own_deviations_count(rng):
    """A point of the scene that is badly known may lie far from where it should."""
    move = known_frame(rng)
    items = points(move)
    vague = PointItem("p2", SCENE[2] + [0.1, 0, 0], 0.1**2 * np.eye(3), items[2].position_m, items[2].sigma_m)
    fit = fit_similarity([*items[:2], vague, *items[3:]])
    assert fit.discounted == ()
    np.testing.assert_allclose(fit.move.apply(SCENE), move.apply(SCENE), atol=0.1)


def test_covariance_is_that_of_the_errors(rng):
    moved = []
    move = known_frame(rng)
    for _ in range(100):
        fit = fit_similarity(points(move, 0.5, rng))
        delta = so3_exp_inverse(fit.move.rotation @ move.rotation.T)
        scale = np.log(fit.move.scale / move.scale)
        moved.append(np.r_[delta, scale] / np.sqrt(np.diag(fit.covariance)[3:]))
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(moved), axis=0)), 1, atol=0.25)


def so3_exp_inverse(R):
    return 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])


def test_the_unit_can_be_held(rng):
    move = known_frame(rng)
    metric = [PointItem(i.name, move.scale * i.at, NONE, i.position_m, i.sigma_m) for i in points(move, 0.5, rng)]
    fit = fit_similarity(metric, with_scale=False)
    assert fit.move.scale == 1.0
    assert fit.covariance[6, 6] == 0


def test_nothing_known_is_refused():
    with pytest.raises(ValueError, match="at least one"):
        fit_similarity([])
