"""RUN folders: their formats, their way there and back, and a writer killed between any two files."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skytrace.errors import InputError
from skytrace.geometry.rigid import Rigid, so3_exp
from skytrace.io.run_folder import COLUMNS, input_hashes, read_run, supporting_cameras, trajectory_csv, write_run
from skytrace.model.camera import Clock, Intrinsics
from skytrace.model.reconstruction import CameraEstimate, ClockDeviation, Gauge, Reconstruction, Residuals
from skytrace.model.trajectory import Segment, Trajectory

FILES = ["trajectory.csv", "cameras.json", "summary.json", "config.toml", "report.html", "manifest.json"]


def camera(rng: np.random.Generator, seen_s: np.ndarray, inlier: np.ndarray) -> CameraEstimate:
    n = len(seen_s)
    return CameraEstimate(
        camera_from_world=Rigid(so3_exp(rng.normal(0, 1, 3)), rng.normal(0, 10, 3)),
        clock=Clock(rng.normal(0, 100), 1 / 29.97, 0.0167, 720),
        calibrated=Intrinsics(np.array([900.0, 901]), np.array([640.0, 360]), np.zeros(5), (1280, 720)),
        refined=Intrinsics(np.array([910.0, 911]), np.array([640.0, 360]), rng.normal(0, 0.1, 5), (1280, 720)),
        residuals=Residuals(np.arange(n), seen_s, rng.uniform(0, 700, (n, 2)), rng.normal(0, 1, (n, 2)), inlier),
        sigma_px=0.5,
        clock_deviation=ClockDeviation(0.001, 1e-6, 0.0),
        centre_covariance=np.diag([0.1, 0.2, 0.3]) ** 2,
    )


def reconstruction(gauge: Gauge = "arbitrary", sigma: bool = True) -> Reconstruction:
    rng = np.random.default_rng(3)
    segments = tuple(
        Segment(begin, 0.2, np.cumsum(rng.normal(0, 0.5, (30, 3)), axis=0), begin + 0.11, begin + 5.013, knot_sigma)
        for begin, knot_sigma in ((-3.0, rng.uniform(0.01, 1, 28) if sigma else None), (1234.5, None))
    )
    seen_s = np.linspace(-3, 2, 100)
    return Reconstruction(
        reference="b",
        cameras={"b": camera(rng, seen_s, seen_s > -1), "a": camera(rng, seen_s, np.ones(100, bool))},
        trajectory=Trajectory(segments),
        gauge=gauge,
        unregistered={"aa": "too few inliers: 3 (needed: 12)"},
    )


def write(destination: Path, result: Reconstruction, report: str | None = "<html>ä</html>") -> None:
    summary = {"covered_s": np.float64(9.8), "worst": float("nan"), "counts": {"a": np.int64(3)}, "rms": np.ones(2)}
    write_run(destination, result, summary, 'name = "x"\n', {"seed": 1, "version": "0.1.0"}, report)


def test_the_files(tmp_path):
    write(tmp_path / "run", reconstruction())
    assert sorted(p.name for p in (tmp_path / "run").iterdir()) == sorted(FILES)
    write(tmp_path / "run", reconstruction(), report=None)
    assert not (tmp_path / "run" / "report.html").exists()
    assert (tmp_path / "run" / "config.toml").read_text() == 'name = "x"\n'


def test_the_trajectory_is_read_back(tmp_path):
    result = reconstruction()
    write(tmp_path / "run", result)
    run = read_run(tmp_path / "run")
    t = result.trajectory.sample_times(50.0)
    assert len(t) == len(run.time_s)
    assert np.diff(run.time_s[run.segment == 0]).max() < 1 / 25
    for got, expected in (
        (run.time_s, t),
        (run.position, result.trajectory.position(t)),
        (run.velocity, result.trajectory.velocity(t)),
        (run.sigma, result.trajectory.sigma(t)),
    ):
        np.testing.assert_allclose(got, expected, rtol=1e-9, atol=0)
    assert (run.segment == result.trajectory.segment_index(t)).all()
    assert (run.n_cameras == supporting_cameras(result, t)).all()
    assert set(run.n_cameras[run.segment == 0]) >= {1, 2}
    assert set(run.n_cameras[run.segment == 1]) == {0}
    assert np.isnan(run.sigma[run.segment == 1]).all()
    assert (run.gauge, run.reference) == ("arbitrary", "b")


@pytest.mark.parametrize(("gauge", "unit"), [("arbitrary", "unit of length: arbitrary"), ("metric", "metre")])
def test_comments_state_gauge_unit_and_frame(gauge, unit):
    lines = trajectory_csv(reconstruction(gauge)).split("\n")
    comments = [line for line in lines if line.startswith("# ")]
    assert lines[len(comments)] == "time_s,x,y,z,vx,vy,vz,sigma,n_cameras,segment" == ",".join(COLUMNS)
    assert comments[0] == f"# gauge: {gauge}"
    assert unit in comments[1]
    assert comments[2].startswith("# frame: ")
    assert "clock of camera b" in comments[3]


def test_cameras_json(tmp_path):
    result = reconstruction()
    write(tmp_path / "run", result)
    table = json.loads((tmp_path / "run" / "cameras.json").read_text(), parse_constant=pytest.fail)
    assert table["reference"] == "b"
    assert list(table["cameras"]) == ["a", "aa", "b"]
    assert table["cameras"]["aa"] == {"registered": False, "reason": "too few inliers: 3 (needed: 12)"}
    got, expected = table["cameras"]["b"], result.cameras["b"]
    assert got["registered"] is True
    assert got["clock"] == {"offset_s": expected.clock.offset_s, "period_s": 1 / 29.97, "readout_s": 0.0167}
    assert got["clock_sd"] == {"offset_s": 0.001, "period_s": 1e-6, "readout_s": 0.0}
    assert got["rotation_camera_from_world"] == expected.camera_from_world.rotation.tolist()
    assert got["centre"] == expected.camera_from_world.centre.tolist()
    assert got["centre_sd"] == [0.1, 0.2, 0.3]
    assert got["focal_px_calibrated"] == [900, 901]
    assert got["focal_px_refined"] == [910, 911]
    assert got["distortion"] == expected.refined.distortion.tolist()
    assert got["size_px"] == [1280, 720]
    assert got["reprojection_median_px"] == expected.residuals.median_px
    assert got["n_used"] == 100
    assert read_run(tmp_path / "run").cameras == table["cameras"]


def test_json_has_null_for_what_is_not_finite(tmp_path):
    write(tmp_path / "run", reconstruction())
    text = (tmp_path / "run" / "summary.json").read_text()
    values = json.loads(text, parse_constant=pytest.fail)
    assert values == {"covered_s": 9.8, "worst": None, "counts": {"a": 3}, "rms": [1, 1]}
    manifest = read_run(tmp_path / "run").manifest
    assert manifest == {"seed": 1, "version": "0.1.0", "format": "skytrace run 1"}


def test_a_camera_without_residuals_has_no_median(tmp_path):
    result = reconstruction()
    empty = camera(np.random.default_rng(0), np.zeros(0), np.zeros(0, bool))
    write(tmp_path / "run", Reconstruction("a", {"a": empty}, result.trajectory))
    got = read_run(tmp_path / "run").cameras["a"]
    assert got["reprojection_median_px"] is None
    assert got["n_used"] == 0


def test_an_empty_trajectory(tmp_path):
    result = reconstruction()
    write(tmp_path / "run", Reconstruction("b", result.cameras, Trajectory(())))
    run = read_run(tmp_path / "run")
    assert run.time_s.shape == (0,)
    assert run.position.shape == (0, 3)


def test_the_same_result_gives_the_same_bytes(tmp_path):
    for name in "ab":
        write(tmp_path / name, reconstruction())
    for name in FILES:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


@given(
    seen=st.lists(st.lists(st.tuples(st.floats(-5, 5), st.booleans()), max_size=8), min_size=1, max_size=3),
    time_s=st.lists(st.floats(-6, 6), max_size=10),
)
def test_supporting_cameras_by_hand(seen, time_s):
    rng = np.random.default_rng(0)
    cameras = {
        str(k): camera(rng, np.array([s for s, _ in one]), np.array([inlier for _, inlier in one], bool))
        for k, one in enumerate(seen)
    }
    result = Reconstruction("0", cameras, Trajectory(()))
    expected = [sum(any(ok and t - 0.25 <= s <= t + 0.25 for s, ok in one) for one in seen) for t in time_s]
    assert supporting_cameras(result, np.array(time_s)).tolist() == expected


def test_support_reaches_a_quarter_of_a_second_both_ways():
    seen = camera(np.random.default_rng(0), np.array([1.0]), np.ones(1, bool))
    time_s = np.array([0.74, 0.75, 1.0, 1.25, 1.26])
    assert supporting_cameras(Reconstruction("a", {"a": seen}, Trajectory(())), time_s).tolist() == [0, 1, 1, 1, 0]


def test_input_hashes(tmp_path):
    (tmp_path / "x").write_bytes(b"abc")
    assert input_hashes([tmp_path / "x"]) == {str(tmp_path / "x"): hashlib.sha256(b"abc").hexdigest()}


@pytest.mark.parametrize(
    ("name", "text", "line", "words"),
    [
        ("manifest.json", "{}", None, "not a finished run"),
        ("manifest.json", None, None, "not a finished run"),
        ("cameras.json", None, None, "does not exist"),
        ("cameras.json", "{", 1, "not valid JSON"),
        ("cameras.json", "{}", None, "reference, gauge and cameras"),
        ("summary.json", "[]", None, "JSON object"),
        ("trajectory.csv", None, None, "does not exist"),
        ("trajectory.csv", "# c\nt,x\n1,2\n", 2, "expected the header time_s,x"),
        ("trajectory.csv", ",".join(COLUMNS) + "\n1,2,3,4,5,6,7,8,1\n", 2, "10 columns"),
        ("trajectory.csv", ",".join(COLUMNS) + "\n1,2,3,4,5,6,7,nan,1,0\n1,nan,3,4,5,6,7,8,1,0\n", 3, "finite"),
    ],
)
def test_runs_that_cannot_be_read(tmp_path, name, text, line, words):
    write(tmp_path / "run", reconstruction())
    path = tmp_path / "run" / name
    path.unlink()
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_run(tmp_path / "run")
    assert words in caught.value.message
    assert caught.value.line == line


def test_no_run_there(tmp_path):
    with pytest.raises(InputError, match="no such run"):
        read_run(tmp_path / "none")


KILLED = """
import os, pickle, signal, sys
from skytrace.io import run_folder
countdown, write = int(sys.argv[3]), run_folder._write
def write_or_die(path, text):
    global countdown
    if countdown == 0:
        path.write_text(text[: len(text) // 2])
        os.kill(os.getpid(), signal.SIGKILL)
    countdown -= 1
    write(path, text)
run_folder._write = write_or_die
sys.path.insert(0, sys.argv[4])
from test_io_run_folder import reconstruction
run_folder.write_run(sys.argv[1], reconstruction("metric"), {}, "", {}, "<html></html>")
"""


@pytest.mark.parametrize("n_files", range(len(FILES)))
def test_a_writer_killed_between_files(tmp_path, n_files):
    """Killed half-way through each file in turn, over an earlier run and over nothing."""
    old, absent = tmp_path / "old", tmp_path / "absent"
    write(old, reconstruction())
    before = {path.name: path.read_bytes() for path in old.iterdir()}
    for destination in (old, absent) if n_files in (0, len(FILES) - 1) else (old,):
        arguments = [str(destination), "-", str(n_files), str(Path(__file__).parent)]
        command = [sys.executable, "-c", KILLED, *arguments]
        process = subprocess.run(command, check=False, capture_output=True, timeout=60)
        assert process.returncode == -9, process.stderr.decode()
    assert {path.name: path.read_bytes() for path in old.iterdir()} == before
    assert read_run(old).gauge == "arbitrary"
    assert not absent.exists()
    write(old, reconstruction("metric"))
    assert read_run(old).gauge == "metric"
    assert not list(tmp_path.glob(".old*"))
