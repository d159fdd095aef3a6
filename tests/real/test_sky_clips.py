"""Bands on real clips of drones and a bird, labelled by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from skytrace.pipeline.detect import detect_video

pytestmark = pytest.mark.real

# Recall at least, detections outside the boxes a frame at most.
BANDS = {
    "IR_DRONE_010": (0.97, 0.02),
    "V_DRONE_070": (0.97, 0.1),
    "V_DRONE_045": (0.95, 0.05),
    "V_BIRD_010": (0.85, 0.1),
}


@pytest.mark.parametrize("clip", BANDS)
def test_clip(data_dir: Path, clip: str) -> None:
    video = data_dir / "sky-clips" / f"{clip}.mp4"
    if not video.is_file():
        pytest.skip("sky-clips are not among the data")
    table = np.loadtxt(video.with_suffix(".csv"), delimiter=",", skiprows=1)
    boxes = {int(row[0]): row[1:] for row in table}
    detected = detect_video(video)
    found, n_false = set(), 0
    for track in detected.tracks:
        for frame, (x, y) in zip(track.frame.tolist(), track.xy_px, strict=True):
            # Labels can lag by one frame.
            near = [b for b in (boxes.get(frame), boxes.get(frame + 1)) if b is not None]
            if any(b[0] <= x <= b[0] + b[2] and b[1] <= y <= b[1] + b[3] for b in near):
                found.add(frame)
            else:
                n_false += 1
    labelled = {frame for frame in boxes if frame < detected.n_frames}
    least_recall, most_false = BANDS[clip]
    assert len(found & labelled) >= least_recall * len(labelled)
    assert n_false <= most_false * detected.n_frames
