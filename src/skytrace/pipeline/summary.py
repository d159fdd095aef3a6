"""What a run tells about itself: coverage, residuals, clocks, what was dropped, what the data determine, warnings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from skytrace.estimation.adjust.driver import Adjusted
from skytrace.estimation.adjust.problem import ASPECT, FOCAL, PRINCIPAL, RADIAL, RATE, READOUT
from skytrace.estimation.clock_wander import Wander
from skytrace.estimation.posterior import Posterior
from skytrace.model.reconstruction import Reconstruction
from skytrace.model.track import Recording
from skytrace.pipeline.offline import Outcome
from skytrace.pipeline.prepare import Prepared
from skytrace.pipeline.sync_document import as_document

_DETERMINED, _PARTLY = 0.3, 0.8  # posterior deviation over prior deviation
_ODD_RATE = 5e-3
_ODD_PRIORS = 3.0
_UNEVEN_PX = 3.0
_WEAK = 1.5e-3
_ENDINGS = {
    "iterations": "The adjustment had not settled when it was stopped; the last steps changed little.",
    "no acceptable step": "The adjustment diverged: no step improved it any more, although it is not at its best. "
    "Do not trust this run; look at the cameras with large reprojection errors.",
    "singular": "The adjustment diverged: its equations have no solution. Do not trust this run; look for cameras that "
    "share too little of the flight with the others.",
    "not finite": "The adjustment diverged: it started from numbers without a cost. Do not trust this run; check the "
    "calibrations and detections for absurd values.",
}


def summarise(outcome: Outcome, prepared: Prepared, timings_s: Mapping[str, float]) -> dict[str, Any]:
    """The content of summary.json: plain numbers, strings, lists and dicts."""
    reconstruction = outcome.reconstruction
    segments = reconstruction.trajectory.segments
    observability = _observability(outcome.adjusted, outcome.posterior)
    return {
        "gauge": reconstruction.gauge,
        "reference": reconstruction.reference,
        "covered_s": reconstruction.trajectory.covered_s,
        "segments": [{"begin_s": s.begin_s, "end_s": s.end_s} for s in segments],
        **_accuracy(reconstruction),
        "cameras": _cameras(outcome, prepared),
        "synchronisation": _synchronisation(outcome, prepared),
        "adjustment": {
            "iterations": outcome.adjusted.iterations,
            "converged": outcome.adjusted.converged,
            "ending": outcome.adjusted.ending,
            "residuals_per_independent_one": outcome.adjusted.inflation,
            "motion_prior_weight": outcome.adjusted.motion.weight,
        },
        "observability": observability,
        "warnings": _warnings(outcome, prepared, observability),
        "timings_s": dict(timings_s),
    }


def _accuracy(reconstruction: Reconstruction) -> dict[str, float]:
    """Median posterior deviation and the flight's extent (diagonal of the box around 96 % of it), in world units."""
    times = reconstruction.trajectory.sample_times(5.0)
    low, high = np.percentile(reconstruction.trajectory.position(times), [2, 98], axis=0)
    sigma = reconstruction.trajectory.sigma(times)
    return {"sigma_median": float(np.median(sigma)), "extent": float(np.linalg.norm(high - low))}


def _synchronisation(outcome: Outcome, prepared: Prepared) -> dict[str, Any]:
    """What `skytrace sync` would write, but for the warnings, which are among the run's own."""
    document = as_document(outcome.synchronisation, [r.camera_id for r in prepared.recordings])
    return {key: value for key, value in document.items() if key != "warnings"}


def _cameras(outcome: Outcome, prepared: Prepared) -> dict[str, Any]:
    reconstruction = outcome.reconstruction
    out: dict[str, Any] = {}
    for recording in prepared.recordings:
        camera_id = recording.camera_id
        row: dict[str, Any] = {
            "n_detections": prepared.n_detections[camera_id],
            "dropped": dict(prepared.dropped[camera_id]),
            "registered": camera_id in reconstruction.cameras,
        }
        if camera_id in reconstruction.cameras:
            camera = reconstruction.cameras[camera_id]
            row |= {
                "n_used": len(camera.residuals.frame),
                "n_inliers": int(camera.residuals.inlier.sum()),
                "reprojection_median_px": camera.residuals.median_px,
                "sigma_px": camera.sigma_px,
                "frame_rate_given_hz": recording.frame_rate_hz,
                "frame_rate_found_hz": 1 / camera.clock.period_s,
            }
        else:
            row["reason"] = reconstruction.unregistered.get(camera_id, "unknown")
        out[camera_id] = row
    return out


def _observability(adjusted: Adjusted, posterior: Posterior) -> dict[str, Any]:
    """For each camera and kind of parameter: estimate, prior and posterior deviation, and what determined it."""
    prior = adjusted.priors.deviation * np.sqrt(adjusted.inflation)
    columns = {
        "rate": (RATE, adjusted.state.clock[:, 1] - 1, posterior.clock[:, 1]),
        "readout_s": (READOUT, adjusted.state.clock[:, 2], posterior.clock[:, 2]),
        "focal_scale": (FOCAL, adjusted.state.lens[:, 0], posterior.lens[:, 0]),
        "aspect": (ASPECT, adjusted.state.lens[:, 1], posterior.lens[:, 1]),
        "principal_x": (PRINCIPAL.start, adjusted.state.lens[:, 2], posterior.lens[:, 2]),
        "principal_y": (PRINCIPAL.start + 1, adjusted.state.lens[:, 3], posterior.lens[:, 3]),
        "k1": (RADIAL.start, adjusted.state.lens[:, 4], posterior.lens[:, 4]),
        "k2": (RADIAL.start + 1, adjusted.state.lens[:, 5], posterior.lens[:, 5]),
        "k3": (RADIAL.start + 2, adjusted.state.lens[:, 6], posterior.lens[:, 6]),
    }
    return {
        camera_id: {
            name: _verdict(float(value[i]), float(prior[i, column]), float(deviation[i]))
            for name, (column, value, deviation) in columns.items()
        }
        for i, camera_id in enumerate(adjusted.camera_ids)
    }


def _verdict(value: float, prior: float, posterior: float) -> dict[str, Any]:
    if prior == 0:
        said = "fixed"
    elif posterior <= _DETERMINED * prior:
        said = "determined by the data"
    elif posterior <= _PARTLY * prior:
        said = "partly by the data"
    else:
        said = "by its prior"
    return {"value": value, "prior_sd": prior, "posterior_sd": posterior, "determined": said}


def _wander_words(recording: Recording, wander: Wander) -> str:
    sways = f"by {1e3 * wander.rms_s:.0f} ms (rms), which was estimated from the residuals"
    if recording.stamped:
        return (
            f"Camera {recording.camera_id}'s time stamps are uneven {sways}: check that they are those of the video "
            "that was measured, frame by frame."
        )
    return (
        f"Camera {recording.camera_id}'s frames are not evenly spaced: its clock wanders {sways}. Its video's own "
        'frame times are better: give them as timestamps = "FILE", for instance from ffprobe (see docs/formats.md).'
    )


def _rate_words(recording: Recording, period_s: float) -> list[str]:
    """What to say of a camera that does not run as given."""
    given_hz, found_hz = 1 / recording.frame_line()[1], 1 / period_s
    if abs(found_hz / given_hz - 1) <= _ODD_RATE:
        return []
    if recording.stamped:
        return [
            f"Camera {recording.camera_id}'s time stamps say {given_hz:.4g} frames a second, the flight "
            f"{found_hz:.4g}: give those of the video as it was filmed, not slowed down or converted, or none."
        ]
    return [
        f"Camera {recording.camera_id} runs at {found_hz:.4g} frames a second, not the {given_hz:.4g} given: "
        'correct frame_rate_hz, or give timestamps = "FILE" if its frame rate varies (see docs/formats.md).'
    ]


def _warnings(outcome: Outcome, prepared: Prepared, observability: Mapping[str, Any]) -> list[str]:
    """What a user should know before trusting the run, in words."""
    reconstruction, out = outcome.reconstruction, []
    for camera_id, reason in reconstruction.unregistered.items():
        out.append(f"Camera {camera_id} is left out: {reason}.")
    out += outcome.synchronisation.warnings
    recordings = {r.camera_id: r for r in prepared.recordings}
    out += [_wander_words(recordings[camera_id], wander) for camera_id, wander in outcome.wander.items()]
    for camera_id, camera in reconstruction.cameras.items():
        out += _rate_words(recordings[camera_id], camera.clock.period_s)
        focal = observability[camera_id]["focal_scale"]
        if focal["prior_sd"] and abs(focal["value"]) > _ODD_PRIORS * focal["prior_sd"]:
            out.append(
                f"Camera {camera_id}'s focal length had to change by {100 * focal['value']:.1f} %: "
                "its calibration does not fit how it filmed (zoom, stabilisation or another resolution?)."
            )
        if camera.residuals.median_px > _UNEVEN_PX:
            out.append(
                f"Camera {camera_id} leaves a median reprojection error of {camera.residuals.median_px:.1f} px: "
                "look at its detections, its calibration and its frame rate."
            )
    if outcome.adjusted.ending in _ENDINGS:
        out.append(_ENDINGS[outcome.adjusted.ending])
    accuracy = _accuracy(reconstruction)
    if accuracy["sigma_median"] > _WEAK * accuracy["extent"]:
        share = 100 * accuracy["sigma_median"] / accuracy["extent"]
        out.append(
            f"The cameras' geometry is weak: positions are uncertain by {share:.2f} % of the flight's extent, slowly "
            "varying along the track. A further camera that sees the flight from another side would help most."
        )
    if len(reconstruction.cameras) == 2:
        out.append("Only two cameras: lenses are kept as calibrated, and errors along the line of sight stay large.")
    return out
