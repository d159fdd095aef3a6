"""What is known of the cameras gives metres, levels the world and improves the flight; one wrong thing does no harm."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from benchmarks.known_positions import FLIGHT, distance, errors, positions, reconstructed, verticals

from skytrace.estimation.known import Known, KnownPosition, KnownReadout
from skytrace.estimation.known_placement import place
from skytrace.geometry.rigid import Similarity
from skytrace.model.georeference import Georeference
from skytrace.pipeline.known_summary import known_section, known_warnings
from skytrace.pipeline.offline import Outcome
from skytrace.simulation import simulate


@pytest.fixture(scope="module")
def simulated():
    return simulate(replace(FLIGHT, duration_s=36.0), np.random.default_rng(4))


@pytest.fixture(scope="module")
def blind(simulated):
    return reconstructed(simulated, None)


def section_of(found: Outcome) -> dict[str, Any]:
    section = known_section(found)
    assert section is not None
    return section


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(8)


def test_without_knowledge_nothing_is_said_of_it(blind):
    assert blind.reconstruction.gauge == "arbitrary"
    assert blind.reconstruction.frame == "camera"
    assert known_section(blind) is None
    assert known_warnings(blind) == []


UTM = np.array([465_000.0, 5_248_000.0, 412.0])


def survey(simulated) -> tuple[KnownPosition, ...]:
    """Positions in a frame whose numbers are as large as those of map grids."""
    known = positions(simulated, 0.05, np.random.default_rng(8))
    return tuple(replace(p, position_m=p.position_m + UTM) for p in known)


@pytest.fixture(scope="module")
def surveyed(simulated):
    return reconstructed(simulated, Known(positions=survey(simulated)))


def test_surveyed_positions_give_their_frame_and_help(simulated, blind, surveyed):
    found = surveyed
    one = found.reconstruction
    assert (one.gauge, one.frame, one.georeference) == ("metric", "given", None)
    cameras = {
        c: replace(k, camera_from_world=Similarity(1.0, np.eye(3), -UTM).apply_to_pose(k.camera_from_world))
        for c, k in one.cameras.items()
    }
    trajectory = one.trajectory.transformed(Similarity(1.0, np.eye(3), -UTM))
    local = replace(found, reconstruction=replace(one, cameras=cameras, trajectory=trajectory))
    result = errors(simulated, local)
    assert result.absolute_m < 0.4
    assert result.centre_m < 0.15
    assert abs(result.scale) < 0.006
    assert 0.3 < result.trajectory < 2.5
    assert 0.4 < result.centres < 2.0
    assert result.shape_m < 1.1 * errors(simulated, blind).shape_m
    assert all(thing["used"] for thing in section_of(found)["things"].values())


def test_a_wrong_phone_is_named_and_left_out(simulated, blind, rng):
    given = list(positions(simulated, 3.0, rng))
    given[3] = KnownPosition("cam3", given[3].position_m + [90.0, -40.0, 10.0], given[3].sigma_m)
    earth = Georeference(0.8, 0.1, 400.0, Similarity(1.0, np.eye(3), np.zeros(3)), "EGM96")
    found = reconstructed(simulated, Known(positions=tuple(given), earth=earth))
    section = section_of(found)
    assert [name for name, thing in section["things"].items() if not thing["used"]] == ["position of cam3"]
    assert 85 < section["things"]["position of cam3"]["metres_off"] < 115
    assert any("position of cam3 is not used" in text for text in known_warnings(found))
    result = errors(simulated, found)
    assert result.absolute_m < 8
    assert result.trajectory < 2.5
    # Metres of error in the positions only move the flight: its shape is its own.
    assert result.shape_m < 1.2 * errors(simulated, blind).shape_m
    assert found.reconstruction.frame == "enu"
    assert found.reconstruction.georeference is earth
    assert "above EGM96" in found.reconstruction.frame_in_words


def test_a_distance_gives_metres_and_nothing_else(simulated, blind, rng):
    found = reconstructed(simulated, Known(distances=(distance(simulated, "cam0", "cam2", 0.002, rng),)))
    one = found.reconstruction
    assert (one.gauge, one.frame) == ("metric", "camera")
    np.testing.assert_allclose(one.cameras["cam0"].camera_from_world.centre, 0, atol=1e-9)
    np.testing.assert_allclose(one.cameras["cam0"].camera_from_world.rotation, np.eye(3), atol=1e-9)
    assert abs(errors(simulated, found).scale) < 0.015
    assert section_of(found)["left_open"] == "the place and the orientation"
    # The distance is between cameras: it cannot change the flight's shape.
    assert errors(simulated, found).shape_m == pytest.approx(errors(simulated, blind).shape_m, rel=0.05)


def test_verticals_level_the_world(simulated, rng):
    known = Known(ups=verticals(simulated, np.radians(0.5), rng))
    found = reconstructed(simulated, known)
    assert (found.reconstruction.gauge, found.reconstruction.frame) == ("arbitrary", "level")
    assert errors(simulated, found).up[2] > np.cos(np.radians(1.0))
    np.testing.assert_allclose(found.reconstruction.cameras["cam0"].camera_from_world.centre, 0, atol=1e-9)
    ahead = found.reconstruction.cameras["cam0"].camera_from_world.rotation[2]
    assert ahead[0] == pytest.approx(0, abs=1e-9)
    assert ahead[1] > 0
    assert section_of(found)["left_open"] == "the place and the heading and the unit of length"


def test_two_positions_leave_a_turn_open_and_say_so(simulated, rng):
    found = reconstructed(simulated, Known(positions=positions(simulated, 0.05, rng)[:2]))
    assert (found.reconstruction.gauge, found.reconstruction.frame) == ("metric", "given")
    assert abs(errors(simulated, found).scale) < 0.02
    assert errors(simulated, found).up[2] > np.cos(np.radians(15))  # most cameras are upright
    assert any("leave open the turn about the line through them" in text for text in known_warnings(found))


def test_positions_that_tell_no_unit_are_not_used(simulated, blind, rng):
    alone = Known(positions=positions(simulated, 0.05, rng)[:1], readouts=(KnownReadout("cam1", 0.02, 1e-4),))
    placed = place(blind.adjusted, alone, np.zeros((FLIGHT.n_cameras, 3, 3)))
    assert placed.adjusted is blind.adjusted
    assert not placed.known.placed
    assert placed.known.positions == ()
    assert placed.known.readouts == alone.readouts
    assert any("does not tell the unit of length" in text for text in known_warnings(replace(blind, placed=placed)))


def test_positions_that_contradict_each_other_by_far_are_not_used(simulated, blind, rng):
    """Three of five are elsewhere, together."""
    known = [
        replace(p, position_m=p.position_m + 1e4) if p.camera_id in ("cam0", "cam1", "cam2") else p
        for p in positions(simulated, 3.0, rng)
    ]
    placed = place(blind.adjusted, Known(positions=tuple(known)), np.zeros((FLIGHT.n_cameras, 3, 3)))
    assert placed.contradictory
    assert not placed.known.placed
    told = replace(blind, placed=placed)
    assert any("none is used" in text for text in known_warnings(told))
    things = section_of(told)["things"]
    assert len(things) == 5
    assert not any(thing["used"] for thing in things.values())


def test_what_is_known_of_a_camera_that_is_not_there_is_said(simulated, blind, rng):
    known = positions(simulated, 0.05, rng)
    known = (*known[:4], replace(known[4], camera_id="gone"))
    placed = place(blind.adjusted, Known(positions=known), np.zeros((FLIGHT.n_cameras, 3, 3)))
    assert placed.absent == ("position of gone",)
    assert len(placed.given.positions) == 4


def test_a_known_readout_is_kept_to(simulated, blind):
    true = {c: camera.clock.readout_s for c, camera in simulated.truth.cameras.items()}
    known = Known(readouts=tuple(KnownReadout(c, readout_s, 1e-5) for c, readout_s in true.items()))
    found = reconstructed(simulated, known)
    assert found.reconstruction.gauge == "arbitrary"
    for c, camera in found.reconstruction.cameras.items():
        assert camera.clock.readout_s == pytest.approx(true[c], abs=5e-5)
        assert camera.clock_deviation.readout_s <= 1.1e-5
    assert max(abs(c.clock.readout_s - true[k]) for k, c in blind.reconstruction.cameras.items()) > 2e-4


def test_the_order_of_cameras_does_not_matter_in_a_known_frame(simulated, surveyed):
    """Not even for the numbers, which are those of the frame and not of the reference camera; only times differ."""
    turned = replace(simulated, recordings=simulated.recordings[::-1])
    one = surveyed.reconstruction
    other = reconstructed(turned, Known(positions=survey(simulated)[::-1])).reconstruction
    assert other.reference == "cam4"
    ours, theirs = one.cameras["cam2"].clock, other.cameras["cam2"].clock
    time_s = one.trajectory.sample_times(5.0)[1:-1]
    their_time_s = theirs.offset_s + (time_s - ours.offset_s) / ours.period_s * theirs.period_s
    sigma = one.trajectory.sigma(time_s)
    away = np.linalg.norm(other.trajectory.position(their_time_s) - one.trajectory.position(time_s), axis=1)
    assert (away / sigma).max() < 1e-6
    np.testing.assert_allclose(other.trajectory.sigma(their_time_s), sigma, rtol=1e-4)
    for c, camera in one.cameras.items():
        twin = other.cameras[c].camera_from_world
        np.testing.assert_allclose(twin.centre, camera.camera_from_world.centre, atol=1e-6)
