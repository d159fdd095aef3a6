"""Every format, read back by what others read it with, where that is installed, and by hand where not."""

from __future__ import annotations

import csv
import io
import json
from datetime import UTC, datetime
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from export_scene import make_georeference, make_run

from skytrace.errors import InputError
from skytrace.geometry.arrays import FloatArray
from skytrace.geometry.rigid import so3_exp
from skytrace.io.calibration import read_calibration
from skytrace.io.export import FORMATS, ExportRun
from skytrace.io.export.colmap import quaternion_wxyz
from skytrace.io.truth import read_truth_trajectory
from skytrace.model.georeference import Georeference
from skytrace.pipeline.export import ExportOptions, export_run, find_format, prepare_export

RUN = make_run(Path("/runs/kite & <co>"))
GEO = make_georeference("EGM96 geoid")
INSTANT = datetime(2024, 5, 3, 10, 15, tzinfo=UTC)
NAMESPACES = {
    "gpx": "http://www.topografix.com/GPX/1/1",
    "kml": "http://www.opengis.net/kml/2.2",
    "gx": "http://www.google.com/kml/ext/2.2",
}


def text(name: str, georeference: Georeference | None = None, **options) -> str:
    content = export_run(RUN, name, ExportOptions(**options), georeference)
    assert isinstance(content, str)
    assert content.endswith("\n")
    return content


def expected(name: str, georeference: Georeference | None = None, **options) -> ExportRun:
    return prepare_export(RUN, find_format(name), ExportOptions(**options), georeference)


def degrees_of(run: ExportRun) -> FloatArray:
    """Longitude and latitude in degrees and height in metres (n, 3)."""
    assert run.geodetic is not None
    return np.column_stack([np.degrees(run.geodetic[:, 1]), np.degrees(run.geodetic[:, 0]), run.geodetic[:, 2]])


def numbers(cells: list[str]) -> FloatArray:
    return np.array([float(cell) if cell else np.nan for cell in cells])


@pytest.mark.parametrize("name", list(FORMATS))
def test_every_format_writes_every_kind_of_run(name: str) -> None:
    if name == "parquet":
        pytest.importorskip("pyarrow")
    for options in (
        ExportOptions(),
        ExportOptions(2.0, "enu", "start", deviations=False),
        ExportOptions(10, None, INSTANT),
    ):
        content = export_run(RUN, name, options, GEO)
        assert content
        assert isinstance(content, dict) == (FORMATS[name].suffix == "")
        assert name == FORMATS[name].name


# CSV


def read_csv(content: str) -> tuple[list[str], dict[str, list[str]]]:
    lines = content.splitlines()
    remarks = [line for line in lines if line.startswith("#")]
    rows = list(csv.DictReader(lines[len(remarks) :]))
    return remarks, {name: [row[name] for row in rows] for name in rows[0]}


def test_csv_holds_the_stored_samples() -> None:
    remarks, table = read_csv(text("csv"))
    assert list(table) == ["time_s", "x", "y", "z", "vx", "vy", "vz", "sigma", "n_cameras", "segment"]
    assert np.allclose(numbers(table["time_s"]), RUN.time_s, rtol=0, atol=1e-9)
    assert np.allclose(np.column_stack([numbers(table[k]) for k in "xyz"]), RUN.position, rtol=1e-11)
    assert np.allclose(np.column_stack([numbers(table[k]) for k in ("vx", "vy", "vz")]), RUN.velocity, rtol=1e-11)
    assert table["segment"] == [str(s) for s in RUN.segment.tolist()]
    assert any("arbitrary" in line for line in remarks)


def test_csv_of_a_georeferenced_run_names_units_and_is_a_truth_file(tmp_path: Path) -> None:
    remarks, table = read_csv(text("csv", GEO, time_zero=INSTANT, deviations=False))
    assert list(table)[:8] == ["time_s", "time_utc", "x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s"]
    assert "sigma_m" not in table
    assert table["time_utc"][0] == "2024-05-03T10:15:10.013000Z"
    geodetic = np.column_stack([numbers(table[k]) for k in ("longitude_deg", "latitude_deg", "height_m")])
    assert np.allclose(geodetic, degrees_of(expected("csv", GEO)), rtol=0, atol=1e-5)
    assert np.allclose(geodetic[:, :2], degrees_of(expected("csv", GEO))[:, :2], rtol=0, atol=1e-10)
    assert "# heights above: EGM96 geoid" in remarks

    path = tmp_path / "truth.csv"
    path.write_text(text("csv", GEO))
    truth = read_truth_trajectory(path)
    assert np.allclose(truth.position_m, GEO.enu(RUN.position), rtol=1e-10)


def test_csv_leaves_gaps_empty() -> None:
    _, table = read_csv(text("csv", rate_hz=10.0, with_gaps=True))
    out = expected("csv", rate_hz=10.0, with_gaps=True)
    assert np.array_equal(np.isnan(numbers(table["x"])), out.segment < 0)
    assert np.array_equal(np.isnan(numbers(table["sigma"])), out.segment < 0)


# Parquet


def test_parquet_holds_the_columns_of_the_csv() -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    options = {"rate_hz": 10.0, "with_gaps": True, "time_zero": INSTANT}
    content = export_run(RUN, "parquet", ExportOptions(**options), GEO)
    assert isinstance(content, bytes)
    table = parquet.read_table(io.BytesIO(content))
    _, csv_table = read_csv(text("csv", GEO, **options))
    assert table.column_names == list(csv_table)
    out = expected("parquet", GEO, **options)
    x, times = table["x_m"].to_pylist(), table["time_utc"].to_pylist()
    assert [v is None for v in x] == (out.segment < 0).tolist()
    assert [v for v in x if v is not None] == out.position[out.segment >= 0, 0].tolist()
    assert times[0].isoformat() == "2024-05-03T10:15:10.100000+00:00"
    assert table.schema.metadata[b"skytrace.heights_above"] == b"EGM96 geoid"
    assert table["segment"].to_pylist() == out.segment.tolist()


def test_parquet_opens_in_pandas() -> None:
    pytest.importorskip("pyarrow")
    pandas = pytest.importorskip("pandas")
    content = export_run(RUN, "parquet")
    assert isinstance(content, bytes)
    frame = pandas.read_parquet(io.BytesIO(content))
    assert np.array_equal(frame[["x", "y", "z"]].to_numpy(), RUN.position)


def test_parquet_says_what_it_lacks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"pip install 'skytrace\[parquet\]', or export to csv"):
        export_run(RUN, "parquet")


# TUM


def test_tum_rows() -> None:
    content = text("tum", rate_hz=10.0)
    rows = np.loadtxt(io.StringIO(content))
    out = expected("tum", rate_hz=10.0)
    assert np.allclose(rows[:, 0], out.time_s, rtol=0, atol=1e-6)
    assert np.allclose(rows[:, 1:4], out.position, rtol=1e-8)
    assert np.array_equal(rows[:, 4:], np.tile([0, 0, 0, 1], (len(rows), 1)))
    assert "unit of length: arbitrary" in content
    unix = np.loadtxt(io.StringIO(text("tum", rate_hz=10.0, time_zero=INSTANT)))
    assert np.allclose(unix[:, 0] - INSTANT.timestamp(), out.time_s, rtol=0, atol=1e-6)


def test_tum_is_read_by_evo(tmp_path: Path) -> None:
    file_interface = pytest.importorskip("evo.tools.file_interface")
    path = tmp_path / "run.tum"
    path.write_text(text("tum"))
    trajectory = file_interface.read_tum_trajectory_file(str(path))
    assert np.allclose(trajectory.positions_xyz, RUN.position, rtol=1e-8)
    assert np.allclose(trajectory.timestamps, RUN.time_s, rtol=0, atol=1e-6)
    assert trajectory.check()[0]


# GPX


def test_gpx_tree() -> None:
    root = ElementTree.fromstring(text("gpx", GEO, time_zero=INSTANT))
    out = expected("gpx", GEO, time_zero=INSTANT)
    assert root.attrib["version"] == "1.1"
    # The schema wants this order.
    assert [child.tag.split("}")[1] for child in root] == ["metadata", "wpt", "wpt", "trk"]
    assert root.findtext("gpx:metadata/gpx:name", namespaces=NAMESPACES) == "kite & <co>"
    assert "above EGM96 geoid" in str(root.findtext("gpx:trk/gpx:desc", namespaces=NAMESPACES))
    segments = root.findall("gpx:trk/gpx:trkseg", NAMESPACES)
    assert [len(s) for s in segments] == [s.stop - s.start for s in out.stretches()]
    points = [p for s in segments for p in s]
    assert [c.tag.split("}")[1] for c in points[0]] == ["ele", "time"]
    assert len(points) == len(out.time_s) == len(np.unique(out.time_s))
    assert np.allclose(np.diff(out.time_s[:8]), 0.2)
    untimed = ElementTree.fromstring(text("gpx", GEO))
    assert untimed.find(".//gpx:time", NAMESPACES) is None


def test_gpx_is_read_by_gpxpy() -> None:
    gpxpy = pytest.importorskip("gpxpy")
    gpx = gpxpy.parse(text("gpx", GEO, time_zero=INSTANT, rate_hz=2.0))
    out = expected("gpx", GEO, time_zero=INSTANT, rate_hz=2.0)
    points = [p for s in gpx.tracks[0].segments for p in s.points]
    theirs = np.array([[p.longitude, p.latitude, p.elevation] for p in points])
    assert np.allclose(theirs, degrees_of(out), rtol=0, atol=6e-4)
    assert np.allclose(theirs[:, :2], degrees_of(out)[:, :2], rtol=0, atol=1e-9)
    seconds = [(p.time - INSTANT).total_seconds() for p in points]
    assert np.allclose(seconds, out.time_s, rtol=0, atol=1e-6)
    assert [w.name for w in gpx.waypoints] == ["cam0", "my cam"]


# KML


def test_kml_tracks_have_a_time_for_every_place() -> None:
    root = ElementTree.fromstring(text("kml", GEO, time_zero=INSTANT))
    out = expected("kml", GEO, time_zero=INSTANT)
    tracks = root.findall(".//gx:MultiTrack/gx:Track", NAMESPACES)
    assert len(tracks) == 2
    when = [w.text for t in tracks for w in t.findall("kml:when", NAMESPACES)]
    places = [str(c.text).split(" ") for t in tracks for c in t.findall("gx:coord", NAMESPACES)]
    assert when == out.instants()
    assert np.allclose(np.array(places, float), degrees_of(out), rtol=0, atol=6e-4)
    assert [len(t.findall(".//gx:value", NAMESPACES)) for t in tracks] == [s.stop - s.start for s in out.stretches()]
    assert {t.findtext("kml:altitudeMode", namespaces=NAMESPACES) for t in tracks} == {"absolute"}
    names = [n.text for n in root.findall(".//kml:Placemark/kml:name", NAMESPACES)]
    assert names == ["cam0", "my cam", "target"]
    assert "EGM96 geoid" in str(root.findtext("kml:Document/kml:description", namespaces=NAMESPACES))


def test_kml_without_a_date_says_what_it_counts_from() -> None:
    root = ElementTree.fromstring(text("kml", GEO, deviations=False))
    assert root.findtext(".//kml:when", namespaces=NAMESPACES) == "1970-01-01T00:00:10.200000Z"
    description = str(root.findtext("kml:Document/kml:description", namespaces=NAMESPACES))
    assert "Dates are not known: 1970-01-01T00:00:00Z stands for 0 s" in description
    assert root.find(".//gx:value", NAMESPACES) is None
    assert root.find(".//kml:Schema", NAMESPACES) is None


# GeoJSON


def test_geojson_lines_and_their_samples() -> None:
    document = json.loads(text("geojson", GEO, time_zero=INSTANT))
    out = expected("geojson", GEO, time_zero=INSTANT)
    assert document["type"] == "FeatureCollection"
    assert document["heights_above"] == "EGM96 geoid"
    lines = [f for f in document["features"] if f["properties"]["kind"] == "track"]
    points = [f for f in document["features"] if f["properties"]["kind"] == "camera"]
    assert [f["geometry"]["type"] for f in lines] == ["LineString"] * 2
    assert [f["properties"]["id"] for f in points] == ["cam0", "my cam"]
    for line, stretch in zip(lines, out.stretches(), strict=True):
        # RFC 7946: longitude, latitude, height and nothing else.
        coordinates = np.array(line["geometry"]["coordinates"])
        assert np.allclose(coordinates, degrees_of(out)[stretch], rtol=0, atol=6e-4)
        assert np.allclose(coordinates[:, :2], degrees_of(out)[stretch, :2], rtol=0, atol=1e-9)
        for key in ("time_s", "sigma_m", "n_cameras", "time_utc"):
            assert len(line["properties"][key]) == len(coordinates), key
    assert "sigma_m" not in json.loads(text("geojson", GEO, deviations=False))["features"][0]["properties"]


# TRC


def test_trc_is_a_constant_rate_table_with_empty_gaps() -> None:
    lines = text("trc", GEO, rate_hz=20.0, time_zero="start").splitlines()
    out = expected("trc", GEO, rate_hz=20.0, time_zero="start")
    head = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=True))
    assert lines[0].startswith("PathFileType\t4\t(X/Y/Z)\t")
    assert head["Units"] == "m"
    assert float(head["DataRate"]) == 20.0
    assert int(head["NumFrames"]) == len(out.time_s) == len(lines) - 6
    assert lines[3].split("\t")[:3] == ["Frame#", "Time", "target"]
    rows = [line.split("\t") for line in lines[6:]]
    assert {len(row) for row in rows} == {5}
    assert [int(row[0]) for row in rows] == list(range(1, len(rows) + 1))
    values = np.array([numbers(row[1:]) for row in rows])
    assert np.allclose(np.diff(values[:, 0]), 0.05)
    assert np.allclose(values[:, 1:], out.position, rtol=0, atol=1e-6, equal_nan=True)
    assert np.isnan(values[:, 1:]).any()
    with pytest.raises(InputError, match="higher --rate"):
        export_run(RUN, "trc", ExportOptions(rate_hz=0.05), GEO)


# mvus


def test_mvus_clocks_tell_the_same_times(tmp_path: Path) -> None:
    document, out = json.loads(text("mvus")), expected("mvus")
    reference = out.cameras["cam0"].clock
    assert [c["comment"] for c in document["cameras"]] == ["cam0", "my cam"]
    assert document["ref_cam"] == 0
    for k, camera in enumerate(out.cameras.values()):
        frame, row = np.array([0.0, 100.0, 7.5]), np.array([0.0, 540.0, 1079.0])
        height = camera.intrinsics.height_px
        theirs = document["alpha"][k] * (frame + document["rs"][k] * row / height) + document["beta"][k]
        ours_s = camera.clock.world_time(frame, row)
        assert np.allclose(theirs * reference.period_s + reference.offset_s, ours_s)
        path = tmp_path / f"{k}.json"
        path.write_text(json.dumps(document["cameras"][k]))
        lens, rate_hz = read_calibration(path)
        assert np.array_equal(lens.distortion, camera.intrinsics.distortion)
        assert lens.model == camera.intrinsics.model
        assert rate_hz == pytest.approx(1 / camera.clock.period_s)
        assert np.allclose(document["cameras"][k]["R"], camera.camera_from_frame.rotation)
        assert np.allclose(document["cameras"][k]["t"], camera.camera_from_frame.translation)
    trajectory = np.array(document["traj"])
    assert np.allclose(trajectory[0] * reference.period_s + reference.offset_s, out.time_s)
    assert np.allclose(trajectory[1:].T, out.position)


# COLMAP


def write_colmap(folder: Path, georeference: Georeference | None = None) -> ExportRun:
    content = export_run(RUN, "colmap", None, georeference)
    assert isinstance(content, dict)
    for name, lines in content.items():
        (folder / name).write_text(lines)
    return expected("colmap", georeference)


def test_colmap_files(tmp_path: Path) -> None:
    out = write_colmap(tmp_path)
    cameras = [s.split() for s in (tmp_path / "cameras.txt").read_text().splitlines() if s[0] != "#"]
    assert [c[1] for c in cameras] == ["FULL_OPENCV", "OPENCV_FISHEYE"]
    # The centre of the top-left pixel is (0.5, 0.5) there.
    assert cameras[0][4:8] == ["1500.0", "1510.0", "960.5", "540.5"]
    assert cameras[0][8:] == ["0.05", "-0.1", "0.001", "-0.002", "0.03", "0", "0", "0"]
    images = (tmp_path / "images.txt").read_text().splitlines()[2:]
    assert images[1::2] == ["", ""]
    assert images[2].split()[-1] == "02_my_cam.png"
    points = np.loadtxt(tmp_path / "points3D.txt")
    assert np.allclose(points[:, 1:4], out.position, rtol=1e-8)


def test_colmap_is_read_by_pycolmap(tmp_path: Path, rng: np.random.Generator) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    out = write_colmap(tmp_path, GEO)
    model = pycolmap.Reconstruction(str(tmp_path))
    assert len(model.points3D) == len(out.time_s)
    for image in model.images.values():
        camera = list(out.cameras.values())[image.image_id - 1]
        pose = image.cam_from_world()
        assert np.allclose(pose.rotation.matrix(), camera.camera_from_frame.rotation, atol=1e-12)
        assert np.allclose(pose.translation, camera.camera_from_frame.translation, atol=1e-9)
        point = np.column_stack([rng.uniform(-0.4, 0.4, (20, 2)), np.ones(20)]) * rng.uniform(5, 50, (20, 1))
        # Their pixels are half a pixel further than ours.
        theirs = model.cameras[image.camera_id].img_from_cam(point)
        assert np.allclose(theirs - 0.5, camera.intrinsics.project(point), rtol=0, atol=1e-8)


def test_quaternions_of_every_kind_of_turn(rng: np.random.Generator) -> None:
    turns = [*rng.uniform(-np.pi, np.pi, (50, 3)), *(np.pi * np.eye(3)), np.zeros(3)]
    for turn in turns:
        rotation = so3_exp(turn)
        w, x, y, z = quaternion_wxyz(rotation)
        assert w >= 0
        rebuilt = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        assert np.allclose(rebuilt, rotation, atol=1e-12)
