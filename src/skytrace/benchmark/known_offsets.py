"""Known corresponding frames as offsets: rough ones made of them, and the errors of found ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from skytrace.evaluation.clocks import synchronisation_errors
from skytrace.model.camera import Clock
from skytrace.model.track import Recording

_ROW = 0.5  # of the image height, at which frames correspond


@dataclass(frozen=True, slots=True)
class OffsetErrors:
    """Absolute errors in frames of the reference camera's rate, in the middle of each camera's common view with `base`.

    `base` is the reference, or the first camera with a clock where the reference has none; cameras in `missing` have
    none either.
    """

    reference: str
    base: str
    frames: Mapping[str, float]  # by camera, without the base
    missing: tuple[str, ...]

    @property
    def mean_frames(self) -> float:
        return float(np.mean(list(self.frames.values())))


@dataclass(frozen=True, eq=False, slots=True)
class KnownOffsets:
    """Cameras of known synchronisation: frame = slope * reference frame + intercept."""

    synchronisation: Mapping[str, tuple[float, float]]
    reference: str
    nominal: Mapping[str, Clock]  # each camera's own time
    seen: Mapping[str, tuple[float, float]]  # first and last detection in frames of the reference

    @classmethod
    def of(
        cls,
        recordings: Sequence[Recording],
        synchronisation: Mapping[str, tuple[float, float]],
        readout_fraction: float,
    ) -> KnownOffsets:
        """From the recordings of every camera of a known synchronisation."""
        given = {r.camera_id: r for r in recordings}
        seen = {}
        for c, (slope, intercept) in synchronisation.items():
            frames = np.concatenate([track.frame for track in given[c].tracks])
            seen[c] = (float(frames.min() - intercept) / slope, float(frames.max() - intercept) / slope)
        return cls(
            dict(synchronisation),
            next(c for c, known in synchronisation.items() if np.allclose(known, (1.0, 0.0), 0.0, 1e-9)),
            {c: camera_clock(given[c], 0.0, 1.0, readout_fraction) for c in synchronisation},
            seen,
        )

    @property
    def rate_hz(self) -> float:
        """Nominal frame rate of the reference camera."""
        return 1 / self.nominal[self.reference].period_s

    def rough_offsets_s(self, shift_frames: float) -> dict[str, float]:
        """Offsets (camera time 0 on the reference's clock) that are off by the shift on average.

        Ahead and behind by turns and by half the shift to one and a half, so that no two cameras are off alike: those
        would be synchronised with each other. Rates are nominal; without the shift, offsets are exact in the middle of
        the common view.
        """
        out = {self.reference: 0.0}
        others = [c for c in sorted(self.synchronisation) if c != self.reference]
        share = np.linspace(0.5, 1.5, len(others)) * (-1.0) ** np.arange(len(others))
        for k, c in enumerate(others):
            middle = self._middle(self.reference, c)
            error_s = float(share[k]) * shift_frames / self.rate_hz
            base_s, own_s = (self._time_s(self.nominal, camera, middle) for camera in (self.reference, c))
            out[c] = base_s - own_s + error_s
        return out

    def errors(self, clocks: Mapping[str, Clock]) -> OffsetErrors:
        """Errors of the clocks found, two of them at least; judged as `evaluation.clocks` does."""
        present = [c for c in self.synchronisation if c in clocks]
        base = self.reference if self.reference in clocks else present[0]
        frames = {}
        for c in present:
            if c == base:
                continue
            time_s = self._time_s(clocks, base, self._middle(base, c))
            known = {camera: self.synchronisation[camera] for camera in (base, c)}
            error = synchronisation_errors(clocks, known, np.array([time_s]), _ROW).error[c]
            frames[c] = error.mean_s * self.rate_hz
        missing = tuple(c for c in sorted(self.synchronisation) if c not in clocks)
        return OffsetErrors(self.reference, base, frames, missing)

    def _middle(self, a: str, b: str) -> float:
        """The middle of two cameras' common view in frames of the reference."""
        return 0.5 * (max(self.seen[a][0], self.seen[b][0]) + min(self.seen[a][1], self.seen[b][1]))

    def _time_s(self, clocks: Mapping[str, Clock], camera_id: str, reference_frame: float) -> float:
        """World time of a camera's middle row that was exposed with that of a frame of the reference."""
        slope, intercept = self.synchronisation[camera_id]
        clock = clocks[camera_id]
        frame = np.array(slope * reference_frame + intercept)
        return float(clock.world_time(frame, np.array(_ROW * clock.height_px)))


def camera_clock(recording: Recording, offset_s: float, rate: float, readout_fraction: float) -> Clock:
    """The clock of a camera whose own time, as synchronisation sees it, runs as offset_s + rate * camera time."""
    period_s = rate / recording.frame_rate_hz
    return Clock(offset_s, period_s, readout_fraction * period_s, recording.intrinsics.height_px)
