"""Clocks: from frames and rows to world time and back."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from law_strategies import law

from skytrace.model.camera import Clock

clocks = st.builds(
    Clock, st.floats(-1000, 1000), st.floats(1 / 250, 1 / 10), st.floats(0, 0.1), st.sampled_from([480, 1080, 2160])
)


@law
@given(clock=clocks, frame=st.floats(-1e5, 1e5), row=st.floats(0, 2160))
def test_frame_and_world_time_invert_each_other(clock, frame, row):
    t = clock.world_time(frame, row)
    assert clock.frame_at(t, row) == pytest.approx(frame, abs=1e-6)
    assert clock.world_time(clock.frame_at(t, row), row) == pytest.approx(t, abs=1e-8)


@law
@given(clock=clocks, frame=st.integers(0, 10**5))
def test_the_period_separates_frames_and_the_readout_the_first_row_from_the_last(clock, frame):
    top, bottom = clock.world_time(np.array([frame]), np.array([0.0, float(clock.height_px)]))
    assert bottom - top == pytest.approx(clock.readout_s, abs=1e-9)
    assert clock.world_time(frame + 1, 7.0) - clock.world_time(frame, 7.0) == pytest.approx(clock.period_s, abs=1e-9)
    assert clock.world_time(0, 0.0) == clock.offset_s
