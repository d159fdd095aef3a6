"""The cameras of a simulated flight: where they stand, their true lenses and clocks, the calibration given."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.projection import one_to_one_radius
from skytrace.geometry.rigid import Rigid, so3_exp
from skytrace.model.camera import Clock, Intrinsics
from skytrace.simulation.lens_errors import miscalibrated
from skytrace.simulation.scenario import Scenario

# Video modes that store fewer columns than they show: stored over shown width.
_PIXEL_SQUEEZE = {(1440, 1080): 0.75}

_MAX_STEP_RAD = np.radians(100.0)  # few cameras share one side of the field rather than face each other
_LINE_SPACING_M = 5.0


@dataclass(frozen=True, eq=False, slots=True)
class TrueCamera:
    """What the reconstruction of a camera should find."""

    camera_from_world: Rigid
    clock: Clock  # world time
    intrinsics: Intrinsics
    calibrated: Intrinsics  # what the recording states instead
    frame_rate_hz: float  # nominal


def draw_cameras(scenario: Scenario, clocks: tuple[Clock, ...], rng: np.random.Generator) -> tuple[TrueCamera, ...]:
    """The scenario's cameras, one for each clock."""
    layout_rng, *lens_rngs = rng.spawn(1 + scenario.n_cameras)
    centres = camera_centres(scenario, layout_rng)
    target = np.array([0.0, 0.0, scenario.altitude_m])
    cameras = []
    for i, (centre, clock, lens_rng) in enumerate(zip(centres, clocks, lens_rngs, strict=True)):
        aim = target + lens_rng.normal(0, 0.03 * scenario.extent_m, 3)
        pose = look_at(centre, aim, roll_rad=lens_rng.normal(0, np.radians(2.0)))
        draw = draw_fisheye if i < scenario.fisheye_cameras else draw_lens
        lens = draw(scenario.resolutions_px[i % len(scenario.resolutions_px)], scenario.distortion, lens_rng)
        calibrated = miscalibrated(lens, scenario, lens_rng)
        cameras.append(TrueCamera(pose, clock, lens, calibrated, nominal_rate_hz(scenario, i)))
    return tuple(cameras)


def camera_centres(scenario: Scenario, rng: np.random.Generator) -> FloatArray:
    """Centres (n, 3) of the cameras in metres.

    "ring": around the field, some 1.5 m high, far enough to have most of the flight in view. "coincident": the same,
    but the second stands where the first does. "line": one behind the other on the line of sight to the centre of
    the flight, as on a slope.
    """
    n = scenario.n_cameras
    radius = scenario.camera_distance * (35.0 + 0.65 * scenario.extent_m)
    step = min(2 * np.pi / n, _MAX_STEP_RAD)
    azimuth = rng.uniform(0, 2 * np.pi) + step * (np.arange(n) + rng.uniform(-0.2, 0.2, n))
    distance = radius * rng.uniform(0.9, 1.15, n)
    height = rng.uniform(1.0, 2.0, n)
    centres = np.column_stack([distance * np.cos(azimuth), distance * np.sin(azimuth), height])
    if scenario.camera_layout == "coincident":
        centres[1] = centres[0]
    if scenario.camera_layout == "line":
        towards = np.array([0.0, 0.0, scenario.altitude_m]) - centres[0]
        towards /= np.linalg.norm(towards)
        spacing = min(_LINE_SPACING_M, 0.4 * radius / n)
        centres = centres[0] + spacing * np.arange(n)[:, None] * towards
    return centres


def look_at(centre: FloatArray, target: FloatArray, roll_rad: float = 0.0) -> Rigid:
    """camera_from_world of a camera at a centre (3,) that looks at a target (3,), world z upwards."""
    forward = np.asarray(target, float) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    upright = np.stack([right, np.cross(forward, right), forward])
    return Rigid.from_centre(so3_exp(np.array([0.0, 0.0, roll_rad])) @ upright, centre)


def draw_lens(size_px: tuple[int, int], strength: float, rng: np.random.Generator) -> Intrinsics:
    """A consumer camera's lens: 55 to 67 degrees wide, barrel or pincushion, invertible over its whole image."""
    width, height = size_px
    focal_x = width * rng.uniform(0.75, 0.95)
    focal_y = focal_x / _PIXEL_SQUEEZE.get((width, height), 1.0)
    principal = np.array([0.5 * (width - 1), 0.5 * (height - 1)]) + 0.008 * rng.normal(size=2) * np.array(size_px)
    k1 = rng.uniform(-0.2, 0.2)
    k2 = -k1 * rng.uniform(0.5, 2.0)
    k3 = -k2 * rng.uniform(0.2, 0.8)
    p1, p2 = 1e-3 * rng.normal(size=2)
    distortion = strength * np.array([k1, k2, p1, p2, k3])
    corner = float(np.hypot(0.55 * width / focal_x, 0.55 * height / focal_y))
    while one_to_one_radius(distortion) < 1.3 * corner:
        distortion = 0.7 * distortion
    return Intrinsics(np.array([focal_x, focal_y]), principal, distortion, size_px)


def draw_fisheye(size_px: tuple[int, int], strength: float, rng: np.random.Generator) -> Intrinsics:
    """An action camera's lens: 95 to 115 degrees wide, invertible over its whole image."""
    width, height = size_px
    focal_x = width * rng.uniform(0.5, 0.6)
    focal_y = focal_x / _PIXEL_SQUEEZE.get((width, height), 1.0)
    principal = np.array([0.5 * (width - 1), 0.5 * (height - 1)]) + 0.008 * rng.normal(size=2) * np.array(size_px)
    # Their sum keeps the radius growing up to the image's corner and some way beyond.
    k1, k2, k3, k4 = rng.uniform([-0.05, 0.0, -0.02, 0.0], [0.03, 0.06, 0.0, 0.005])
    coefficients = strength * np.array([k1, k2, k3, k4])
    return Intrinsics(np.array([focal_x, focal_y]), principal, coefficients, size_px, "fisheye")


def nominal_rate_hz(scenario: Scenario, index: int) -> float:
    return scenario.frame_rates_hz[index % len(scenario.frame_rates_hz)]


def draw_clocks(scenario: Scenario, rng: np.random.Generator) -> tuple[tuple[Clock, ...], float]:
    """The cameras' clocks, and the world time at which the flight begins.

    Every camera starts some time before the flight and counts frames from there. With a reference clock, world time
    is that of the first camera: offset 0, the nominal period. Otherwise world time is 0 when the flight begins.
    """
    n = scenario.n_cameras
    lead_s = rng.uniform(0, 1, n) * scenario.offset_range_s
    drift = rng.normal(0, 1, n) * scenario.clock_drift
    readout = scenario.readout_fraction + rng.normal(0, 1, n) * scenario.readout_spread
    begin_s = 0.0
    if scenario.reference_clock:
        begin_s = float(lead_s[0])
        drift[0] = 0.0
    clocks = []
    for i in range(n):
        nominal_s = 1 / nominal_rate_hz(scenario, i)
        height = scenario.resolutions_px[i % len(scenario.resolutions_px)][1]
        readout_s = float(np.clip(readout[i], 0, 1)) * nominal_s
        clocks.append(Clock(begin_s - float(lead_s[i]), nominal_s * (1 + float(drift[i])), readout_s, height))
    return tuple(clocks), begin_s
