"""What a reader of docs/tutorial.md has on a Sunday evening: videos of flights, one of a board, a drone's log.

The flight is simulated. Its videos last two seconds, and what would be found in longer ones lies where `skytrace
reconstruct` keeps what it found before, so that no test has to look at minutes of video.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.wgs84 import geodetic_from_enu
from skytrace.io.calibration_writer import calibration_text
from skytrace.io.tracks import TrackRows, tracks_text
from skytrace.io.video_writer import TICKS_PER_S, VideoWriter
from skytrace.model.camera import Intrinsics
from skytrace.model.track import Recording
from skytrace.pipeline.videos import FLIGHT_TRACKS, job_key
from skytrace.simulation import Scenario, simulate

sys.path.insert(0, str(Path(__file__).parents[1] / "unit"))
from board_scene import Board, render, shots

NAMES = ("anna", "ben", "carla")
SIZE_PX = (640, 360)
# The origin of the simulation on the earth, as latitude and longitude in degrees and height in metres.
ORIGIN = (47.1, 8.5, 412.0)
# saturday/flight.toml as it is before anything is known beside the videos.
FLIGHT = 'name = "Saturday"\n' + "".join(
    f'\n[[camera]]\nid = "{name}"\ncalibration = "{name}.json"\nvideo = "{name}.mp4"\n' for name in NAMES
)
_SCENARIO = Scenario(
    n_cameras=3, duration_s=60.0, resolutions_px=(SIZE_PX,), noise_px=0.15, focal_error=0.0, offset_range_s=20.0
)


def film(folder: Path) -> None:
    """Write everything into a folder."""
    simulated = simulate(_SCENARIO, np.random.default_rng(4))
    saturday, boards = folder / "saturday", folder / "boards"
    (saturday / FLIGHT_TRACKS).mkdir(parents=True)
    boards.mkdir()
    for name, recording in zip(NAMES, simulated.recordings, strict=True):
        _film_flight(saturday, name, recording)
        (saturday / f"{name}.json").write_text(calibration_text(recording.intrinsics, recording.frame_rate_hz))
    (saturday / "flight.toml").write_text(FLIGHT)
    # On Sunday they film the same again, through the same lenses.
    shutil.copytree(saturday, folder / "sunday")
    again = FLIGHT.replace("Saturday", "Sunday").replace('calibration = "', 'calibration = "../saturday/')
    (folder / "sunday" / "flight.toml").write_text(again)
    _film_board(boards / "anna.mp4", simulated.truth.cameras["cam0"].intrinsics)
    motion = simulated.truth.motion
    time_s = np.arange(motion.begin_s, motion.end_s, 0.2)
    enu_m = motion.position(time_s)
    geodetic = geodetic_from_enu(enu_m, np.array([*np.radians(ORIGIN[:2]), ORIGIN[2]]))
    clock_s = time_s - time_s[0] + 1000.0  # of its own
    _table(folder / "rtk.csv", "time_s,x,y,z", clock_s, enu_m)
    on_earth = np.column_stack([np.degrees(geodetic[:, :2]), geodetic[:, 2]])
    _table(folder / "drone-log.csv", "time_s,latitude_deg,longitude_deg,height_m", clock_s, on_earth)


def _film_flight(folder: Path, name: str, recording: Recording) -> None:
    (track,) = recording.tracks
    video = folder / f"{name}.mp4"
    with VideoWriter(video, SIZE_PX, recording.frame_rate_hz) as writer:
        for k in range(round(2 * recording.frame_rate_hz)):
            x, y = 60 + 8 * k, 120 + round(40 * np.sin(0.2 * k))
            _write(writer, round(k * TICKS_PER_S / recording.frame_rate_hz), _dot(x, y))
    n, key = len(track.frame), job_key(video)
    rows = TrackRows(
        track.frame,
        track.frame / recording.frame_rate_hz,
        track.xy_px,
        np.full(n, 0.2),
        np.zeros(n, np.int64),
        np.ones(n, np.int64),
    )
    about = {"key": key, "tracks": [{"id": 0, "target": True}], "warnings": []}
    (folder / FLIGHT_TRACKS / f"{key}.csv").write_text(tracks_text(rows, about))


def _film_board(path: Path, lens: Intrinsics) -> None:
    rng, rate_hz = np.random.default_rng(5), 29.97
    with VideoWriter(path, SIZE_PX, rate_hz, quality=10) as writer:
        for k in range(60):
            if k % 6 == 0:  # the sharpest picture of every 0.2 s is looked at
                (shot,) = shots(lens, 1, rng, rolls_deg=(90.0 * (k // 6 % 2),))
                picture = render(lens, Board(), shot, rng, over=2)
            _write(writer, round(k * TICKS_PER_S / rate_hz), picture)


def _dot(x: int, y: int) -> np.ndarray:
    luma = np.full(SIZE_PX[::-1], 180, np.uint8)
    luma[y - 3 : y + 4, x - 4 : x + 5] = 40
    return luma


def _write(writer: VideoWriter, ticks: int, luma: np.ndarray) -> None:
    grey = np.full((SIZE_PX[1] // 2, SIZE_PX[0] // 2), 128, np.uint8)
    writer.write(ticks, luma, grey, grey)


def _table(path: Path, header: str, time_s: FloatArray, columns: FloatArray) -> None:
    np.savetxt(path, np.column_stack([time_s, columns]), fmt="%.9f", delimiter=",", header=header, comments="")
