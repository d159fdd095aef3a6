"""Flights filmed by the same cameras, joined: as good as one big adjustment, better than alone, and safe."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pytest
from benchmarks.same_cameras import filmed_by_the_same, zoomed

from skytrace.errors import ReconstructionError
from skytrace.estimation.adjust import normal, solve
from skytrace.estimation.adjust.camera_priors import GaussianTerm, Priors
from skytrace.estimation.adjust.driver import Adjusted
from skytrace.estimation.adjust.problem import FOCAL, N_PARAMETERS, READOUT
from skytrace.estimation.shared_devices import Ties, likelihood, message, priors_of, total
from skytrace.pipeline.config import Config
from skytrace.pipeline.joint import Joint, join
from skytrace.pipeline.offline import Outcome, concluded, outcome, run
from skytrace.pipeline.prepare import Prepared, prepare_recordings
from skytrace.simulation.simulator import SimulatedFlight
from tests.recovery.scenes import judged

CONFIG = Config()


@dataclass(frozen=True, eq=False)
class Alone:
    """A flight reconstructed by itself."""

    simulated: SimulatedFlight
    prepared: Prepared
    outcome: Outcome

    def path_error_m(self, found: Outcome) -> float:
        return float(np.sqrt(np.mean(judged(self.simulated, self.prepared, found).error_m ** 2)))

    def lens_errors(self, found: Outcome) -> tuple[np.ndarray, np.ndarray]:
        """Errors of the focal scales and of the readouts, all cameras."""
        ids, state = found.adjusted.camera_ids, found.adjusted.state
        true = [self.simulated.truth.cameras[c] for c in ids]
        focal = [np.log(c.intrinsics.focal_px[0] / c.calibrated.focal_px[0]) for c in true]
        return state.lens[:, 0] - focal, state.clock[:, 2] - [c.clock.readout_s for c in true]


def reconstructed(simulated: SimulatedFlight) -> Alone:
    prepared = prepare_recordings(simulated.recordings, CONFIG.clean)
    return Alone(simulated, prepared, outcome(run(prepared.recordings, CONFIG)))


CAMERAS = ("cam0", "cam1", "cam2")


def by_camera(found: Outcome, values: np.ndarray) -> np.ndarray:
    """Rows of an adjustment in the order of the cameras' names: its own is that of its growth."""
    return values[[found.adjusted.camera_ids.index(c) for c in CAMERAS]]


def joined(alone: Mapping[str, Alone]) -> Joint:
    return join({f: a.outcome for f, a in alone.items()}, {}, CONFIG)


@pytest.fixture(scope="module")
def flights() -> dict[int, dict[str, Alone]]:
    """Pairs of flights by the seed of their cameras."""
    return {c: {f: reconstructed(filmed_by_the_same(c, k)) for k, f in enumerate("ab")} for c in (1, 2, 3)}


def test_two_weak_flights_are_better_together(flights) -> None:
    focal, readout, path = ({"alone": [], "joint": []} for _ in range(3))
    for pair in flights.values():
        joint = joined(pair)
        assert joint.agreed
        assert joint.warnings == ()
        for name, alone in pair.items():
            for which, found in (("alone", alone.outcome), ("joint", joint.outcomes[name])):
                errors = alone.lens_errors(found)
                focal[which] += list(errors[0])
                readout[which] += list(errors[1])
                path[which].append(alone.path_error_m(found))
        joint_focal = joint.devices[0].parameters["focal_scale"]
        assert joint_focal.joint.deviation < min(e.deviation for e in joint_focal.alone.values())

    def rms(values) -> float:
        return float(np.sqrt(np.mean(np.square(values))))

    assert rms(focal["joint"]) < 0.85 * rms(focal["alone"])
    assert rms(readout["joint"]) < 1.02 * rms(readout["alone"])
    assert rms(path["joint"]) < rms(path["alone"])


def test_flights_agree_and_claim_smaller_deviations(flights) -> None:
    pair = flights[1]
    joint = joined(pair)
    lenses = [by_camera(o, o.adjusted.state.lens) for o in joint.outcomes.values()]
    deviations = np.stack([by_camera(o, o.posterior.lens) for o in joint.outcomes.values()])
    apart = np.abs(lenses[0] - lenses[1])[:, :4]  # distortion is each flight's own
    assert (apart < 0.2 * deviations.min(axis=0)[:, :4]).all()
    before = np.stack([by_camera(a.outcome, a.outcome.posterior.lens) for a in pair.values()])
    assert (deviations[:, :, 0] < before[:, :, 0]).all()
    assert joint.devices[0].parameters["focal_scale"].joint.value == pytest.approx(lenses[0][0, 0], abs=3e-4)


def test_the_order_of_flights_does_not_matter(flights) -> None:
    pair = flights[1]
    one, other = joined(pair), joined({f: pair[f] for f in "ba"})
    assert list(one.outcomes) == ["a", "b"]
    assert list(other.outcomes) == ["b", "a"]
    for f in "ab":
        np.testing.assert_array_equal(one.outcomes[f].adjusted.state.lens, other.outcomes[f].adjusted.state.lens)


def test_a_changed_zoom_is_found_named_and_not_shared(flights) -> None:
    pair = dict(flights[1])
    pair["b"] = reconstructed(zoomed(pair["b"].simulated, "cam1", 1.15))
    joint = joined(pair)
    (warning,) = joint.warnings
    (percent,) = re.findall(r"cam1 of [ab].* its focal length is ([+-]\d+\.\d) % off", warning)
    assert abs(float(percent)) == pytest.approx(15, abs=5)
    by_name = {d.device.name: d for d in joint.devices}
    assert by_name["cam1"].parameters == {}
    assert list(by_name["cam1"].left_out.values()) == [warning]
    focal = [by_camera(o, o.adjusted.state.lens[:, 0]) for o in joint.outcomes.values()]
    assert focal[1][[0, 2]] == pytest.approx(focal[0][[0, 2]], abs=1e-3)
    assert focal[1][1] > focal[0][1] + 0.02  # its prior, seven deviations off, holds it back
    # A zoom shared all the same would spoil the flight that had none.
    assert pair["a"].path_error_m(joint.outcomes["a"]) < 1.2 * pair["a"].path_error_m(pair["a"].outcome)


def test_flights_of_different_devices_stay_as_they_are(flights) -> None:
    pair = {"a": flights[1]["a"], "b": flights[2]["b"]}
    joint = joined(pair)
    assert joint.devices == ()
    assert joint.rounds == 0
    assert all(joint.outcomes[f] is pair[f].outcome for f in pair)


def test_a_flight_that_sharing_leaves_without_a_trajectory_stays_as_it_was(flights, monkeypatch) -> None:
    def nothing(before: Outcome, adjusted: Adjusted, config: Config) -> Outcome:
        if before is flights[1]["b"].outcome:
            raise ReconstructionError("cover", "no stretch is supported")
        return concluded(before, adjusted, config)

    monkeypatch.setattr("skytrace.pipeline.exchange.concluded", nothing)
    joint = joined(flights[1])
    assert joint.outcomes["b"] is flights[1]["b"].outcome
    assert joint.outcomes["a"] is not flights[1]["a"].outcome
    (warning,) = joint.warnings
    assert warning.startswith("b is left as it was")


def test_where_messages_settle_is_the_joint_optimum(flights) -> None:
    """The sum of both flights' least costs over everything of their own is at its minimum there."""
    flight = {f: alone.outcome.adjusted for f, alone in flights[1].items()}
    columns = {
        f: np.array([a.camera_ids.index(c) * N_PARAMETERS + k for c in CAMERAS for k in (READOUT, FOCAL)])
        for f, a in flight.items()
    }
    n = 2 * len(CAMERAS)
    ties = {f: Ties(columns[f], np.arange(n)) for f in flight}
    prior = priors_of([(flight[f], ties[f]) for f in flight], n)
    base = {f: a.priors for f, a in flight.items()}
    received: dict[str, GaussianTerm | None] = dict.fromkeys(flight)
    for _ in range(8):
        said = {f: likelihood(flight[f], ties[f], received[f]) for f in flight}
        for f in flight:
            term = received[f] = message(f, said, ties, prior)
            flight[f] = settled(flight[f], replace(base[f], terms=(term.tightened(flight[f].inflation),)))
    shared = {f: flight[f].state.parameters().ravel()[columns[f]] for f in flight}
    covariance = np.linalg.inv(total(said, ties, prior).precision)
    sd = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(shared["a"], shared["b"], rtol=0, atol=1e-10)

    def least_cost(value: np.ndarray) -> float:
        """Honest costs of all flights with the shared parameters held, and of what was known of these, once."""
        cost = 0.5 * float(((value - prior.mean) ** 2 * np.diag(prior.precision)).sum())
        for f, adjusted in flight.items():
            held = base[f].deviation.ravel().copy()
            held[columns[f]] = 0.0
            priors = replace(base[f], deviation=held.reshape(base[f].deviation.shape))
            parameters = adjusted.state.parameters()
            parameters.ravel()[columns[f]] = value
            state = replace(adjusted.state, clock=parameters[:, 6:9], lens=parameters[:, 9:])
            cost += settled(replace(adjusted, state=state), priors).cost / adjusted.inflation
        return cost

    step = 3e-3
    steps = step * np.diag(sd)
    gradient = [least_cost(shared["a"] + s) - least_cost(shared["a"] - s) for s in steps] / (2 * step * sd)
    away = covariance @ gradient
    assert np.abs(away).max() < 1e-6
    assert np.abs(away / sd).max() < 2e-5


def settled(adjusted: Adjusted, priors: Priors) -> Adjusted:
    """The minimum for these priors, weights and all else held, further than costs can tell."""
    problem, weights, motion = adjusted.problem, adjusted.weights, adjusted.motion
    state = solve.minimise(problem, adjusted.state, priors, weights, motion, max_iterations=100, tolerance=1e-9).state
    for _ in range(12):
        equations = solve.assemble(problem, state, priors, weights, motion)
        cameras, spline = normal.step(equations, normal.eliminate(equations, 0.0))
        unknown = equations.column
        by_parameter = np.where(unknown >= 0, np.append(cameras, 0.0)[unknown], 0.0)
        state = state.moved(by_parameter.reshape(-1, N_PARAMETERS), spline.reshape(-1, 3))
    residual = solve.predict(problem, state) - problem.observations.xy_px
    cost = solve.cost(problem, state, priors, weights, motion)
    return replace(adjusted, state=state, priors=priors, residual_px=residual, cost=cost)
