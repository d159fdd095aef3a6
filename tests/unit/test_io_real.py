"""Every file of the real recordings can be read."""

from __future__ import annotations

import numpy as np
import pytest

from skytrace.errors import InputError
from skytrace.io.calibration import read_calibration
from skytrace.io.detections import read_detections
from skytrace.io.truth import read_truth_trajectory


@pytest.mark.real
def test_all_files_of_the_recordings(data_dir):
    root = data_dir / "drone-tracking"
    lenses = [read_calibration(path) for path in sorted(root.glob("calibration/*.json"))]
    assert len(lenses) == 12
    assert all(rate_hz is not None and 25 <= rate_hz <= 61 for _, rate_hz in lenses)
    for kind, columns, other in (("auto", "x y frame", "frame x y"), ("manual", "frame x y", "x y frame")):
        paths = sorted(root.glob(f"dataset*/detections_{kind}/*.txt"))
        assert len(paths) == 17
        for path in paths:
            got = read_detections(path, columns)
            with path.open() as file:
                n_rows = sum(1 for line in file if "frame" not in line)
            assert len(got) + got.n_absent == n_rows, path
            assert len(got) > 1500, path
            assert np.isfinite(got.xy_px).all(), path
            assert (got.n_absent > 0) == (kind == "manual"), path
            with pytest.raises(InputError, match=r"swapped|in the header"):
                read_detections(path, other)
    for k, n in ((1, 3290), (3, 3305)):
        assert read_truth_trajectory(root / f"dataset{k}/trajectory/rtk.txt").position_m.shape == (n, 3)
