"""A RUN made ready for another program: sampled, put into the frame and onto the clock asked for, and written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Literal

import numpy as np

from skytrace.errors import InputError
from skytrace.evaluation.path import SampledPath
from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.projection import COEFFICIENTS
from skytrace.geometry.rigid import Rigid, Similarity
from skytrace.io.export import FORMATS, Content, ExportCamera, ExportRun, Format
from skytrace.io.run_folder import CAMERAS, SAMPLE_RATE_HZ, RunFolder
from skytrace.io.text import did_you_mean
from skytrace.model.camera import Clock, Intrinsics
from skytrace.model.georeference import Georeference

MAX_SAMPLES = 20_000_000
# What helps a run that lacks something.
_PLACE = "give position_wgs84 of the cameras in flight.toml, or run skytrace georeference (docs/export.md)"
_METRES = "give positions or distances of the cameras in flight.toml, or run skytrace georeference (docs/export.md)"
_UNCHANGED = Similarity(1.0, np.eye(3), np.zeros(3))


@dataclass(frozen=True, slots=True)
class ExportOptions:
    """What a user may choose of an export."""

    rate_hz: float | None = None  # samples a second; none: the format's own, or as the run is stored
    frame: Literal["world", "enu"] | None = None  # of positions; none: east, north, up where georeferenced
    time_zero: datetime | Literal["start"] | None = None  # an instant: when the reference camera's clock read 0
    with_gaps: bool = False  # rows between covered stretches too, without values
    deviations: bool = True

    def __post_init__(self) -> None:
        if self.rate_hz is not None and not (np.isfinite(self.rate_hz) and self.rate_hz > 0):
            raise ValueError(f"rate_hz: expected a positive number, got {self.rate_hz}")
        if isinstance(self.time_zero, datetime) and self.time_zero.tzinfo is None:
            raise ValueError("time_zero: expected an instant with its time zone")


def export_run(
    run: RunFolder, format_name: str, options: ExportOptions | None = None, georeference: Georeference | None = None
) -> Content:
    """The run in a format of `skytrace.io.export.FORMATS`: text, bytes, or a folder's texts by file name.

    Raises InputError where there is no such format, or the run lacks what it needs: metres, a place on the earth.
    """
    options = options or ExportOptions()
    chosen = find_format(format_name)
    _check_needs(run, chosen, options, georeference)
    return chosen.write(prepare_export(run, chosen, options, georeference))


def find_format(name: str) -> Format:
    """The format of a name. Raises InputError where there is none."""
    if name not in FORMATS:
        raise InputError(name, f"no such format{did_you_mean(name, FORMATS)}: expected one of {', '.join(FORMATS)}")
    return FORMATS[name]


def _check_needs(run: RunFolder, chosen: Format, options: ExportOptions, georeference: Georeference | None) -> None:
    if georeference is None:
        if chosen.needs == "georeference":
            raise InputError(run.path, f"{chosen.name} needs a place on the earth, and the run has none: {_PLACE}")
        if options.frame == "enu":
            raise InputError(run.path, f"east, north, up need a place on the earth, and the run has none: {_PLACE}")
    if chosen.needs == "metres" and _unit(run, options, georeference) != "m":
        raise InputError(
            run.path,
            f"{chosen.name} needs metres, and the run's unit of length is arbitrary: {_METRES}",
        )
    if options.with_gaps and chosen.gaps == "never":
        able = ", ".join(f.name for f in FORMATS.values() if f.gaps != "never")
        raise InputError("--with-gaps", f"{chosen.name} has no rows without a position; possible with {able}")


def prepare_export(
    run: RunFolder, chosen: Format, options: ExportOptions, georeference: Georeference | None = None
) -> ExportRun:
    """The run sampled, in its frame and on its clock, as a format's writer expects it."""
    rate_hz = chosen.rate_hz if options.rate_hz is None else options.rate_hz
    gaps = options.with_gaps or chosen.gaps == "always"
    sampled = _sampled(run, rate_hz, gaps)
    enu = _in_enu(options, georeference)
    to_frame = georeference.enu_from_world if georeference is not None and enu else _UNCHANGED
    zero_s = float(run.time_s[0]) if options.time_zero == "start" else 0.0
    instant = options.time_zero if isinstance(options.time_zero, datetime) else None
    return ExportRun(
        name=run.path.resolve().name,
        reference=run.reference,
        unit=_unit(run, options, georeference),
        frame=_frame_in_words(run, georeference if enu else None),
        time_s=sampled.time_s - zero_s,
        position=to_frame.apply(sampled.position),
        velocity=to_frame.scale * sampled.velocity @ to_frame.rotation.T,
        sigma=to_frame.scale * sampled.sigma if options.deviations else None,
        n_cameras=sampled.n_cameras,
        segment=sampled.segment,
        geodetic=None if georeference is None else georeference.geodetic(sampled.position),
        vertical_datum=None if georeference is None else georeference.vertical_datum,
        time_zero=None if instant is None else instant.astimezone(UTC),
        cameras=_cameras(run, to_frame, georeference, zero_s),
        clock=_clock_in_words(run, zero_s, instant),
    )


def _in_enu(options: ExportOptions, georeference: Georeference | None) -> bool:
    return georeference is not None and options.frame != "world"


def _unit(run: RunFolder, options: ExportOptions, georeference: Georeference | None) -> Literal["m", "arbitrary"]:
    return "m" if run.gauge != "arbitrary" or _in_enu(options, georeference) else "arbitrary"


def _frame_in_words(run: RunFolder, georeference: Georeference | None) -> str:
    if georeference is None:
        return "right-handed world of the run"
    return georeference.in_words


def _clock_in_words(run: RunFolder, zero_s: float, instant: datetime | None) -> str:
    words = f"seconds on the clock of camera {run.reference}"
    if zero_s:
        words = (
            f"seconds since the track's first sample, which is {zero_s:.6f} s on the clock of camera {run.reference}"
        )
    return words if instant is None else f"{words}, 0 is {instant.astimezone(UTC).isoformat()}"


@dataclass(frozen=True, eq=False, slots=True)
class _Sampled:
    time_s: FloatArray
    position: FloatArray
    velocity: FloatArray
    sigma: FloatArray
    n_cameras: Any
    segment: Any


def _sampled(run: RunFolder, rate_hz: float | None, gaps: bool) -> _Sampled:
    """The run at multiples of 1 / rate_hz, or as it is stored. With gaps: the whole grid, NaN where nothing is."""
    if not len(run.time_s):
        raise InputError(run.path, "the trajectory is empty")
    if rate_hz is None and not gaps:
        return _Sampled(run.time_s, run.position, run.velocity, run.sigma, run.n_cameras, run.segment)
    path = SampledPath(run.time_s, run.position, run.velocity, run.segment, run.n_cameras, run.sigma)
    time_s = _sample_times(run, rate_hz or SAMPLE_RATE_HZ, gaps)
    index, inside = path.locate(time_s)
    position, velocity = path.evaluate(time_s)
    sigma, n_cameras = path.sigma_at(time_s), path.n_cameras_at(time_s)
    assert sigma is not None  # both were given
    assert n_cameras is not None
    return _Sampled(
        time_s,
        position,
        velocity,
        np.where(inside, sigma, np.nan),
        np.where(inside, n_cameras, 0),
        np.where(inside, run.segment[index], -1),
    )


def _sample_times(run: RunFolder, rate_hz: float, gaps: bool) -> FloatArray:
    """Multiples of 1 / rate_hz: all from the first sample to the last, or those inside segments.

    Without gaps a segment too short for two multiples is kept by its ends.
    """
    bounds = [(run.time_s[0], run.time_s[-1])]
    if not gaps:
        begins = np.flatnonzero(np.diff(run.segment, prepend=run.segment[0] - 1))
        ends = np.append(begins[1:], len(run.segment)) - 1
        bounds = list(zip(run.time_s[begins], run.time_s[ends], strict=True))
    if sum(last - first for first, last in bounds) * rate_hz > MAX_SAMPLES:
        raise InputError("--rate", f"{rate_hz:g} Hz would give more than {MAX_SAMPLES} samples")
    times = []
    for first_s, last_s in bounds:
        # Times in the file are rounded: a millionth of a step is no reason to miss a multiple.
        multiples = np.arange(np.ceil(first_s * rate_hz - 1e-6), np.floor(last_s * rate_hz + 1e-6) + 1) / rate_hz
        inside = np.clip(multiples, first_s, last_s)
        times.append(inside if len(inside) > 1 or gaps else np.unique([first_s, last_s]))
    return np.concatenate(times)


def _cameras(
    run: RunFolder, to_frame: Similarity, georeference: Georeference | None, zero_s: float
) -> dict[str, ExportCamera]:
    cameras = {}
    for camera_id, row in run.cameras.items():
        if not row.get("registered"):
            continue
        try:
            camera_from_world = Rigid.from_centre(np.array(row["rotation_camera_from_world"]), np.array(row["centre"]))
            lens, clock = _lens(row), _clock(row, zero_s)
        except (KeyError, TypeError, ValueError) as error:
            message = f"camera {camera_id!r}: expected what skytrace reconstruct writes, got a bad {error}"
            raise InputError(run.path / CAMERAS, message) from None
        place = None if georeference is None else georeference.geodetic(camera_from_world.centre)
        cameras[camera_id] = ExportCamera(camera_id, to_frame.apply_to_pose(camera_from_world), clock, lens, place)
    return cameras


def _lens(row: Mapping[str, Any]) -> Intrinsics:
    # The two models differ in their number of coefficients.
    fisheye = len(row["distortion"]) == len(COEFFICIENTS["fisheye"])
    return Intrinsics(
        np.array(row["focal_px_refined"]),
        np.array(row["principal_px"]),
        np.array(row["distortion"]),
        tuple(row["size_px"]),
        "fisheye" if fisheye else "pinhole",
    )


def _clock(row: Mapping[str, Any], zero_s: float) -> Clock:
    clock = row["clock"]
    return Clock(clock["offset_s"] - zero_s, clock["period_s"], clock["readout_s"], row["size_px"][1])
