"""Deviations of the estimate against dense algebra on tiny problems, and against what happens under noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import null_space
from test_adjust_kernel import RUNS, SPACING_S, random_problem, random_state, random_weights
from test_adjust_solve import DEVIATION, dense_of, priors_about

from skytrace.estimation.adjust import solve
from skytrace.estimation.adjust.driver import Adjusted
from skytrace.estimation.adjust.problem import CENTRE, CLOCK, LENS, N_PARAMETERS, Weights
from skytrace.estimation.posterior import knot_weights, posterior
from skytrace.estimation.priors import motion_prior
from skytrace.estimation.scene import Scene
from skytrace.geometry.rigid import align_similarity

LENGTHS = tuple(b - a for a, b in RUNS)
N_KNOTS = sum(n + 1 for n in LENGTHS)


def adjusted_at(problem, state, weights, inflation=1.0, motion_weight=1e-4):
    """What an adjustment would hand over at a state."""
    return Adjusted(
        Scene("cam0", {}), ("cam0", "cam1", "cam2"), problem, state, priors_about(state), weights,
        motion_prior("jerk", SPACING_S, RUNS, motion_weight), np.zeros(len(problem.observations), np.int64),
        solve.predict(problem, state) - problem.observations.xy_px, inflation, 0.0, 1, True,
    )  # fmt: skip


@pytest.fixture
def adjusted(rng):
    state = random_state(rng)
    problem = random_problem(rng, state, per_camera=90, noise_px=0.5)
    return adjusted_at(problem, state, random_weights(rng), inflation=7.0)


def dense_covariance(adjusted):
    """Covariance of the free camera parameters and all control coordinates, the unit of length held."""
    equations = solve.assemble(adjusted.problem, adjusted.state, adjusted.priors, adjusted.weights, adjusted.motion)
    H, _, constraint = dense_of(equations)
    scale = 1 / np.sqrt(np.diag(H))
    N = null_space((constraint * scale)[None])
    inner = N @ np.linalg.solve(N.T @ (H * np.outer(scale, scale)) @ N, N.T)
    return inner * np.outer(scale, scale), len(equations.camera)


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


def aligned(adjusted, supported):
    """Linear maps of the aligned knots and centres, and the covariance of the unknowns."""
    covariance, p = dense_covariance(adjusted)
    state = adjusted.state
    K, P = knot_map(len(state.control), p)
    C = centre_map(adjusted.priors.free, len(covariance))
    positions = P @ state.control
    rows = np.repeat(supported, 3)
    fit = np.linalg.pinv(generators(positions[supported])) @ K[rows]
    return K - generators(positions) @ fit, C - generators(state.centre) @ fit, covariance, p


def deviations(linear_map, covariance):
    return np.sqrt(np.einsum("ij,jk,ik->i", linear_map, covariance, linear_map))


def test_knots_lie_between_their_control_points():
    first, weights = knot_weights((2, 1))
    np.testing.assert_array_equal(first, [0, 1, 2, 5, 6])
    np.testing.assert_allclose(weights, [1 / 6, 4 / 6, 1 / 6])


def test_camera_deviations_equal_those_of_the_dense_inverse(adjusted):
    mean_s = np.array([10.0, 40.0, 300.0])
    found = posterior(adjusted, mean_s, np.ones(N_KNOTS, bool))
    covariance, p = dense_covariance(adjusted)
    free = adjusted.priors.free
    expected = np.zeros((3, N_PARAMETERS))
    expected[free] = np.sqrt(7.0 * np.diag(covariance)[:p])
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
            assert found.clock_offset[c] == pytest.approx(np.sqrt(7.0 * at_zero @ covariance @ at_zero), rel=1e-6)


@pytest.mark.parametrize("left_out", [[], [0, 1, 2, 12], [7, 8, 19]])
def test_position_deviations_equal_those_of_the_dense_inverse_after_alignment(adjusted, left_out):
    """What the cameras' uncertainty adds is aligned; the spline's own, too local to align, is not."""
    supported = np.ones(N_KNOTS, bool)
    supported[left_out] = False
    found = posterior(adjusted, np.zeros(3), supported)
    K, C, covariance, p = aligned(adjusted, supported)
    equations = solve.assemble(adjusted.problem, adjusted.state, adjusted.priors, adjusted.weights, adjusted.motion)
    spline = dense_of(equations)[0][p:, p:]
    plain = knot_map(len(adjusted.state.control), p)[0][:, p:]
    local = np.einsum("ij,jk,ik->i", plain, np.linalg.inv(spline), plain)
    # Given the cameras the spline follows by regression: unknowns = [1; -S^-1 coupling] camera.
    coupling, used = np.zeros((len(spline), p)), equations.column >= 0
    np.add.at(coupling.T, equations.column[used], equations.coupling[:, used].T)
    follow = np.vstack([np.eye(p), -np.linalg.solve(spline, coupling)])
    cameras = deviations(K @ follow, covariance[:p, :p]) ** 2
    sigma = np.sqrt(7.0 * (local + cameras).reshape(-1, 3).sum(axis=1))
    np.testing.assert_allclose(found.knot_sigma, sigma, rtol=1e-6)
    centre = np.sqrt(7.0) * deviations(C @ follow, covariance[:p, :p]).reshape(3, 3)
    np.testing.assert_allclose(found.centre, centre, rtol=1e-6)


def test_leaving_the_spline_unaligned_changes_little(adjusted):
    supported = np.ones(N_KNOTS, bool)
    found = posterior(adjusted, np.zeros(3), supported)
    K, C, covariance, _ = aligned(adjusted, supported)
    sigma = np.sqrt(7.0 * (deviations(K, covariance) ** 2).reshape(-1, 3).sum(axis=1))
    assert np.median(np.abs(found.knot_sigma / sigma - 1)) < 0.3
    np.testing.assert_allclose(found.centre, np.sqrt(7) * deviations(C, covariance).reshape(3, 3), rtol=0.3)


def test_deviations_scale_with_noise_and_inflation(adjusted):
    supported = np.ones(N_KNOTS, bool)
    free = replace(
        adjusted,
        priors=replace(adjusted.priors, deviation=np.where(adjusted.priors.free, np.inf, 0.0)),
        motion=adjusted.motion.weighted(0.0),
    )
    # Without outliers the robust weights hardly depend on sigma, but the fit must be exact for them not to at all.
    exact = replace(
        free.problem,
        observations=replace(free.problem.observations, xy_px=solve.predict(free.problem, free.state)),
    )
    free = replace(free, problem=exact)
    double = replace(free, weights=Weights(2 * free.weights.sigma_px, free.weights.information))
    correlated = replace(free, inflation=4 * free.inflation)
    base = posterior(free, np.zeros(3), supported)
    for other in (double, correlated):
        found = posterior(other, np.zeros(3), supported)
        for name in ("knot_sigma", "centre", "clock", "clock_offset", "lens"):
            np.testing.assert_allclose(getattr(found, name), 2 * getattr(base, name), rtol=1e-5)


def test_the_choice_of_the_reference_does_not_enter(rng):
    """With known clocks: the reference then fixes the frame and unit of length alone."""
    state = random_state(rng)
    problem = random_problem(rng, state, per_camera=90)
    weights = random_weights(rng)
    found = []
    for reference in (0, 2):
        a = adjusted_at(replace(problem, reference=reference), state, weights)
        deviation = np.tile(DEVIATION, (3, 1))
        deviation[:, 6:8] = 0
        deviation[reference, :6] = 0
        a = replace(a, priors=replace(a.priors, deviation=deviation), motion=a.motion.weighted(0.0))
        found.append(posterior(a, np.zeros(3), np.ones(N_KNOTS, bool)))
    np.testing.assert_allclose(found[0].lens, found[1].lens, rtol=1e-6)
    # The spline's own part is that of fixed cameras in either case; the aligned part is the same.
    np.testing.assert_allclose(found[0].knot_sigma, found[1].knot_sigma, rtol=1e-6)
    np.testing.assert_allclose(found[0].centre, found[1].centre, rtol=1e-6)
    assert (found[0].centre > 0).all()


def test_wild_knots_do_not_spoil_the_alignment(rng):
    """Nobody saw the last part of the second run: it may count as supported or not, the rest stays as it is."""
    state = random_state(rng)
    problem = random_problem(rng, state, per_camera=120)
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


def test_deviations_predict_the_errors_under_noise():
    """Thirty fits to fresh noise: the errors, after alignment, have the deviations that were claimed."""
    rng = np.random.default_rng(11)
    truth = random_state(rng)
    problem = random_problem(rng, truth, per_camera=120)
    weights = Weights(np.full(3, 0.5), np.ones(3), loss_scale=100.0)
    motion_weight = 1e-8
    claimed = posterior(
        adjusted_at(problem, truth, weights, motion_weight=motion_weight), np.zeros(3), np.ones(N_KNOTS, bool)
    )
    P = knot_map(len(truth.control), 0)[1]
    knots, clocks, lenses = [], [], []
    priors = priors_about(truth)
    for _ in range(30):
        noisy = problem.observations.xy_px + 0.5 * rng.normal(size=problem.observations.xy_px.shape)
        # A prior is a measurement too, and errs by its deviation.
        slip = np.where(np.isfinite(DEVIATION), DEVIATION, 0) * rng.normal(size=(3, N_PARAMETERS))
        seen = replace(problem, observations=replace(problem.observations, xy_px=noisy))
        slipped = replace(priors, mean=priors.mean + slip)
        motion = motion_prior("jerk", SPACING_S, RUNS, motion_weight)
        found = solve.minimise(seen, truth, slipped, weights, motion).state
        moved = align_similarity(P @ found.control, P @ truth.control).apply(P @ found.control)
        knots.append(((moved - P @ truth.control) ** 2).sum(axis=1))
        clocks.append(found.clock - truth.clock)
        lenses.append(found.lens - truth.lens)
    ratio = np.sqrt(np.mean(knots, axis=0)) / claimed.knot_sigma
    assert 0.8 < np.median(ratio) < 1.25
    free = claimed.clock > 0
    assert 0.75 < np.median(np.std(clocks, axis=0)[free] / claimed.clock[free]) < 1.3
    assert 0.75 < np.median(np.std(lenses, axis=0) / claimed.lens) < 1.3
