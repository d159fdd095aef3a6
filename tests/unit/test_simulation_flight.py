"""Scenarios are checked, and motions are what they claim: exact derivatives, knots on the grid, inside their box."""

from __future__ import annotations

import dataclasses
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skytrace.simulation.flight import HarmonicMotion, SplineMotion, build_motion, spline_motion
from skytrace.simulation.legs import LegsMotion
from skytrace.simulation.scenario import MotionKind, Scenario, presets

MOTIONS = get_args(MotionKind)


def times(motion, n=4001, margin_s=0.0):
    return np.linspace(motion.begin_s + margin_s, motion.end_s - margin_s, n)


@pytest.mark.parametrize("kind", MOTIONS)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_velocity_is_the_derivative_of_position(kind, seed):
    motion = build_motion(Scenario(motion=kind, duration_s=60), 17.3, np.random.default_rng(seed))
    t, h = times(motion), 1e-4
    numeric = (motion.position(t + h) - motion.position(t - h)) / (2 * h)
    np.testing.assert_allclose(motion.velocity(t), numeric, atol=2e-5)
    assert (motion.begin_s, motion.end_s) == (17.3, 77.3)


@settings(max_examples=40, deadline=None)
@given(
    kind=st.sampled_from(MOTIONS),
    seed=st.integers(0, 2**32),
    extent=st.floats(20, 300),
    altitude=st.floats(10, 150),
    speed=st.floats(1, 30),
)
def test_flights_fill_their_box_and_never_reach_the_ground(kind, seed, extent, altitude, speed):
    scenario = Scenario(motion=kind, duration_s=120, extent_m=extent, altitude_m=altitude, speed_m_s=speed)
    motion = build_motion(scenario, 0.0, np.random.default_rng(seed))
    position = motion.position(times(motion))
    # Sums of sinusoids may stray out of the box, the legs may not.
    reach = 1.5 if kind in ("smooth", "spline") else 1.0
    half = np.array([extent / 2, extent / 2, scenario.half_height_m]) + scenario.sway_m
    assert (np.abs(position - [0, 0, altitude]) <= reach * half + 1e-9).all()
    assert position[:, 2].min() > 0


def test_smooth_flight_has_the_speed_asked_for():
    speed = 7.0
    rms = []
    for seed in range(20):
        motion = build_motion(Scenario(speed_m_s=speed, duration_s=600), 0.0, np.random.default_rng(seed))
        rms.append(np.sqrt((motion.velocity(times(motion)) ** 2).sum(1).mean()))
    np.testing.assert_allclose(rms, speed, rtol=0.15)
    assert abs(np.mean(rms) - speed) < 0.05 * speed


@settings(max_examples=30, deadline=None)
@given(begin=st.floats(0, 500), spacing=st.sampled_from([0.1, 0.2, 0.25, 0.7]), seed=st.integers(0, 2**32))
def test_spline_knots_lie_on_multiples_of_the_spacing_and_span_the_flight(begin, spacing, seed):
    scenario = Scenario(motion="spline", knot_spacing_s=spacing, duration_s=10)
    motion = build_motion(scenario, begin, np.random.default_rng(seed))
    assert isinstance(motion, SplineMotion)
    segment = motion.segment
    first = round(segment.knot_start_s / spacing)
    assert segment.knot_start_s == first * spacing
    assert segment.knot_start_s <= motion.begin_s
    assert segment.knot_start_s + segment.n_intervals * spacing >= motion.end_s
    # Between knots the third derivative is constant, and at the knots it jumps: this is no smooth curve in disguise.
    knots = spacing * (first + np.arange(2, 20))
    inside = segment.evaluate(knots + 0.1 * spacing, 3), segment.evaluate(knots + 0.9 * spacing, 3)
    scale = np.abs(inside[0]).max()
    np.testing.assert_allclose(inside[0], inside[1], atol=1e-6 * scale)
    assert np.abs(np.diff(inside[0], axis=0)).max() > 1e-3 * scale


def test_spline_stays_close_to_its_smooth_guide():
    guide = build_motion(Scenario(motion="smooth"), 3.0, np.random.default_rng(4))
    spline = spline_motion(guide, 0.2)
    gap = np.linalg.norm(spline.position(times(guide)) - guide.position(times(guide)), axis=1)
    assert 1e-6 < gap.max() < 0.2


@pytest.mark.parametrize("kind", ["legs", "turns", "hover_legs", "climbs"])
def test_legs_are_straight_between_turns_and_continuous_through_them(kind):
    motion = build_motion(Scenario(motion=kind, duration_s=100), 0.0, np.random.default_rng(5))
    assert isinstance(motion, LegsMotion)
    corner, blend = motion.corner_s, motion.blend_s
    leg_s = np.diff(corner)
    assert ((blend[:-1] + blend[1:]) / 2 <= leg_s + 1e-12).all()
    for edge in np.concatenate([corner, corner - blend / 2, corner + blend / 2]):
        sides = motion.velocity(np.array([edge - 1e-9, edge + 1e-9]))
        assert np.abs(sides[1] - sides[0]).max() < 1e-6
    quiet = np.flatnonzero(leg_s - (blend[:-1] + blend[1:]) / 2 > 0.1)
    assert len(quiet) > 3
    for leg in quiet:
        t = np.linspace(corner[leg] + blend[leg] / 2, corner[leg + 1] - blend[leg + 1] / 2, 9)
        velocity = motion.velocity(t)
        np.testing.assert_allclose(velocity, np.broadcast_to(velocity[0], velocity.shape), atol=1e-9)


def test_kinds_of_flight_differ_as_their_names_say():
    speed = {}
    vertical = {}
    for kind in MOTIONS:
        motion = build_motion(Scenario(motion=kind, duration_s=120, altitude_m=35), 0.0, np.random.default_rng(6))
        velocity = motion.velocity(times(motion))
        speed[kind] = np.linalg.norm(velocity, axis=1)
        vertical[kind] = np.abs(velocity[:, 2]).mean()
    assert speed["hover"].max() < 0.3
    assert np.mean(speed["hover_legs"] < 1e-9) > 0.1
    np.testing.assert_allclose(speed["straight"], speed["straight"][0])
    assert vertical["climbs"] > 1.5 * vertical["legs"]


def test_hover_without_sway_stands_still():
    motion = build_motion(Scenario(motion="hover", sway_m=0.0), 0.0, np.random.default_rng(7))
    position = motion.position(times(motion))
    np.testing.assert_array_equal(position, np.broadcast_to(position[0], position.shape))


def test_motions_are_frozen():
    motion = build_motion(Scenario(), 0.0, np.random.default_rng(8))
    assert isinstance(motion, HarmonicMotion)
    with pytest.raises(dataclasses.FrozenInstanceError):
        motion.begin_s = 1.0  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        motion.amplitude_m[0, 0] = 1.0


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("motion", "zigzag"),
        ("camera_layout", "heap"),
        ("n_cameras", 1),
        ("n_cameras", 13),
        ("n_cameras", 2.5),
        ("duration_s", 0.0),
        ("duration_s", float("nan")),
        ("readout_fraction", 1.5),
        ("noise_px", -0.1),
        ("outlier_fraction", 0.95),
        ("frame_rates_hz", ()),
        ("frame_rates_hz", (30.0, 0.0)),
        ("resolutions_px", ((1920, 0),)),
    ],
)
def test_scenario_refuses_nonsense_and_names_the_field(field, value):
    with pytest.raises(ValueError, match=field):
        Scenario(**{field: value})


def test_scenario_refuses_false_detections_that_leave_nothing():
    with pytest.raises(ValueError, match="clustered_fraction"):
        Scenario(outlier_fraction=0.6, clustered_fraction=0.6)


def test_presets_name_a_dozen_distinct_scenarios():
    assert len(presets) >= 12
    assert len(set(presets.values())) == len(presets)
    demo = presets["demo"]
    assert (demo.n_cameras, demo.duration_s, demo.noise_px, demo.outlier_fraction) == (4, 90.0, 0.5, 0.03)
    assert (demo.focal_error, demo.clock_drift) == (0.005, 1e-4)
    for name in ("noise_free_spline", "noise_free_smooth"):
        assert presets[name].noise_px == presets[name].focal_error == presets[name].outlier_fraction == 0
    assert presets["large"].n_cameras == 12
