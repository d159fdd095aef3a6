"""TRACKS files are read back as they were written."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.errors import InputError
from skytrace.io.detections import read_detections
from skytrace.io.tracks import HEADER, TrackRows, read_about, tracks_text


def some_rows(rng, n=40):
    frame = np.sort(rng.integers(0, 1000, n))
    target = np.zeros(n, int)
    target[np.unique(frame, return_index=True)[1]] = 1
    return TrackRows(frame, frame / 29.97, rng.uniform(0, 4000, (n, 2)), rng.uniform(0.05, 3, n), np.arange(n), target)


def test_target_is_read_back(rng, tmp_path):
    rows = some_rows(rng)
    path = tmp_path / "tracks.csv"
    path.write_text(tracks_text(rows, {"video": "ä.mp4"}), encoding="utf-8")
    found = read_detections(path)
    chosen = rows.target == 1
    np.testing.assert_array_equal(found.frame, rows.frame[chosen])
    np.testing.assert_allclose(found.xy_px, rows.xy_px[chosen], atol=0.0005 + 1e-9)
    assert found.sigma_px is not None
    assert found.time_s is not None
    np.testing.assert_allclose(found.sigma_px, rows.sigma_px[chosen], atol=0.0005 + 1e-9)
    np.testing.assert_allclose(found.time_s, rows.time_s[chosen], atol=1e-9)
    assert found.n_other_target == (~chosen).sum()
    assert read_about(path) == {"video": "ä.mp4"}
    assert path.read_text().splitlines()[1] == HEADER


@pytest.mark.parametrize("text", ["", "frame,x,y\n1,2,3\n", "# about {\n", "# about []\n"])
def test_other_files(text, tmp_path):
    path = tmp_path / "tracks.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=r"as skytrace detect writes it|empty"):
        read_about(path)


def test_rows_are_checked():
    with pytest.raises(ValueError, match="sigma_px"):
        TrackRows(np.arange(2), np.arange(2.0), np.zeros((2, 2)), np.ones(3), np.arange(2), np.zeros(2, int))
