"""The calibration on exact and noisy corners: derivatives, recovery of lens and motion, outliers, choices, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from board_scene import FISHEYE, PINHOLE, Board, exact_corners, shots

from skytrace.geometry.rigid import so3_exp
from skytrace.vision.calibrate.certainty import assess
from skytrace.vision.calibrate.choose import choose_lens, with_aspect
from skytrace.vision.calibrate.fit import fit_lens
from skytrace.vision.calibrate.problem import BENDING, N_VIEW, Beliefs, State, View, collect, n_shared
from skytrace.vision.calibrate.residuals import linearise, predict
from skytrace.vision.calibrate.solve import assemble, minimise, objective
from skytrace.vision.calibrate.spread import spread_out
from skytrace.vision.calibrate.start import first_guess
from skytrace.vision.calibrate.verdict import bare_sides, judge
from skytrace.vision.calibrate.views import as_views

BOARD = Board()


def views_of(lens, taken, rng=None, noise_px=0.0, board=BOARD):
    """Views of the corners that are in the picture."""
    views = []
    for k, shot in enumerate(taken):
        exact = exact_corners(lens, board, shot)
        seen = np.isfinite(exact[:, 0])
        if seen.sum() >= 9:
            noise = 0.0 if rng is None else noise_px * rng.normal(size=(int(seen.sum()), 2))
            views.append(View(f"view{k}", board.lattice[seen], exact[seen] + noise, True))
    return views


def random_state(corners, lens, rng):
    """Boards anywhere before the camera, moving and bent."""
    n = corners.n_views
    return State(
        lens,
        1e-3 * rng.normal(size=4),
        so3_exp(0.4 * rng.normal(size=(n, 3))),
        np.column_stack([rng.normal(size=(n, 2)), rng.uniform(8, 12, n)]),
        0.02 * rng.normal(size=(n, 3)),
        0.002 * rng.normal(size=(n, 2)),
    )


@pytest.fixture(params=[PINHOLE, FISHEYE], ids=["pinhole", "fisheye"])
def lens(request):
    return request.param


def test_derivatives_equal_differences(lens, rng):
    corners = collect(views_of(lens, shots(lens, 3, rng)), lens.size_px)
    state = random_state(corners, lens, rng)
    xy, by_view, by_shared = linearise(corners, state)
    np.testing.assert_allclose(xy, predict(corners, state), rtol=0, atol=1e-9)
    nothing = np.zeros((corners.n_views, N_VIEW)), np.zeros(n_shared(lens.model))
    for k in range(N_VIEW + n_shared(lens.model)):
        sides = []
        for step in (1e-6, -1e-6):
            view_step, shared_step = (part.copy() for part in nothing)
            if k < N_VIEW:
                view_step[:, k] = step
            else:
                shared_step[k - N_VIEW] = step
            sides.append(predict(corners, state.moved(view_step, shared_step)))
        numeric = (sides[0] - sides[1]) / 2e-6
        given = by_view[:, :, k] if k < N_VIEW else by_shared[:, :, k - N_VIEW]
        scale = np.abs(numeric).max()
        assert scale > 1
        np.testing.assert_allclose(given, numeric, rtol=0, atol=2e-6 * scale, err_msg=f"parameter {k}")


def test_the_gradient_is_that_of_the_objective(lens, rng):
    corners = collect(views_of(lens, shots(lens, 3, rng), rng, 0.3), lens.size_px)
    state = random_state(corners, lens, rng)
    beliefs = Beliefs(
        np.array([0.3, 0.4, 50.0]), turn_sigma_rad=0.02, decentring_sigma=2e-3, aspect_free=True, shape_free=True
    )
    equations, _ = assemble(corners, state, beliefs)
    view_step = 1e-8 * rng.normal(size=(corners.n_views, N_VIEW))
    shared_step = 1e-8 * rng.normal(size=n_shared(lens.model))
    sides = [objective(corners, state.moved(s * view_step, s * shared_step), beliefs) for s in (1, -1)]
    slope = (equations.view_gradient * view_step).sum() + equations.shared_gradient @ shared_step
    assert slope == pytest.approx(0.5 * (sides[0] - sides[1]), rel=1e-4)


def test_exact_corners_of_moving_boards_give_the_lens_and_the_motion_back(lens, rng):
    taken = shots(lens, 12, rng, turn_rad=0.01)
    corners = collect(views_of(lens, taken), lens.size_px)
    fit = fit_lens(corners, with_aspect(first_guess(corners, lens.model), 1.0))
    found = fit.state.lens
    assert fit.total_rms_px < 0.02
    np.testing.assert_allclose(found.focal_px, lens.focal_px, rtol=1e-3)
    np.testing.assert_allclose(found.principal_px, lens.principal_px, atol=1.0)
    turn = np.stack([shot.turn_rad for shot in taken])[fit.views]
    np.testing.assert_allclose(fit.state.turn_rad, turn, atol=2e-3)


def test_noisy_corners_give_a_lens_within_its_deviations(lens, rng):
    corners = collect(views_of(lens, shots(lens, 12, rng, turn_rad=0.005, shift=0.002), rng, 0.2), lens.size_px)
    fit, _, costs = choose_lens(corners)
    certainty = assess(fit, rng)
    assert fit.state.lens.model == lens.model
    assert set(costs) == {"pinhole", "fisheye"}
    assert abs(np.log(fit.state.lens.focal_px[0] / lens.focal_px[0])) < min(3 * certainty.focal, 0.01)
    assert (np.abs(fit.state.lens.principal_px - lens.principal_px) < 4 * certainty.principal_px).all()
    assert 0.2 < fit.total_rms_px < 0.35
    verdict = judge(fit, certainty)
    assert verdict.refusals == ()


def test_ignored_motion_would_bias_the_focal_length(rng):
    """What the motion model is for: the same corners, boards taken to be at rest."""
    corners = collect(views_of(PINHOLE, shots(PINHOLE, 12, rng, turn_rad=0.02), rng, 0.1), PINHOLE.size_px)
    start = first_guess(corners, "pinhole")
    moving = fit_lens(corners, start)
    still = minimise(corners, start, Beliefs(np.full(corners.n_views, 0.1)))
    rest = predict(corners, still.state) - corners.xy_px
    assert np.sqrt((rest**2).sum(1).mean()) > 4 * moving.total_rms_px
    errors = [abs(np.log(s.lens.focal_px[0] / 880.0)) for s in (moving.state, still.state)]
    assert errors[0] < 0.5 * errors[1]


def test_a_view_of_another_zoom_is_set_aside(rng):
    views = views_of(PINHOLE, shots(PINHOLE, 12, rng), rng, 0.1)
    zoomed = replace(PINHOLE, focal_px=1.3 * PINHOLE.focal_px, distortion=-3 * PINHOLE.distortion)
    views[5] = replace(views_of(zoomed, shots(PINHOLE, 1, rng), rng, 0.1)[0], name="other")
    views[7].xy_px[3] += [15.0, -9.0]
    fit = choose_lens(collect(views, PINHOLE.size_px))[0]
    assert fit.views.tolist() == [0, 1, 2, 3, 4, 6, 7, 8, 9, 10, 11]
    false = int(collect(views, PINHOLE.size_px).start[7]) + 3
    assert not fit.used[false]
    np.testing.assert_allclose(fit.state.lens.focal_px, PINHOLE.focal_px, rtol=0.005)


def test_squeezed_pixels_are_taken_for_what_they_are(rng):
    anamorphic = replace(PINHOLE, focal_px=np.array([660.0, 880.0]), principal_px=np.array([485.0, 352.0]))
    anamorphic = replace(anamorphic, size_px=(960, 720))
    corners = collect(views_of(anamorphic, shots(anamorphic, 12, rng), rng, 0.1), anamorphic.size_px)
    fit = choose_lens(corners, "pinhole")[0]
    assert fit.state.lens.focal_px[1] / fit.state.lens.focal_px[0] == pytest.approx(4 / 3, rel=1e-9)
    assert not fit.beliefs.aspect_free


def verdict_of(taken, rng, lens=PINHOLE, noise_px=0.2):
    fit = choose_lens(collect(views_of(lens, taken, rng, noise_px), lens.size_px), lens.model)[0]
    certainty = assess(fit, rng)
    return judge(fit, certainty), certainty


def test_boards_seen_head_on_do_not_determine_a_lens(rng):
    verdict, certainty = verdict_of(shots(PINHOLE, 10, rng, tilt_deg=(0.0, 2.0), turn_rad=0.01), rng)
    assert len(verdict.refusals) == 1
    assert "tilt the board" in verdict.refusals[0]
    assert certainty.focal > 0.03


def test_boards_that_stay_in_the_middle_leave_the_distortion_open(rng):
    verdict, _ = verdict_of(shots(PINHOLE, 10, rng, reach=0.05, size=0.03), rng, noise_px=0.05)
    assert any("distortion is not determined" in reason for reason in verdict.refusals)


def test_a_side_of_the_picture_without_corners_is_named(rng):
    views = views_of(PINHOLE, shots(PINHOLE, 16, rng, reach=1.2), rng, 0.1)
    everywhere = choose_lens(collect(views, PINHOLE.size_px), "pinhole")[0]
    assert bare_sides(everywhere) == []
    to_the_right = [view for view in views if view.xy_px[:, 0].min() > 0.3 * 1280]
    assert len(to_the_right) >= 3
    one_sided = choose_lens(collect(to_the_right, PINHOLE.size_px), "pinhole")[0]
    assert "left" in bare_sides(one_sided)
    assert "right" not in bare_sides(one_sided)


def test_nothing_fits_views_of_no_board(rng):
    lattice = BOARD.lattice
    views = [View(f"{k}", lattice, rng.uniform(0, 700, (len(lattice), 2))) for k in range(5)]
    with pytest.raises(ValueError, match="corners: no"):
        choose_lens(collect(views, (1280, 720)))


def test_as_views_trims_names_sides_and_drops_what_is_too_little(rng):
    from skytrace.vision.board.chessboard import BoardCorners

    def board(columns, rows):
        lattice = np.array([(i, j) for i in range(columns) for j in range(rows)])
        return BoardCorners(lattice, 10.0 * lattice)

    views, size = as_views([("a", board(7, 6)), ("b", board(7, 6)), ("c", board(6, 7)), ("d", board(5, 4))])
    assert size == (7, 6)
    assert [(v.name, v.long_first) for v in views] == [("a", True), ("b", True), ("c", False), ("d", None)]
    line = BoardCorners(np.array([(i, 0) for i in range(12)]), np.zeros((12, 2)))
    assert as_views([("line", line), ("few", board(2, 2)), ("a", board(7, 6))], (7, 6))[0][0].name == "a"


def test_views_that_differ_are_chosen_before_those_alike(rng):
    views = views_of(PINHOLE, shots(PINHOLE, 5, rng))
    alike = [replace(views[0], name=f"again{k}", xy_px=views[0].xy_px + 0.5) for k in range(20)]
    chosen = spread_out([*alike[:10], *views, *alike[10:]], PINHOLE.size_px, 5)
    names = [view.name for view in chosen]
    assert set(names) >= {"view1", "view2", "view3", "view4"}
    assert len(names) == 5
    assert spread_out(views, PINHOLE.size_px, 5) == views


def test_coefficients_that_are_held_stay_zero(rng):
    corners = collect(views_of(PINHOLE, shots(PINHOLE, 6, rng)), PINHOLE.size_px)
    state = first_guess(corners, "pinhole")
    assert (state.lens.distortion[2:] == 0).all()
    assert BENDING.start + 5 == n_shared("pinhole")
