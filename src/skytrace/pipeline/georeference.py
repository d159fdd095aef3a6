"""Where on the earth a finished RUN lies: from places of its cameras or its target, or from the target's GNSS log."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from skytrace.errors import InputError
from skytrace.estimation.similarity_fit import Fit, fit_similarity
from skytrace.estimation.similarity_problem import PointItem
from skytrace.evaluation.path import SampledPath
from skytrace.evaluation.search import CHANCE_LEVEL
from skytrace.evaluation.trajectory import TrajectoryErrors, evaluate_trajectory
from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import Similarity, align_similarity
from skytrace.geometry.wgs84 import enu_from_geodetic
from skytrace.io.places import Places
from skytrace.io.run_folder import RunFolder
from skytrace.io.truth import TruthTrajectory, evenly_sampled
from skytrace.model.georeference import ELLIPSOID, Georeference
from skytrace.pipeline.flight_known import middle_of_earth_positions

# Deviations where the table tells none: surveyed metres, and places on the earth.
SIGMA_M = 0.1
EARTH_SIGMA_M = 5.0
_DOUBTFUL_RIVAL = 0.9
_POINTS_SPREAD = 3  # points that a similarity takes


@dataclass(frozen=True, eq=False, slots=True)
class Georeferenced:
    """A georeference and how it was found; `details` are plain values for georeference.json and for people."""

    georeference: Georeference
    details: dict[str, Any]
    warnings: tuple[str, ...] = ()


def from_cameras(run: RunFolder, places: Places, origin: Georeference | None) -> Georeferenced:
    """From known places of cameras. Raises InputError where they do not determine a similarity."""
    assert places.camera_ids is not None  # read as places of cameras
    cameras = {c: row for c, row in run.cameras.items() if row["registered"]}
    absent = [c for c in places.camera_ids if c not in cameras]
    rows = [k for k, c in enumerate(places.camera_ids) if c in cameras]
    if absent and len(rows) < _POINTS_SPREAD:
        raise InputError(places.path, f"no such cameras in the run: {', '.join(absent)}; it has {', '.join(cameras)}")
    ids = [places.camera_ids[k] for k in rows]
    at = np.array([cameras[c]["centre"] for c in ids], float).reshape(-1, 3)
    spread = np.array([np.diag(np.square(cameras[c]["centre_sd"])) for c in ids], float).reshape(-1, 3, 3)
    found = _fitted(run, places, origin, rows, [f"camera {c}" for c in ids], at, spread)
    found.details["from"] = "places of cameras"
    ignored = f"Not in the run and not used: {', '.join(absent)}."
    return replace(found, warnings=(*found.warnings, *([ignored] if absent else [])))


def from_track_points(run: RunFolder, places: Places, origin: Georeference | None) -> Georeferenced:
    """From places of the target at times on the run's clock. Raises InputError where they determine no similarity."""
    assert places.time_s is not None  # read as places of the target
    path = _path(run)
    at, _ = path.evaluate(places.time_s)
    rows = np.flatnonzero(np.isfinite(at[:, 0])).tolist()
    sigma = path.sigma_at(places.time_s)
    each = np.zeros(len(at)) if sigma is None else np.nan_to_num(sigma) / np.sqrt(3)
    spread = each[rows, None, None] ** 2 * np.eye(3)
    names = [f"point at {places.time_s[k]:.3f} s" for k in rows]
    found = _fitted(run, places, origin, rows, names, at[rows], spread)
    found.details["from"] = "points of the track"
    outside = len(at) - len(rows)
    ignored = f"{outside} of {len(at)} points lie outside the covered time and are not used."
    return replace(found, warnings=(*found.warnings, *([ignored] if outside else [])))


def from_gnss_log(run: RunFolder, places: Places, origin: Georeference | None) -> Georeferenced:
    """From a log of the target's places on a clock of its own, whose offset and rate are searched.

    Raises InputError where the log does not match the track.
    """
    assert places.time_s is not None  # read as places of the target
    enu, here = _in_enu(places, origin)
    try:
        even, rate_hz = evenly_sampled(TruthTrajectory(enu, places.time_s))
        evaluation = evaluate_trajectory(_path(run), even, rate_hz)
    except ValueError as error:
        raise InputError(places.path, str(error)) from error
    errors = evaluation.without_large
    if errors.unexplained > CHANCE_LEVEL:
        share = f"{100 * errors.unexplained:.0f} %"
        raise InputError(
            places.path, f"does not match the track: {share} of its motion are left over at the best clock"
        )
    similarity, left = _similarity(run, even, errors)
    georeference = replace(here, enu_from_world=similarity)
    clock, warnings = errors.clock, []
    if evaluation.rival_score > _DOUBTFUL_RIVAL:
        warnings.append("Another offset of the log's clock fits nearly as well: check that track and log agree.")
    details = {
        "from": "a GNSS log of the target",
        "samples": errors.statistics.n,
        "samples_left_out": errors.n_dropped,
        "residual_rms_m": float(np.sqrt((left**2).sum(axis=1).mean())),
        "residual_rms_enu_m": np.sqrt((left**2).mean(axis=0)).tolist(),
        "clock": {
            # A moment t of the run is the log's time_s = offset_s + rate * t.
            "offset_s": float(places.time_s[0] - clock.offset_s / clock.scale),
            "rate": 1 / clock.scale,
            "shift_sd_s": clock.shift_sd_s,
            "rate_sd": clock.scale_sd,
        },
        **_deviations_of(left, _path(run).evaluate(errors.time_s)[0], similarity, _scale_free(run)),
    }
    return Georeferenced(georeference, details, tuple(warnings))


def _fitted(
    run: RunFolder,
    places: Places,
    origin: Georeference | None,
    rows: list[int],
    names: list[str],
    at: FloatArray,
    spread: FloatArray,
) -> Georeferenced:
    enu, here = _in_enu(places, origin)
    sigma_m = np.full(len(enu), EARTH_SIGMA_M if places.on_earth else SIGMA_M)
    if places.sigma_m is not None:
        sigma_m = places.sigma_m
    if len(rows) < _POINTS_SPREAD:
        message = f"expected at least {_POINTS_SPREAD} places of what the run holds, got {len(rows)}"
        raise InputError(places.path, message)
    middle = np.median(enu[rows], axis=0)
    items = [
        PointItem(name, a, s, enu[k] - middle, np.full(3, sigma_m[k]))
        for name, a, s, k in zip(names, at, spread, rows, strict=True)
    ]
    fit = fit_similarity(items, with_scale=_scale_free(run))
    if not fit.unit_known or fit.undetermined.shape[1]:
        raise InputError(
            places.path,
            "the places do not determine where the run lies: they stand in one line, or too close together for their "
            "deviations",
        )
    move = Similarity(fit.move.scale, fit.move.rotation, fit.move.translation + middle)
    return Georeferenced(replace(here, enu_from_world=move), _fit_details(fit), _fit_warnings(fit))


def _scale_free(run: RunFolder) -> bool:
    return run.gauge == "arbitrary"


def _in_enu(places: Places, origin: Georeference | None) -> tuple[FloatArray, Georeference]:
    """The places in metres east, north and up, and of what."""
    if not places.on_earth:
        if origin is None:
            message = "places in metres need --origin LAT,LON,HEIGHT, of which they are metres east, north and up"
            raise InputError(places.path, message)
        return places.position, origin
    if origin is None:
        unmoved = Similarity(1.0, np.eye(3), np.zeros(3))
        latitude, longitude, height_m = middle_of_earth_positions(places.position).tolist()
        origin = Georeference(latitude, longitude, height_m, unmoved, ELLIPSOID)
    return enu_from_geodetic(places.position, origin.origin), origin


def _path(run: RunFolder) -> SampledPath:
    return SampledPath(run.time_s, run.position, run.velocity, run.segment, run.n_cameras, run.sigma)


def _similarity(run: RunFolder, even: FloatArray, errors: TrajectoryErrors) -> tuple[Similarity, FloatArray]:
    """The similarity with the run's own scale where that is metric, and what it leaves (n, 3)."""
    at, _ = _path(run).evaluate(errors.time_s)
    known = even[errors.truth_index]
    inside = np.isfinite(at[:, 0])
    move = errors.truth_from_world
    if not _scale_free(run):
        move = align_similarity(at[inside], known[inside], with_scale=False)
    return move, (known - move.apply(at))[inside]


def _fit_details(fit: Fit) -> dict[str, Any]:
    discounted = {item.name for item in fit.discounted}
    off = {
        item.name: float(np.linalg.norm(fit.move.apply(item.at) - item.position_m))
        for item in (*fit.items, *fit.discounted)
        if isinstance(item, PointItem)
    }
    deviation = np.sqrt(np.maximum(np.diag(fit.covariance), 0))
    return {
        "residuals": {
            name: {"metres": off[name], "deviations": fit.residual[name], "used": name not in discounted}
            for name in fit.residual
        },
        "deviations_widened_by": fit.factor,
        "translation_sd_m": float(np.linalg.norm(deviation[:3])),
        "rotation_sd_deg": float(np.degrees(np.linalg.norm(deviation[3:6]))),
        "scale_sd": float(deviation[6]),  # relative
    }


def _fit_warnings(fit: Fit) -> tuple[str, ...]:
    out = [
        f"The place of {item.name} is not used: it lies {fit.residual[item.name]:.1f} deviations from where the others "
        "put it."
        for item in fit.discounted
    ]
    if fit.contradictory:
        out.append("The places contradict each other, and it cannot be told which is wrong.")
    return tuple(out)


def _deviations_of(left: FloatArray, at: FloatArray, similarity: Similarity, scale_free: bool) -> dict[str, float]:
    """Deviations of a similarity fitted to a track whose residuals (n, 3) are alike for some time."""
    at = similarity.apply(at[np.isfinite(at[:, 0])])
    centred = at - at.mean(axis=0)
    variance = float((left**2).mean()) * _repetitions(left)
    inertia = float((centred**2).sum()) * np.eye(3) - centred.T @ centred
    turn = variance * np.trace(np.linalg.pinv(inertia, hermitian=True))
    return {
        "translation_sd_m": float(np.sqrt(3 * variance / len(left))),
        "rotation_sd_deg": float(np.degrees(np.sqrt(turn))),
        "scale_sd": float(np.sqrt(variance / (centred**2).sum())) if scale_free else 0.0,
    }


def _repetitions(residual: FloatArray) -> float:
    """Samples per independent one: 1 + 2 sum of the autocorrelations up to the first that is not positive."""
    n = len(residual)
    centred = residual - residual.mean(axis=0)
    power = np.abs(np.fft.rfft(centred, 2 * n, axis=0)) ** 2
    correlation = np.fft.irfft(power, axis=0)[:n].sum(axis=1)
    if correlation[0] <= 0:
        return 1.0
    correlation = correlation / correlation[0]
    end = int(np.argmax(correlation <= 0)) or n
    return float(1 + 2 * correlation[1:end].sum())
