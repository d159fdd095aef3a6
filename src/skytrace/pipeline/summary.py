"""What a run tells about itself: coverage, residuals, clocks, what was dropped, what the data determine, warnings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from skytrace.estimation.clock_wander import Wander
from skytrace.estimation.coverage import Cuts
from skytrace.estimation.residual_field import ResidualPattern
from skytrace.model.reconstruction import Reconstruction
from skytrace.model.track import Recording
from skytrace.pipeline.known_summary import known_section, known_warnings
from skytrace.pipeline.lens_summary import lens_warnings, pattern_section, patterns
from skytrace.pipeline.observability import NOT_AT_ALL, Verdicts, observability, observability_words
from skytrace.pipeline.offline import Outcome
from skytrace.pipeline.prepare import Prepared
from skytrace.pipeline.sync_document import as_document

_ODD_RATE = 5e-3
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
    verdicts, found = observability(outcome), patterns(reconstruction.cameras)
    known = known_section(outcome)
    return {
        "gauge": reconstruction.gauge,
        "reference": reconstruction.reference,
        "covered_s": reconstruction.trajectory.covered_s,
        "segments": [{"begin_s": s.begin_s, "end_s": s.end_s} for s in segments],
        "not_covered": _not_covered(outcome.cuts),
        **_accuracy(reconstruction),
        "cameras": _cameras(outcome, prepared, found),
        "synchronisation": _synchronisation(outcome, prepared),
        "adjustment": {
            "iterations": outcome.adjusted.iterations,
            "converged": outcome.adjusted.converged,
            "ending": outcome.adjusted.ending,
            "residuals_per_independent_one": outcome.adjusted.inflation,
            "motion_prior_weight": outcome.adjusted.motion.weight,
            "motion_prior_weight_relative": _relative_weight(outcome),
        },
        "observability": verdicts,
        "observability_words": observability_words(outcome, verdicts),
        **({} if known is None else {"known": known}),
        "warnings": _warnings(outcome, prepared, verdicts, found),
        "timings_s": dict(timings_s),
    }


def _accuracy(reconstruction: Reconstruction) -> dict[str, float]:
    """Median posterior deviation and the flight's extent (diagonal of the box around 96 % of it), in world units."""
    times = reconstruction.trajectory.sample_times(5.0)
    low, high = np.percentile(reconstruction.trajectory.position(times), [2, 98], axis=0)
    sigma = reconstruction.trajectory.sigma(times)
    return {"sigma_median": float(np.median(sigma)), "extent": float(np.linalg.norm(high - low))}


def _shape_share(outcome: Outcome) -> float:
    """Deviations of the flight's shape over those in its frame, which count its place too where that is known."""
    whole, shape = outcome.posterior.knot_sigma, outcome.posterior.shape_sigma
    return 1.0 if shape is whole else float(np.median(shape) / max(np.median(whole), 1e-300))


def _synchronisation(outcome: Outcome, prepared: Prepared) -> dict[str, Any]:
    """What `skytrace sync` would write, but for the warnings, which are among the run's own."""
    document = as_document(outcome.synchronisation, [r.camera_id for r in prepared.recordings])
    return {key: value for key, value in document.items() if key != "warnings"}


def _not_covered(cuts: Cuts) -> dict[str, float]:
    """For how long any camera saw the target, and how much of that is not claimed, by reason."""
    return {"seen_s": cuts.seen_s, **{f"{why}_s": cut_s for why, cut_s in cuts.cut_s.items()}}


def _relative_weight(outcome: Outcome) -> float | None:
    """The motion prior's weight as --motion-prior-weight takes it; None without a prior."""
    motion = outcome.adjusted.motion
    return motion.relative_weight(outcome.adjusted.state.control) if motion.automatic else None


def _cameras(outcome: Outcome, prepared: Prepared, found: Mapping[str, ResidualPattern | None]) -> dict[str, Any]:
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
                "residual_pattern": pattern_section(found[camera_id], camera.sigma_px),
                "radial_from_flight": camera_id in outcome.doubted,
            }
        else:
            row["reason"] = reconstruction.unregistered.get(camera_id, "unknown")
        out[camera_id] = row
    return out


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


def _warnings(
    outcome: Outcome, prepared: Prepared, verdicts: Verdicts, found: Mapping[str, ResidualPattern | None]
) -> list[str]:
    """What a user should know before trusting the run, in words."""
    reconstruction, out = outcome.reconstruction, []
    for camera_id, reason in reconstruction.unregistered.items():
        out.append(f"Camera {camera_id} is left out: {reason}.")
    out += outcome.synchronisation.warnings
    recordings = {r.camera_id: r for r in prepared.recordings}
    out += [_wander_words(recordings[camera_id], wander) for camera_id, wander in outcome.wander.items()]
    for camera_id, camera in reconstruction.cameras.items():
        out += _rate_words(recordings[camera_id], camera.clock.period_s)
        if verdicts[camera_id]["offset_s"]["determined"] == NOT_AT_ALL:
            out.append(
                f"Camera {camera_id}'s clock offset is not determined: it may be off by "
                f"{verdicts[camera_id]['offset_s']['posterior_sd']:.2g} s. The flight hardly turned where it was seen."
            )
        if camera.residuals.median_px > _UNEVEN_PX:
            out.append(
                f"Camera {camera_id} leaves a median reprojection error of {camera.residuals.median_px:.1f} px: "
                "look at its detections, its calibration and its frame rate."
            )
    out += lens_warnings(outcome, verdicts, found)
    out += known_warnings(outcome)
    if outcome.adjusted.ending in _ENDINGS:
        out.append(_ENDINGS[outcome.adjusted.ending])
    accuracy = _accuracy(reconstruction)
    shape = accuracy["sigma_median"] * _shape_share(outcome)
    if shape > _WEAK * accuracy["extent"]:
        share = 100 * shape / accuracy["extent"]
        out.append(
            f"The cameras' geometry is weak: positions are uncertain by {share:.2f} % of the flight's extent, slowly "
            "varying along the track. A further camera that sees the flight from another side would help most."
        )
    if len(reconstruction.cameras) == 2:
        out.append("Only two cameras: lenses are kept as calibrated, and errors along the line of sight stay large.")
    return out
