"""`skytrace georeference`, and known places in flight.toml: from the files of a user to degrees and metres."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from skytrace.geometry.wgs84 import enu_from_geodetic, geodetic_from_enu
from skytrace.io.georeference import read_georeference
from skytrace.io.run_folder import read_run

from .command import skytrace
from .conftest import Finished

ORIGIN = np.array([np.radians(47.1), np.radians(8.5), 412.0])


def on_earth(position_m) -> str:
    latitude, longitude, height_m = geodetic_from_enu(np.asarray(position_m), ORIGIN)
    return f"{np.degrees(latitude):.10f},{np.degrees(longitude):.10f},{height_m:.5f}"


def true_positions(flight: Path) -> dict[str, np.ndarray]:
    with open(flight / "truth" / "positions.csv", encoding="utf-8") as file:
        return {row["camera"]: np.array([float(row[k]) for k in "xyz"]) for row in csv.DictReader(file)}


def true_path(flight: Path) -> np.ndarray:
    return np.loadtxt(flight / "truth" / "trajectory.txt")


@pytest.fixture
def run(finished: Finished, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished.run, tmp_path / "run"))


def centres_off_m(run: Path, flight: Path) -> float:
    """The largest distance of a camera's centre from the truth, by the run's georeference."""
    here, true = read_georeference(run), true_positions(flight)
    assert here is not None
    centres = {c: np.array(row["centre"]) for c, row in read_run(run).cameras.items()}
    return max(float(np.linalg.norm(here.enu(centres[c]) - here_enu(here, true[c]))) for c in true)


def here_enu(here, position_m):
    return enu_from_geodetic(geodetic_from_enu(position_m, ORIGIN), here.origin)


def test_from_cameras_on_the_earth(finished, run, tmp_path):
    table = tmp_path / "cameras.csv"
    rows = [f"{c},{on_earth(p)}" for c, p in true_positions(finished.flight).items()]
    table.write_text("\n".join(["camera,lat,lon,height", *rows]) + "\n")
    result = skytrace("georeference", run, "--cameras", table, "--vertical-datum", "EGM96")
    assert result.code == 0, result.err
    assert "above EGM96" in result.out
    assert result.out.count("deviations") == 3
    assert centres_off_m(run, finished.flight) < 1.0
    exported = skytrace("export", run, "--to", "csv")
    assert "latitude_deg" in exported.out
    assert "# heights above: EGM96" in exported.out


def test_from_cameras_in_metres_of_an_origin(finished, run, tmp_path):
    table = tmp_path / "cameras.csv"
    rows = [f"{c},{p[0]},{p[1]},{p[2]},0.05" for c, p in true_positions(finished.flight).items()]
    table.write_text("\n".join(["camera,x,y,z,sigma_m", *rows]) + "\n")
    missing = skytrace("georeference", run, "--cameras", table)
    assert missing.code == 3
    assert "need --origin LAT,LON,HEIGHT" in missing.message
    result = skytrace("georeference", run, "--cameras", table, "--origin", "47.1,8.5,412", "--json")
    assert result.code == 0, result.err
    assert json.loads(result.out)["rotation_sd_deg"] < 1
    assert centres_off_m(run, finished.flight) < 1.0


def test_from_points_of_the_track(finished, run, tmp_path):
    held, truth = read_run(run), json.loads((finished.flight / "truth" / "cameras.json").read_text())
    true0, found0 = truth["cameras"][held.reference]["clock"], held.cameras[held.reference]["clock"]
    path = true_path(finished.flight)
    rows = []
    for k in (20, 60, 100, 140, 180):
        true_time_s = truth["begin_s"] + k / 5
        frame = (true_time_s - true0["offset_s"]) / true0["period_s"]
        rows.append(f"{found0['offset_s'] + frame * found0['period_s']:.6f},{on_earth(path[k])},0.3")
    table = tmp_path / "points.csv"
    header = "time_s,latitude_deg,longitude_deg,height_m,sigma_m"
    table.write_text("\n".join([header, *rows, f"9e9,{on_earth(path[0])},0.3"]) + "\n")
    result = skytrace("georeference", run, "--points", table)
    assert result.code == 0, result.err
    assert "1 of 6 points lie outside the covered time" in result.out
    assert centres_off_m(run, finished.flight) < 1.5


def test_from_a_log_on_a_clock_of_its_own(finished, run, tmp_path):
    table = tmp_path / "log.csv"
    path = true_path(finished.flight)
    rows = [f"{5000 + 0.2 * 1.0005 * k:.6f},{on_earth(p)}" for k, p in enumerate(path)]
    table.write_text("\n".join(["time_s,lat,lon,height", *rows]) + "\n")
    result = skytrace("georeference", run, "--log", table, "--json")
    assert result.code == 0, result.err
    details = json.loads(result.out)
    assert details["residual_rms_m"] < 0.5
    assert details["clock"]["rate"] == pytest.approx(1.0005, abs=2e-4)
    assert details["samples"] > 150
    held = read_run(run)
    # The log's first sample is where the flight begins.
    begin_s = (5000 - details["clock"]["offset_s"]) / details["clock"]["rate"]
    assert abs(begin_s - held.time_s[0]) < 1.5
    assert centres_off_m(run, finished.flight) < 1.0


def test_a_log_of_another_flight_is_refused(run, tmp_path):
    rng = np.random.default_rng(0)
    path = np.cumsum(rng.normal(size=(200, 3)), axis=0)
    table = tmp_path / "log.csv"
    table.write_text("time_s,x,y,z\n" + "".join(f"{0.2 * k:.3f},{x},{y},{z}\n" for k, (x, y, z) in enumerate(path)))
    result = skytrace("georeference", run, "--log", table, "--origin", "47,8,0")
    assert result.code == 3
    assert "does not match the track" in result.message
    assert not (run / "georeference.json").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "give one of --cameras, --points and --log"),
        (["--cameras", "none.csv"], "none.csv"),
        (["--cameras", "two.csv"], "expected at least 3 places of what the run holds, got 2"),
        (["--cameras", "line.csv"], "do not determine where the run lies"),
        (["--cameras", "other.csv"], "no such cameras in the run: a, b, c"),
        (["--cameras", "line.csv", "--origin", "47"], "expected latitude and longitude in degrees"),
        (["--cameras", "line.csv", "--origin", "97,8,0"], "expected latitude and longitude in degrees"),
        (["--cameras", "line.csv", "--vertical-datum", " "], "expected a name"),
    ],
)
def test_bad_input(run, tmp_path, monkeypatch, options, words):
    monkeypatch.chdir(tmp_path)
    place = "47.1,8.5,400"
    Path("two.csv").write_text(f"camera,lat,lon,height\ncam0,{place}\ncam1,47.2,8.5,400\n")
    Path("line.csv").write_text(f"camera,lat,lon,height\ncam0,{place}\ncam1,{place}\ncam2,{place}\n")
    Path("other.csv").write_text(f"camera,lat,lon,height\na,{place}\nb,{place}\nc,{place}\n")
    result = skytrace("georeference", run, *options)
    assert result.code == 3
    assert words in result.message
    assert not (run / "georeference.json").exists()


def test_a_flight_with_known_places_is_delivered_there(finished, tmp_path):
    flight = Path(shutil.copytree(finished.flight, tmp_path / "flight"))
    description = flight / "flight.toml"
    text = 'vertical_datum = "EGM96"\n' + description.read_text()
    for camera_id, position in true_positions(flight).items():
        lines = f"position_wgs84 = [{on_earth(position)}]\nposition_sigma_m = 0.05\n"
        text = text.replace(f'id = "{camera_id}"\n', f'id = "{camera_id}"\n{lines}')
    description.write_text(text)
    run = tmp_path / "run"
    result = skytrace("reconstruct", flight, "-o", run)
    assert result.code == 0, result.err
    assert "lengths      in metres" in result.out
    assert "known        position of cam0" in result.out
    held = read_run(run)
    assert (held.gauge, held.frame) == ("metric", "enu")
    assert set(held.summary["known"]["things"]) == {f"position of cam{k}" for k in range(3)}
    head = (run / "trajectory.csv").read_text().split("\n")[:3]
    assert head[1] == "# unit of length: metre"
    assert "east, north, up of latitude" in head[2]
    assert "above EGM96" in head[2]
    assert centres_off_m(run, flight) < 0.3
    assert "Lengths are in metres, and the frame is east, north, up" in (run / "report.html").read_text()
    errors = json.loads(skytrace("evaluate", run, "--flight", flight, "--json").out)["trajectory"]["all"]
    assert errors["mean"] < 0.3
    assert errors["truth_from_world"]["scale"] == pytest.approx(1, abs=0.02)
    assert skytrace("export", run, "--to", "gpx").code == 0
