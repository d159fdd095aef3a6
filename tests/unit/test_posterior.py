"""Deviations of the estimate against dense algebra on tiny problems, and against what happens under noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import null_space
from test_adjust_kernel import RUNS, SPACING_S, random_problem, random_state, random_weights, taken
from test_adjust_solve import DEVIATION, coupling_of, dense_of, priors_about

from skytrace.estimation.adjust import reference, solve
from skytrace.estimation.adjust.driver import Adjusted
from skytrace.estimation.adjust.held_motion import HeldMotion
from skytrace.estimation.adjust.losses import LOSSES
from skytrace.estimation.adjust.problem import CENTRE, CLOCK, LENS, N_PARAMETERS, Weights
from skytrace.estimation.error_model import ErrorModel
from skytrace.estimation.influence import influence
from skytrace.estimation.known import Known
from skytrace.estimation.posterior import deviations, knot_weights, posterior
from skytrace.estimation.priors import motion_prior
from skytrace.estimation.scene import Scene

LENGTHS = tuple(b - a for a, b in RUNS)
N_KNOTS = sum(n + 1 for n in LENGTHS)


def adjusted_at(problem, state, weights, inflation=1.0, motion_weight=1e-4):
    """What an adjustment would hand over at a state."""
    return Adjusted(
        Scene("cam0", {}), ("cam0", "cam1", "cam2"), problem, state, priors_about(state), weights,
        motion_prior("jerk", SPACING_S, RUNS, motion_weight), np.zeros(len(problem.observations), np.int64),
        solve.predict(problem, state) - problem.observations.xy_px, inflation, 0.0, 1, "converged",
    )  # fmt: skip


def smooth(state, rng):
    """The state with a path that winds gently."""
    along = np.linspace(0, 1, len(state.control))[:, None]
    return replace(state, control=9 * np.sin(2 * np.pi * ([1.0, 1.5, 2.0] * along + rng.uniform(0, 1, 3))))


@pytest.fixture
def adjusted(rng):
    state = random_state(rng)
    problem = random_problem(rng, state, per_camera=90, noise_px=0.5)
    return adjusted_at(problem, state, random_weights(rng), inflation=7.0)


def some_errors(rng=None, slow=1.0):
    """Errors of the three cameras' detections, all different."""
    slow_px2 = np.array([0.0, 0.3, 0.9]) if rng is None else rng.uniform(0.1, 1.0, 3)
    return ErrorModel(np.array([0.2, 0.5, 0.1]), slow * slow_px2, 0.8, 0.0)


@pytest.fixture
def errors():
    return some_errors()


def dense_gradient_covariance(adjusted, errors):
    """What the errors of detections, priors and flight do to the gradient, (p + 3 m, p + 3 m), detection by detection.

    Detections of a camera within a knot interval count as one block for slow errors, as they do in the program.
    """
    moves = influence(adjusted)
    p, size = moves.n_unknowns, moves.follows.shape[0] * 3
    linear = reference.linearise(adjusted.problem, adjusted.state)
    camera = adjusted.problem.observations.camera
    squared = (adjusted.residual_px**2).sum(axis=1) / adjusted.weights.sigma_px[camera] ** 2
    w = LOSSES[adjusted.weights.loss].weight(squared, adjusted.weights.loss_scale**2)
    M = np.zeros((p + size, p + size))
    for i, c in enumerate(camera):
        scale = moves.weights.information[c] / moves.weights.sigma_px[c] ** 2
        J = row_of(moves.column[c], p, size, linear.by_camera[i], linear.by_point[i], linear.first[i], linear.basis[i])
        M += w[i] * moves.curvature[c] * scale**2 * errors.white_px2[c] * J.T @ J
    for c, b in enumerate(moves.blocks):
        rows = [
            b.weight[i] * row_of(moves.column[c], p, size, b.by_camera[i], b.by_point[i], b.first[i], b.basis[i])
            for i in range(len(b.time_s))
        ]
        for i, one in enumerate(rows):
            for j, other in enumerate(rows):
                correlation = np.exp(-abs(b.time_s[i] - b.time_s[j]) / errors.correlation_s)
                M += errors.slow_px2[c] * correlation * one.T @ other
    band = adjusted.motion.weight * adjusted.motion.band().T
    for d in range(12):
        spline = np.diag(band[: size - d, d], -d)
        M[p:, p:] += spline if d == 0 else spline + spline.T
    prior = adjusted.inflation * adjusted.priors.precision[adjusted.priors.free] ** 2
    M[np.arange(p), np.arange(p)] += prior
    return M


def row_of(column, p, size, by_camera, by_point, first, basis):
    """Derivatives (2, p + 3 m) of one projection by all unknowns."""
    J = np.zeros((2, p + size))
    J[:, column[column >= 0]] = by_camera[:, column >= 0]
    for k in range(4):
        J[:, p + 3 * (first + k) : p + 3 * (first + k) + 3] = basis[k] * by_point
    return J


def dense_covariance(adjusted, errors):
    """Covariance of the free camera parameters and all control coordinates, the unit of length held."""
    equations = influence(adjusted).equations
    H, _, constraint = dense_of(equations)
    scale = 1 / np.sqrt(np.diag(H))
    N = null_space((constraint * scale)[None])
    inner = N @ np.linalg.solve(N.T @ (H * np.outer(scale, scale)) @ N, N.T)
    inverse = inner * np.outer(scale, scale)
    return inverse @ dense_gradient_covariance(adjusted, errors) @ inverse, len(equations.camera)


def generators(points):
    """Displacements (3 n, 7) of points under translation, rotation and scaling, by differences of plain motions."""
    columns = [np.tile(axis, (len(points), 1)) for axis in np.eye(3)]
    columns += [np.cross(axis, points) for axis in np.eye(3)]
    columns.append(points)
    return np.stack([c.ravel() for c in columns], axis=1)


def knot_map(n_control, p):
    """Positions at knots as a linear map (3 k, p + 3 m) of all unknowns."""
    first = np.concatenate([s + np.arange(n + 1) for s, n in zip((0, LENGTHS[0] + 3), LENGTHS, strict=True)])
    P = np.zeros((len(first), n_control))
    for k, f in enumerate(first):
        P[k, f : f + 3] = [1 / 6, 4 / 6, 1 / 6]
    return np.hstack([np.zeros((3 * len(first), p)), np.kron(P, np.eye(3))]), P


def centre_map(free, n_unknowns):
    C = np.zeros((free.shape[0], 3, n_unknowns))
    column = np.cumsum(free.ravel()).reshape(free.shape) - 1
    for c in range(free.shape[0]):
        for axis in range(3):
            if free[c, CENTRE][axis]:
                C[c, axis, column[c, CENTRE.start + axis]] = 1
    return C.reshape(-1, n_unknowns)


def aligned(adjusted, supported, errors):
    """Linear maps of the aligned knots and centres, and the covariance of the unknowns."""
    covariance, p = dense_covariance(adjusted, errors)
    state = adjusted.state
    K, P = knot_map(len(state.control), p)
    C = centre_map(adjusted.priors.free, len(covariance))
    alignments = in_space_and_time(adjusted, P)
    fit = np.linalg.pinv(alignments[np.repeat(supported, 3)]) @ K[np.repeat(supported, 3)]
    return K - alignments @ fit, C - generators(state.centre) @ fit[:7], covariance, p


def in_space_and_time(adjusted, P):
    """Displacements (3 k, 9) of the knots under similarities and under a clock's offset and rate."""
    control, grid = adjusted.state.control, adjusted.problem.grid
    start = np.array([np.flatnonzero(row)[0] for row in P])
    velocity = (control[start + 2] - control[start]) / (2 * SPACING_S)
    late = [velocity.ravel(), (grid.knots_s()[:, None] * velocity).ravel()]
    return np.column_stack([generators(P @ control), *late])


def spreads(linear_map, covariance):
    return np.sqrt(np.einsum("ij,jk,ik->i", linear_map, covariance, linear_map))


def test_knots_lie_between_their_control_points():
    first, weights = knot_weights((2, 1))
    np.testing.assert_array_equal(first, [0, 1, 2, 5, 6])
    np.testing.assert_allclose(weights, [1 / 6, 4 / 6, 1 / 6])


def centre_deviation(found):
    return np.sqrt(np.diagonal(found.centre_covariance, axis1=1, axis2=2))


def test_camera_deviations_equal_those_of_the_dense_sandwich(adjusted, errors):
    mean_s = np.array([10.0, 40.0, 300.0])
    found = deviations(influence(adjusted), errors, mean_s, np.ones(N_KNOTS, bool))
    covariance, p = dense_covariance(adjusted, errors)
    free = adjusted.priors.free
    expected = np.zeros((3, N_PARAMETERS))
    expected[free] = np.sqrt(np.diag(covariance)[:p])
    np.testing.assert_allclose(found.clock, expected[:, CLOCK], rtol=1e-6)
    np.testing.assert_allclose(found.lens, expected[:, LENS], rtol=1e-6)
    column = np.cumsum(free.ravel()).reshape(free.shape) - 1
    for c in range(3):
        if c == adjusted.problem.reference:
            assert found.clock_offset[c] == 0
            np.testing.assert_array_equal(found.clock[c, :2], 0)
        else:
            at_zero = np.zeros(len(covariance))
            at_zero[column[c, 6]], at_zero[column[c, 7]] = 1, -mean_s[c]
            assert found.clock_offset[c] == pytest.approx(np.sqrt(at_zero @ covariance @ at_zero), rel=1e-6)


@pytest.mark.parametrize("left_out", [[], [0, 1, 2, 12], [7, 8, 19]])
def test_position_deviations_equal_those_of_dense_algebra_after_alignment(adjusted, errors, left_out):
    """What the cameras' uncertainty adds is aligned; the spline's own, too local to align, is not."""
    supported = np.ones(N_KNOTS, bool)
    supported[left_out] = False
    moves = influence(adjusted)
    found = deviations(moves, errors, np.zeros(3), supported)
    K, C, covariance, p = aligned(adjusted, supported, errors)
    inverse = np.linalg.inv(dense_of(moves.equations)[0][p:, p:])
    white = dense_gradient_covariance(adjusted, replace(errors, slow_px2=np.zeros(3)))[p:, p:]
    plain = knot_map(len(adjusted.state.control), p)[0][:, p:]
    variance = spreads(plain, inverse @ white @ inverse) ** 2
    # Given the cameras the spline follows by regression: unknowns = [1; -S^-1 coupling] camera.
    follow = K @ np.vstack([np.eye(p), -inverse @ coupling_of(moves.equations)])
    variance += spreads(follow, covariance[:p, :p]) ** 2
    knots_s = adjusted.problem.grid.knots_s()
    for slow, response, b, score in zip(
        errors.slow_px2, moves.bias_response, moves.blocks, moves.scores(), strict=True
    ):
        moved = plain @ response.reshape(-1, 2)
        variance += slow * (moved**2).sum(axis=1)
        correlation = np.exp(-np.abs(knots_s[:, None] - b.time_s) / errors.correlation_s)
        unknowns = moves.response @ np.einsum("kb,bpx->kpx", correlation, score)
        variance += 2 * slow * np.einsum("ip,ipx,ix->i", follow, np.repeat(unknowns, 3, axis=0), moved)
    np.testing.assert_allclose(found.knot_sigma, np.sqrt(variance.reshape(-1, 3).sum(axis=1)), rtol=1e-5)
    follow = np.vstack([np.eye(p), -inverse @ coupling_of(moves.equations)])
    centre = spreads(C @ follow, covariance[:p, :p]).reshape(3, 3)
    np.testing.assert_allclose(centre_deviation(found), centre, rtol=1e-6)


def test_leaving_the_spline_unaligned_changes_little(adjusted):
    """Without slow errors, which are counted apart."""
    errors, supported = some_errors(slow=0.0), np.ones(N_KNOTS, bool)
    found = deviations(influence(adjusted), errors, np.zeros(3), supported)
    K, C, covariance, _ = aligned(adjusted, supported, errors)
    sigma = np.sqrt((spreads(K, covariance) ** 2).reshape(-1, 3).sum(axis=1))
    assert np.median(np.abs(found.knot_sigma / sigma - 1)) < 0.3
    np.testing.assert_allclose(centre_deviation(found), spreads(C, covariance).reshape(3, 3), rtol=0.3)


def test_deviations_scale_with_the_errors(adjusted, errors):
    """Where there are no priors, which have deviations of their own."""
    free = replace(
        adjusted,
        priors=replace(adjusted.priors, deviation=np.where(adjusted.priors.free, np.inf, 0.0)),
        motion=adjusted.motion.weighted(0.0),
    )
    moves, supported = influence(free), np.ones(N_KNOTS, bool)
    double = replace(errors, white_px2=4 * errors.white_px2, slow_px2=4 * errors.slow_px2)
    one, two = (deviations(moves, e, np.zeros(3), supported) for e in (errors, double))
    for name in ("knot_sigma", "clock", "clock_offset", "lens"):
        np.testing.assert_allclose(getattr(two, name), 2 * getattr(one, name), rtol=1e-6)
    np.testing.assert_allclose(two.centre_covariance, 4 * one.centre_covariance, rtol=1e-6)


def test_a_prior_that_was_tightened_is_as_uncertain_as_it_was_given(adjusted):
    """Detections without errors, a parameter that only its prior determines: its deviation is the prior's."""
    exact = ErrorModel(np.zeros(3), np.zeros(3), 1.0, 0.0)
    tight = replace(
        adjusted, priors=replace(adjusted.priors, deviation=np.where(adjusted.priors.free, 1e-9, 0.0)), inflation=16.0
    )
    found = deviations(influence(tight), exact, np.zeros(3), np.ones(N_KNOTS, bool))
    np.testing.assert_allclose(found.lens, 4e-9, rtol=1e-3)


@pytest.mark.parametrize(("free_clocks", "tolerance"), [(False, 1e-5), (True, 0.03)])
def test_the_choice_of_the_reference_does_not_enter(rng, free_clocks, tolerance):
    """The camera that fixes frame, unit and clock: positions, lenses and centres are as sure with any other.

    Clocks are when they are told by the same camera. A spline moved in time is a spline only nearly.
    """
    state = smooth(random_state(rng), rng)
    problem = random_problem(rng, state, per_camera=90, noise_px=0.5)
    weights = random_weights(rng)
    found = []
    for reference_camera in (0, 2):
        a = adjusted_at(replace(problem, reference=reference_camera), state, weights)
        deviation = np.tile(DEVIATION, (3, 1))
        deviation[:, 6:8] = np.inf if free_clocks else 0.0
        deviation[reference_camera, :8] = 0
        a = replace(a, priors=replace(a.priors, deviation=deviation), motion=a.motion.weighted(0.0))
        mean_s = np.array([10.0, 40.0, 300.0])
        found.append(deviations(influence(a), some_errors(), mean_s, np.ones(N_KNOTS, bool), reference=2))
    for name in ("lens", "clock", "clock_offset"):
        np.testing.assert_allclose(getattr(found[0], name), getattr(found[1], name), rtol=tolerance, atol=1e-12)
    assert found[0].clock[2, :2].max() < 1e-12
    # The spline's own part is that of fixed cameras in either case; the aligned part is the same.
    np.testing.assert_allclose(found[0].knot_sigma, found[1].knot_sigma, rtol=tolerance)
    size = np.abs(found[1].centre_covariance).max()
    np.testing.assert_allclose(found[0].centre_covariance, found[1].centre_covariance, atol=tolerance * size)
    assert (centre_deviation(found[0]) > 0).all()


def held_softly(adjusted, undetermined, centre_sigma):
    """The same adjustment with no camera's pose held, centres known so well, and the rest of the frame held softly."""
    a = adjusted
    deviation = np.array(a.priors.deviation)
    deviation[:, :6] = np.inf
    deviation[:, CENTRE] = centre_sigma
    known = Known(undetermined=undetermined, unit_known=undetermined.shape[1] == 0)
    terms = (HeldMotion.at(a.state, undetermined),) if undetermined.shape[1] else ()
    mean = np.array(a.priors.mean)
    mean[:, CENTRE] = a.state.centre
    problem = replace(a.problem, unit_held=not known.unit_known)
    return replace(
        a, problem=problem, priors=replace(a.priors, mean=mean, deviation=deviation, terms=terms), known=known
    )


def test_a_frame_of_which_nothing_is_known_is_a_gauge_like_the_reference_camera(adjusted, errors):
    """Whichever way it is held, deviations are the same."""
    free = replace(adjusted, motion=adjusted.motion.weighted(0.0))
    soft = held_softly(free, np.eye(6), np.inf)
    one, other = (deviations(influence(a), errors, np.zeros(3), np.ones(N_KNOTS, bool)) for a in (free, soft))
    np.testing.assert_allclose(other.knot_sigma, one.knot_sigma, rtol=1e-3)
    np.testing.assert_allclose(other.shape_sigma, one.shape_sigma, rtol=1e-3)
    np.testing.assert_allclose(other.lens, one.lens, rtol=1e-4)
    size = np.abs(one.centre_covariance).max()
    np.testing.assert_allclose(other.centre_covariance, one.centre_covariance, atol=1e-3 * size)


def test_known_centres_are_at_most_as_uncertain_as_they_were_given(adjusted, errors):
    """Given badly they leave the flight's shape as it is, and its place as uncertain as they are."""
    inflated = replace(adjusted, inflation=1.0)
    plain = deviations(influence(inflated), errors, np.zeros(3), np.ones(N_KNOTS, bool))
    for sigma in (0.01, 100.0):
        found = deviations(
            influence(held_softly(inflated, np.zeros((6, 0)), sigma)), errors, np.zeros(3), np.ones(N_KNOTS, bool)
        )
        assert centre_deviation(found).max() <= 1.01 * sigma
        assert (found.knot_sigma >= 0.9 * found.shape_sigma).all()
        if sigma == 100.0:
            np.testing.assert_allclose(found.shape_sigma, plain.shape_sigma, rtol=0.05)
            assert np.median(found.knot_sigma) > 20


def test_wild_knots_do_not_spoil_the_alignment(rng):
    """Nobody saw the last part of the second run: it may count as supported or not, the rest stays as it is."""
    state = random_state(rng)
    problem = random_problem(rng, state, per_camera=120, noise_px=0.5)
    o = problem.observations
    time = state.clock[o.camera, 0] + state.clock[o.camera, 1] * o.tau_s + state.clock[o.camera, 2] * o.row
    seen = time < SPACING_S * 14
    problem = replace(problem, observations=type(o)(o.camera[seen], o.tau_s[seen], o.row[seen], o.xy_px[seen]))
    adjusted = adjusted_at(problem, state, random_weights(rng), motion_weight=1e-9)
    all_knots = np.ones(N_KNOTS, bool)
    known = all_knots.copy()
    known[-2:] = False
    everything, careful = (posterior(adjusted, np.zeros(3), s) for s in (all_knots, known))
    assert careful.knot_sigma[-1] > 50 * np.median(careful.knot_sigma)
    np.testing.assert_allclose(everything.knot_sigma[:13], careful.knot_sigma[:13], rtol=0.2)


@pytest.mark.parametrize("slow_px", [0.0, 1.0])
def test_deviations_predict_the_errors_under_noise(slow_px):
    """Eighty fits to fresh noise: the errors, after alignment, have the deviations that were claimed."""
    rng = np.random.default_rng(11)
    truth = smooth(random_state(rng), rng)
    problem = random_problem(rng, truth, per_camera=240)
    # Rows as smooth as the image paths are; detections of a knot interval are taken as alike.
    rows = replace(problem.observations, row=0.5 + 0.4 * np.sin(problem.observations.tau_s))
    problem = replace(problem, observations=rows)
    xy_px = solve.predict(problem, truth)
    kept = np.isfinite(xy_px[:, 0])
    problem = replace(problem, observations=taken(replace(rows, xy_px=xy_px), kept))
    weights = Weights(np.full(3, np.hypot(0.5, slow_px)), np.ones(3), loss_scale=100.0)
    motion_weight, correlation_s = 1e-8, 0.7
    motion = motion_prior("jerk", SPACING_S, RUNS, motion_weight)
    errors = ErrorModel(np.full(3, 0.25), np.full(3, slow_px**2), correlation_s, 0.0)
    exact = adjusted_at(problem, truth, weights, motion_weight=motion_weight)
    claimed = deviations(influence(exact), errors, np.zeros(3), np.ones(N_KNOTS, bool))
    P = knot_map(len(truth.control), 0)[1]
    alignments = in_space_and_time(exact, P)
    knots, clocks, lenses = [], [], []
    priors = priors_about(truth)
    o = problem.observations
    lag_s = np.abs(o.tau_s[:, None] - o.tau_s[None])
    drift = np.linalg.cholesky(
        np.where(o.camera[:, None] == o.camera, np.exp(-lag_s / correlation_s), 0.0) + 1e-9 * np.eye(len(o))
    )
    small = 0.02  # within which the estimate is linear
    for _ in range(80):
        noise = 0.5 * rng.normal(size=o.xy_px.shape) + slow_px * drift @ rng.normal(size=o.xy_px.shape)
        # A prior is a measurement too, and errs by its deviation.
        slip = np.where(np.isfinite(DEVIATION), DEVIATION, 0) * rng.normal(size=(3, N_PARAMETERS))
        seen = replace(problem, observations=replace(o, xy_px=o.xy_px + small * noise))
        slipped = replace(priors, mean=priors.mean + small * slip)
        found = solve.minimise(seen, truth, slipped, weights, motion).state
        error = (P @ (found.control - truth.control)).ravel() / small
        error -= alignments @ np.linalg.lstsq(alignments, error, rcond=None)[0]
        knots.append((error.reshape(-1, 3) ** 2).sum(axis=1))
        clocks.append((found.clock - truth.clock) / small)
        lenses.append((found.lens - truth.lens) / small)
    ratio = np.sqrt(np.mean(knots, axis=0)) / claimed.knot_sigma
    # A flight of a few correlation times is aligned with its own slow errors, which the claims count in full.
    assert (0.75 if slow_px else 0.85) < np.median(ratio) < 1.15
    free = claimed.clock > 0
    assert 0.85 < np.median(np.std(clocks, axis=0)[free] / claimed.clock[free]) < 1.15
    assert 0.85 < np.median(np.std(lenses, axis=0) / claimed.lens) < 1.15
