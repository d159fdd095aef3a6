"""Synchronisation of the public recordings before any 3D step, from nothing but tracks and calibrations."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from skytrace.datasets import Labels, write_dataset
from skytrace.estimation.correspond import ImagePath, image_path
from skytrace.estimation.synchronize import Synchronisation, synchronize
from skytrace.io.flight import read_flight
from skytrace.io.truth import read_true_synchronisation
from skytrace.model.track import Recording
from skytrace.pipeline.config import Config
from skytrace.pipeline.prepare import prepare_flight

pytestmark = pytest.mark.real

CONFIG = Config()
FRAME_S = 1 / 30


def prepared(name: str, labels: Labels, data_dir: Path, folder: Path) -> tuple[tuple[Recording, ...], Path | None]:
    """Cleaned recordings, and the file with the known synchronisation."""
    flight = read_flight(write_dataset(name, labels, data_dir, folder / f"{name}_{labels}"))
    known = None if flight.truth is None else flight.truth.synchronisation
    return tuple(prepare_flight(flight, CONFIG.clean).recordings), known


def paths_of(recordings: tuple[Recording, ...]) -> dict[str, ImagePath]:
    return {r.camera_id: image_path(r, CONFIG.adjust.readout_fraction) for r in recordings}


def synchronised(paths: Mapping[str, ImagePath]) -> Synchronisation:
    return synchronize(paths, CONFIG.synchronise, np.random.default_rng(0))


def time_in(found: Synchronisation, camera_id: str, world_s: float) -> float:
    offset_s, rate = found.clocks[camera_id]
    return (world_s - offset_s) / rate


@pytest.mark.parametrize(("name", "labels"), [("dataset1", "auto"), ("dataset3", "auto"), ("dataset3", "manual")])
def test_every_pair_with_enough_overlap_is_right(name, labels, data_dir, tmp_path):
    recordings, _ = prepared(name, labels, data_dir, tmp_path)
    paths = paths_of(recordings)
    found = synchronised(paths)
    assert not found.untied
    for pair in found.evidence:
        if pair.overlap_s < 20:
            continue
        time0_s = np.arange(paths[pair.camera0].begin_s, paths[pair.camera0].end_s, 0.1)
        common = paths[pair.camera0].defined(time0_s)
        common &= paths[pair.camera1].defined(pair.offset_s + pair.rate * time0_s)
        middle_s = float(np.median(time0_s[common]))
        offset_s, rate = found.clocks[pair.camera0]
        joint_s = time_in(found, pair.camera1, offset_s + rate * middle_s)
        assert pair.offset_s + pair.rate * middle_s == pytest.approx(joint_s, abs=FRAME_S)


@pytest.mark.parametrize("labels", ["auto", "manual"])
def test_dataset3_agrees_with_the_flashes_before_any_3d_step(labels, data_dir, tmp_path):
    recordings, known = prepared("dataset3", labels, data_dir, tmp_path)
    assert known is not None
    flashes = read_true_synchronisation(known)
    found = synchronised(paths_of(recordings))
    rate_hz = {r.camera_id: r.frame_rate_hz for r in recordings}
    reference_frame = 8000.0
    errors = []
    world = {}
    for camera_id, (slope, intercept) in flashes.items():
        offset_s, rate = found.clocks[camera_id]
        world[camera_id] = offset_s + rate * (slope * reference_frame + intercept) / rate_hz[camera_id]
    base = next(c for c, relation in flashes.items() if relation == (1.0, 0.0))
    errors = {c: abs(t - world[base]) / FRAME_S for c, t in world.items() if c != base}
    # The detections of cam1 lie a frame off its flashes, in the manual labels as well: benchmarks/camera_clocks.py.
    assert max(e for c, e in errors.items() if c != "cam1") <= 0.8
    assert errors["cam1"] <= 1.6


def test_dataset4_is_tied_consistently_and_in_time(data_dir, tmp_path):
    recordings, _ = prepared("dataset4", "auto", data_dir, tmp_path)
    paths = paths_of(recordings)
    begin = time.process_time()
    found = synchronised(paths)
    assert time.process_time() - begin <= 10  # 21 pairs; 5 s on a machine that does nothing else
    assert len(found.clocks) == 7
    assert np.median(found.disagreement_s) <= 0.1 * FRAME_S


def test_a_camera_may_start_at_any_frame(data_dir, tmp_path):
    recordings, _ = prepared("dataset3", "auto", data_dir, tmp_path)
    plain = synchronised(paths_of(recordings))
    shift = {"cam1": 5, "cam2": 10_000, "cam4": 500, "cam5": 3000}
    moved = tuple(
        replace(r, tracks=tuple(replace(t, frame=t.frame + shift.get(r.camera_id, 0)) for t in r.tracks))
        for r in recordings
    )
    found = synchronised(paths_of(moved))
    for r in moved:
        at_middle_s = time_in(found, r.camera_id, 250.0) - shift.get(r.camera_id, 0) / r.frame_rate_hz
        assert at_middle_s == pytest.approx(time_in(plain, r.camera_id, 250.0), abs=0.01 * FRAME_S)
