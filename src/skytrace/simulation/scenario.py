"""What to simulate: one frozen description of flight, cameras and detector, and a dozen that have names."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, get_args

MotionKind = Literal["smooth", "spline", "hover", "hover_legs", "straight", "legs", "turns", "climbs"]
CameraLayout = Literal["ring", "line", "coincident"]

MAX_CAMERAS = 12

# Closed ranges of the scalars; what lies outside has no meaning or no flight a camera could follow.
_RANGES: dict[str, tuple[float, float]] = {
    "duration_s": (1.0, 4 * 3600.0),
    "speed_m_s": (0.01, 100.0),
    "extent_m": (1.0, 5000.0),
    "altitude_m": (2.0, 2000.0),
    "knot_spacing_s": (0.01, 10.0),
    "sway_m": (0.0, 5.0),
    "n_cameras": (2, MAX_CAMERAS),
    "fisheye_cameras": (0, MAX_CAMERAS),
    "camera_distance": (0.3, 10.0),
    "distortion": (0.0, 2.0),
    "focal_error": (0.0, 0.1),
    "aspect_error": (0.0, 0.05),
    "principal_error": (0.0, 0.1),
    "radial_error": (0.0, 0.02),
    "offset_range_s": (0.0, 3600.0),
    "clock_drift": (0.0, 0.01),
    "readout_fraction": (0.0, 1.0),
    "readout_spread": (0.0, 0.5),
    "variable_frame_rate": (0.0, 0.5),
    "rate_swing": (0.0, 0.9),
    "dropped_frames": (0.0, 0.9),
    "watched_fraction": (0.05, 1.0),
    "noise_px": (0.0, 100.0),
    "drift_px": (0.0, 100.0),
    "drift_s": (0.1, 100.0),
    "dropout_fraction": (0.0, 0.9),
    "outlier_fraction": (0.0, 0.9),
    "clustered_fraction": (0.0, 0.9),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """One simulated flight. The defaults are a clean recording by ordinary cameras: noise, but no false detections.

    Raises ValueError naming the field, its value and the range expected.
    """

    # The flight, in a box centred above the world's origin, z upwards.
    motion: MotionKind = "smooth"
    duration_s: float = 90.0
    speed_m_s: float = 6.0  # root mean square of smooth flights, nominal speed of the legs otherwise
    extent_m: float = 60.0  # side of the box on the ground
    altitude_m: float = 25.0  # of the centre of the box, which reaches half_height_m up and down
    knot_spacing_s: float = 0.2  # motion "spline": knots at its integer multiples, in world time
    sway_m: float = 0.05  # motion "hover": how far the target strays from its place along each axis

    # The cameras. Camera i takes entry i of the tuples, which repeat.
    n_cameras: int = 4
    camera_layout: CameraLayout = "ring"
    camera_distance: float = 1.0  # in distances that keep most of the box in view; less: the target leaves the view
    frame_rates_hz: tuple[float, ...] = (29.97, 25.0, 30.0, 59.94, 50.0)
    resolutions_px: tuple[tuple[int, int], ...] = ((1920, 1080), (3840, 2160), (1440, 1080), (1280, 720))
    distortion: float = 1.0  # strength: 0 none, 1 what consumer lenses show
    fisheye_cameras: int = 0  # the first so many have a fisheye, as action cameras do
    # What the calibrations get wrong, as deviations.
    focal_error: float = 0.005  # of the focal length, relative
    aspect_error: float = 0.0  # of the pixels' height over their width, relative
    principal_error: float = 0.0  # of the principal point along each axis, in focal lengths
    radial_error: float = 0.0  # of the radial displacement towards the image's corner, in focal lengths

    # The clocks.
    reference_clock: bool = True  # world time is the first camera's clock; otherwise it starts with the flight
    offset_range_s: float = 120.0  # the cameras start up to this long before the flight
    clock_drift: float = 1e-4  # relative deviation of the true frame periods from the nominal ones
    readout_fraction: float = 0.6  # rolling-shutter readout, as a fraction of the frame period
    readout_spread: float = 0.0  # deviation of that fraction between cameras
    variable_frame_rate: float = 0.0  # deviation of exposure times from frame * period, in frame periods
    rate_swing: float = 0.0  # how far the frame rate sinks below the nominal one, and rises again, as a share of it
    dropped_frames: float = 0.0  # share of frames that were never stored; the others are numbered without a gap
    timestamps: bool = False  # the tracks carry the true time stamps of their frames

    # The detector.
    watched_fraction: float = 1.0  # part of the flight a camera watches: the first one its start, the last its end
    noise_px: float = 0.5  # standard deviation along each axis
    drift_px: float = 0.0  # deviation along each axis of a bias that wanders; cameras have 0.5 to 1.5 times as much
    drift_s: float = 3.0  # how long that bias lasts: its correlation falls to 1 / e
    quantise: bool = False  # detections fall on whole pixels
    dropout_fraction: float = 0.0  # frames in absences of a second or so, beside those out of the field of view
    outlier_fraction: float = 0.0  # share of detections that lie anywhere in the image
    clustered_fraction: float = 0.0  # share of detections on blobs stuck for a second and on passing birds

    def __post_init__(self) -> None:
        _require_choice("motion", self.motion, get_args(MotionKind))
        _require_choice("camera_layout", self.camera_layout, get_args(CameraLayout))
        for name, (low, high) in _RANGES.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(f"{name}: expected a value from {low:g} to {high:g}, got {value}")
        if self.n_cameras != int(self.n_cameras):
            raise ValueError(f"n_cameras: expected a whole number, got {self.n_cameras}")
        if not self.frame_rates_hz or not all(1 <= rate <= 1000 for rate in self.frame_rates_hz):
            raise ValueError(f"frame_rates_hz: expected rates from 1 to 1000, got {self.frame_rates_hz}")
        if not self.resolutions_px or not all(min(size) >= 16 for size in self.resolutions_px):
            raise ValueError(f"resolutions_px: expected (width, height) of at least 16, got {self.resolutions_px}")
        if self.outlier_fraction + self.clustered_fraction > 0.9:
            total = self.outlier_fraction + self.clustered_fraction
            raise ValueError(f"outlier_fraction + clustered_fraction: expected at most 0.9, got {total:g}")

    @property
    def half_height_m(self) -> float:
        """Half the vertical extent of the box the target flies in; it stays clear of the ground."""
        return min(0.6 * self.altitude_m, 0.5 * self.extent_m)

    @property
    def camera_ids(self) -> tuple[str, ...]:
        return tuple(f"cam{i}" for i in range(self.n_cameras))


def _require_choice(name: str, value: str, choices: Iterable[str]) -> None:
    if value not in choices:
        raise ValueError(f"{name}: expected one of {', '.join(choices)}, got {value!r}")


def _noise_free(motion: MotionKind) -> Scenario:
    return Scenario(motion=motion, duration_s=60.0, noise_px=0.0, focal_error=0.0, readout_spread=0.05)


presets: dict[str, Scenario] = {
    "demo": Scenario(readout_spread=0.05, dropout_fraction=0.03, outlier_fraction=0.03),
    "noise_free_spline": _noise_free("spline"),
    "noise_free_smooth": _noise_free("smooth"),
    "hover": Scenario(motion="hover", duration_s=60.0),
    "hover_legs": Scenario(motion="hover_legs", duration_s=120.0, outlier_fraction=0.03),
    "straight": Scenario(motion="straight", duration_s=30.0, speed_m_s=4.0, extent_m=120.0),
    "legs": Scenario(motion="legs", duration_s=120.0, outlier_fraction=0.03),
    "turns": Scenario(motion="turns", duration_s=120.0, speed_m_s=9.0, outlier_fraction=0.03),
    "climbs": Scenario(motion="climbs", duration_s=120.0, speed_m_s=8.0, altitude_m=35.0, outlier_fraction=0.03),
    "line": Scenario(camera_layout="line"),
    "coincident": Scenario(camera_layout="coincident", n_cameras=2),
    "coincident_pair": Scenario(camera_layout="coincident", n_cameras=4),
    "short_overlap": Scenario(n_cameras=2, watched_fraction=0.53),
    "cluttered": Scenario(
        duration_s=180.0,
        n_cameras=5,
        camera_distance=0.7,
        quantise=True,
        dropout_fraction=0.1,
        outlier_fraction=0.1,
        clustered_fraction=0.05,
    ),
    "phones": Scenario(
        duration_s=180.0,
        n_cameras=5,
        frame_rates_hz=(30.0, 29.7, 60.0),
        quantise=True,
        variable_frame_rate=0.15,
        timestamps=True,
        outlier_fraction=0.05,
    ),
    # Two wide action cameras beside two ordinary ones, calibrations off by as much as is common.
    "action": Scenario(
        fisheye_cameras=2,
        focal_error=0.01,
        radial_error=0.002,
        readout_spread=0.05,
        dropout_fraction=0.03,
        outlier_fraction=0.03,
    ),
    "uneven": Scenario(
        duration_s=120.0,
        frame_rates_hz=(30.0, 59.94, 25.0),
        rate_swing=0.5,
        dropped_frames=0.05,
        variable_frame_rate=0.1,
        timestamps=True,
        outlier_fraction=0.03,
    ),
    # Calibrations, clocks and detections as wrong as those of real consumer cameras.
    "realistic": Scenario(
        duration_s=150.0,
        n_cameras=5,
        focal_error=0.015,
        aspect_error=0.0035,
        principal_error=0.007,
        radial_error=0.002,
        clock_drift=3e-4,
        readout_spread=0.1,
        noise_px=0.4,
        quantise=True,
        drift_px=1.0,
        dropout_fraction=0.05,
        outlier_fraction=0.05,
        clustered_fraction=0.02,
    ),
    "large": Scenario(
        duration_s=600.0,
        n_cameras=12,
        camera_distance=0.8,
        extent_m=100.0,
        altitude_m=40.0,
        speed_m_s=8.0,
        readout_spread=0.05,
        dropout_fraction=0.05,
        outlier_fraction=0.05,
        clustered_fraction=0.02,
    ),
}
