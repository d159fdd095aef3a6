"""Offsets taken as they were given, nothing searched: what a pipeline without pairwise synchronisation starts from."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from skytrace.errors import ReconstructionError
from skytrace.estimation import two_view
from skytrace.estimation.correspond import ImagePath
from skytrace.estimation.growing_steps import rough_offsets
from skytrace.estimation.hint_ties import HINT_CONFIDENCE
from skytrace.estimation.hints import Hints
from skytrace.estimation.sync_settings import SyncSettings
from skytrace.estimation.synchronize import Synchronisation
from skytrace.model.reconstruction import TwoView

_NOTICE = "The offsets are those given: none was searched, and only the adjustment could correct them."


def given_synchronisation(paths: Mapping[str, ImagePath], hints: Hints, settings: SyncSettings) -> Synchronisation:
    """Clocks at nominal rates with the `offset_s` of the hints, and the pairs that have a geometry there.

    Deviations and confidence are those of the hints' word. Raises ValueError where a camera has no offset, and
    ReconstructionError where no pair of cameras has a geometry at the offsets given.
    """
    offset_s = rough_offsets(paths, hints)
    sigma_s = {h.camera_id: h.sigma_s for h in hints.offsets if h.source == "offset_s"}
    reference = next(iter(paths))
    clocks = {c: (offset_s[c] - offset_s[reference], 1.0) for c in paths}
    pairs = []
    for a, b in combinations(paths, 2):
        view = _view(a, b, paths[a], paths[b], offset_s[a] - offset_s[b], settings)
        if view is not None:
            pairs.append(view)
    if not pairs:
        raise ReconstructionError(
            "synchronise",
            "at the offsets given no two cameras' tracks are views of one flight",
            counts={"cameras": len(paths)},
            hint="The search for offsets needs none to be given",
        )
    deviations = {c: (float(np.hypot(sigma_s[c], sigma_s[reference])), settings.rate_prior) for c in paths}
    deviations[reference] = (0.0, 0.0)
    return Synchronisation(
        reference,
        clocks,
        tuple(pairs),
        np.zeros(len(pairs)),
        untied={},
        groups=(clocks,),
        deviations=deviations,
        confidence=dict.fromkeys(paths, HINT_CONFIDENCE),
        warnings=(_NOTICE,),
    )


def _view(
    a: str, b: str, path0: ImagePath, path1: ImagePath, offset_s: float, settings: SyncSettings
) -> TwoView | None:
    """The geometry of a pair at an offset."""
    pairs = two_view.correspond(path0, path1, settings.rate_hz, offset_s, 1.0)
    sample = two_view.thin(pairs, settings.mode_samples)
    pose = two_view.five_point_pose(sample, settings.verify_threshold, seed=0)
    if pose is None:
        return None
    share = float(two_view.support(pose, sample, settings.verify_threshold).mean())
    inlier_s = share * len(pairs) / settings.rate_hz
    return TwoView(a, b, pose, offset_s, 1.0, inlier_s, inlier_s)
