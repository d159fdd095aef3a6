"""A run on its way to a format: sampled, moved, timed, or refused."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest
from export_scene import STRETCHES_S, make_georeference, make_run, position, velocity

from skytrace.errors import InputError
from skytrace.io.export import FORMATS, ExportRun
from skytrace.pipeline.export import ExportOptions, export_run, find_format, prepare_export

RUN = make_run(Path("/runs/kite"))
CSV = FORMATS["csv"]
INSTANT = datetime(2024, 5, 3, 12, 15, tzinfo=timezone(timedelta(hours=2)))


def prepared(**options) -> ExportRun:
    return prepare_export(RUN, CSV, ExportOptions(**options))


def test_as_stored_unless_a_rate_is_asked_for() -> None:
    out = prepared()
    assert np.array_equal(out.time_s, RUN.time_s)
    assert np.array_equal(out.position, RUN.position)
    assert out.sigma is not None
    assert np.array_equal(out.sigma, RUN.sigma)
    assert (out.name, out.reference, out.unit) == ("kite", "cam0", "arbitrary")
    assert out.geodetic is None


@pytest.mark.parametrize("rate_hz", [3.0, 10.0, 120.0])
def test_a_rate_samples_its_multiples_inside_the_stretches(rate_hz: float) -> None:
    out = prepared(rate_hz=rate_hz)
    expected = [np.arange(np.ceil(a * rate_hz), np.floor(b * rate_hz) + 1) / rate_hz for a, b in STRETCHES_S]
    assert np.allclose(out.time_s, np.concatenate(expected), rtol=0, atol=1e-12)
    # Hermite curves through a cubic's positions and velocities are that cubic.
    assert np.allclose(out.position, position(out.time_s), rtol=0, atol=1e-9)
    assert np.allclose(out.velocity, velocity(out.time_s), rtol=0, atol=1e-7)
    assert out.sigma is not None
    assert np.allclose(out.sigma, 0.01 + 0.001 * out.time_s)
    assert [out.segment[s][0] for s in out.stretches()] == [0, 1]


def test_a_stretch_too_short_for_the_rate_keeps_its_ends() -> None:
    out = prepared(rate_hz=0.2)
    assert np.array_equal(out.time_s, np.concatenate(STRETCHES_S))
    assert [s.stop - s.start for s in out.stretches()] == [2, 2]


def test_gaps_are_rows_without_values() -> None:
    out = prepared(rate_hz=10.0, with_gaps=True)
    assert np.allclose(np.diff(out.time_s), 0.1)
    inside = np.zeros(len(out.time_s), bool)
    for first, last in STRETCHES_S:
        inside |= (out.time_s >= first) & (out.time_s <= last)
    assert 0 < inside.sum() < len(inside)
    assert out.sigma is not None
    for values in (out.position, out.velocity, out.sigma):
        assert np.array_equal(np.isfinite(values.reshape(len(inside), -1)).all(axis=1), inside)
    assert np.array_equal(out.segment >= 0, inside)
    assert np.array_equal(out.n_cameras > 0, inside)
    assert [out.segment[s][0] for s in out.stretches()] == [0, 1]
    assert prepare_export(RUN, FORMATS["trc"], ExportOptions()).time_s[1:3] == pytest.approx([10.04, 10.06])


def test_time_may_begin_with_the_track() -> None:
    out, stored = prepared(time_zero="start"), prepared()
    assert out.time_s[0] == 0.0
    assert np.allclose(out.time_s + RUN.time_s[0], RUN.time_s, rtol=0, atol=1e-12)
    # A camera's clock keeps telling when its frames were taken.
    frame = out.cameras["my cam"].clock.frame_at(out.time_s, np.full(len(out.time_s), 270.0))
    assert np.allclose(frame, stored.cameras["my cam"].clock.frame_at(RUN.time_s, np.full(len(RUN.time_s), 270.0)))
    assert "10.013" in out.clock


def test_time_may_be_tied_to_an_instant() -> None:
    out = prepared(time_zero=INSTANT)
    assert out.time_zero == datetime(2024, 5, 3, 10, 15, tzinfo=UTC)
    assert out.instants()[0] == "2024-05-03T10:15:10.013000Z"
    with pytest.raises(ValueError, match="time zone"):
        ExportOptions(time_zero=datetime(2024, 5, 3))


def test_a_georeferenced_run_is_in_metres_east_north_up() -> None:
    georeference = make_georeference("EGM96 geoid")
    out = prepare_export(RUN, CSV, ExportOptions(), georeference)
    assert out.unit == "m"
    assert "east, north, up" in out.frame
    assert "EGM96 geoid" in out.frame
    assert np.allclose(out.position, georeference.enu(RUN.position))
    step = 1e-4
    ahead = georeference.enu(position(RUN.time_s + step))
    assert np.allclose(out.velocity, (ahead - out.position) / step, atol=0.05)
    assert out.sigma is not None
    assert np.allclose(out.sigma, 20.0 * RUN.sigma)
    assert out.geodetic is not None
    assert np.allclose(out.geodetic, georeference.geodetic(RUN.position), rtol=0, atol=1e-12)
    assert out.vertical_datum == "EGM96 geoid"


def test_cameras_see_the_same_in_either_frame() -> None:
    georeference = make_georeference()
    world, enu = (prepare_export(RUN, CSV, ExportOptions(frame=f), georeference) for f in ("world", "enu"))
    assert world.unit == "arbitrary"
    assert np.array_equal(world.position, RUN.position)
    assert set(world.cameras) == {"cam0", "my cam"}
    for camera_id, camera in world.cameras.items():
        rays = [r.cameras[camera_id].camera_from_frame.apply(r.position[:5]) for r in (world, enu)]
        assert np.allclose(20.0 * rays[0], rays[1])
        assert camera.geodetic is not None
        assert np.allclose(camera.geodetic, georeference.geodetic(camera.camera_from_frame.centre))
    assert [c.intrinsics.model for c in world.cameras.values()] == ["pinhole", "fisheye"]


@pytest.mark.parametrize("name", list(FORMATS))
def test_a_format_refuses_a_run_that_lacks_what_it_needs(name: str) -> None:
    chosen = FORMATS[name]
    if chosen.needs == "nothing":
        assert export_run(RUN, name) if name != "parquet" else True
        return
    with pytest.raises(InputError) as caught:
        export_run(RUN, name)
    assert caught.value.path == "/runs/kite"
    assert {"metres": "needs metres", "georeference": "place on the earth"}[chosen.needs] in caught.value.message
    assert "skytrace georeference" in caught.value.message
    metric = replace(RUN, gauge="metric")
    if chosen.needs == "metres":
        assert export_run(metric, name)
    else:
        with pytest.raises(InputError, match="place on the earth"):
            export_run(metric, name)
    assert export_run(RUN, name, georeference=make_georeference())


def test_metres_are_refused_in_an_arbitrary_world_even_with_a_georeference() -> None:
    with pytest.raises(InputError, match="needs metres"):
        export_run(RUN, "trc", ExportOptions(frame="world"), make_georeference())
    with pytest.raises(InputError, match="place on the earth"):
        export_run(RUN, "csv", ExportOptions(frame="enu"))


def test_other_refusals() -> None:
    with pytest.raises(InputError, match=r"no such format \(did you mean 'geojson'\?\): expected one of csv, parquet"):
        find_format("geojsn")
    with pytest.raises(InputError, match="possible with csv, parquet, trc"):
        export_run(RUN, "tum", ExportOptions(with_gaps=True))
    with pytest.raises(InputError, match="more than 20000000 samples"):
        export_run(RUN, "csv", ExportOptions(rate_hz=1e8))
    with pytest.raises(ValueError, match="rate_hz"):
        ExportOptions(rate_hz=0.0)
    spoilt = {**RUN.cameras, "cam0": {**RUN.cameras["cam0"], "centre": [1.0, 2.0]}}
    with pytest.raises(InputError, match=r"cameras\.json: camera 'cam0'"):
        export_run(replace(RUN, cameras=spoilt), "csv")
    missing = {k: v for k, v in RUN.cameras["cam0"].items() if k != "size_px"}
    with pytest.raises(InputError, match="size_px"):
        export_run(replace(RUN, cameras={**RUN.cameras, "cam0": missing}), "csv")
