"""Calibration files of three kinds, and every lens that must be refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from skytrace.errors import InputError
from skytrace.io.calibration import read_calibration, split_camera_name
from skytrace.io.calibration_writer import calibration_text
from skytrace.model.camera import Intrinsics, LensDeviation

K = [[1506.6612, 0.0, 966.6623], [0.0, 1505.2822, 530.2608], [0.0, 0.0, 1.0]]
DISTORTION = [-0.0067, 0.0078, 1e-05, -2e-4, 0.03]

YAML = """%YAML:1.0
---
calibration_time: "Tue 01 Oct 2024 10:00:00"
image_width: 1920
image_height: 1080
flags: 0
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 1.5066612e+03, 0., 9.666623e+02, 0., 1.5052822e+03,
       5.302608e+02, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -6.7e-03, 7.8e-03, 1e-05, -2.0000000000000001e-04, 3.e-02 ]
per_view: !!opencv-nd-matrix
   sizes: [ 2, 2 ]
   dt: f
   data: [ 0., 1., 2., 3. ]
avg_reprojection_error: 1.5e-01
"""

TOML = """[cam_0]
name = "left"
size = [ 1920, 1080,]
matrix = [ [ 1506.6612, 0.0, 966.6623,], [ 0.0, 1505.2822, 530.2608,], [ 0.0, 0.0, 1.0,],]
distortions = [ -0.0067, 0.0078, 1e-05, -2e-4, 0.03,]
rotation = [ 0.0, 0.0, 0.0,]
translation = [ 0.0, 0.0, 0.0,]

[cam_1]
name = "right"
size = [ 1280, 720,]
matrix = [ [ 900.0, 0.0, 640.0,], [ 0.0, 900.0, 360.0,], [ 0.0, 0.0, 1.0,],]
distortions = [ 0.0, 0.0, 0.0, 0.0,]

[cam_2]
name = "wide"
fisheye = true
size = [ 1280, 720,]
matrix = [ [ 900.0, 0.0, 640.0,], [ 0.0, 900.0, 360.0,], [ 0.0, 0.0, 1.0,],]
distortions = [ 0.0, 0.0, 0.0, 0.0,]

[metadata]
adjusted = false
"""


def mvus(folder: Path, **changes: object) -> Path:
    values = {"comment": ["K-matrix"], "K-matrix": K, "distCoeff": DISTORTION, "fps": 50, "resolution": [1920, 1080]}
    values |= {key.replace("K_matrix", "K-matrix"): value for key, value in changes.items()}
    path = folder / "lens.json"
    path.write_text(json.dumps({k: v for k, v in values.items() if v is not ...}, indent=1))
    return path


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


def refused(path: Path | str, camera_id: str | None = None) -> InputError:
    with pytest.raises(InputError) as caught:
        read_calibration(path, camera_id)
    return caught.value


def assert_is_the_lens(lens) -> None:
    assert lens.focal_px.tolist() == [1506.6612, 1505.2822]
    assert lens.principal_px.tolist() == [966.6623, 530.2608]
    assert lens.distortion.tolist() == DISTORTION
    assert lens.size_px == (1920, 1080)


def test_mvus_json(tmp_path):
    lens, rate_hz = read_calibration(mvus(tmp_path))
    assert_is_the_lens(lens)
    assert rate_hz == 50


def test_opencv_yaml(tmp_path):
    lens, rate_hz = read_calibration(write(tmp_path, "lens.yml", YAML))
    assert_is_the_lens(lens)
    assert rate_hz is None


def test_opencv_yaml_with_other_names(tmp_path):
    text = YAML.replace("camera_matrix", "K").replace("distortion_coefficients", "dist_coeffs")
    text = text.replace("image_width: 1920\nimage_height: 1080", "image_size: [1920, 1080]\nfps: 59.94")
    lens, rate_hz = read_calibration(write(tmp_path, "lens.yaml", text))
    assert_is_the_lens(lens)
    assert rate_hz == 59.94


def test_ros_camera_info(tmp_path):
    text = (
        "image_width: 1920\nimage_height: 1080\ncamera_name: left\ndistortion_model: plumb_bob\n"
        "camera_matrix:\n  rows: 3\n  cols: 3\n  data: [1506.6612, 0, 966.6623, 0, 1505.2822, 530.2608, 0, 0, 1]\n"
        "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.0067, 0.0078, 0.00001, -0.0002, 0.03]\n"
    )
    assert_is_the_lens(read_calibration(write(tmp_path, "lens.yaml", text))[0])
    fisheye = text.replace("plumb_bob", "equidistant")
    error = refused(write(tmp_path, "lens.yaml", fisheye))
    assert "4 coefficients k1 k2 k3 k4 of a fisheye" in error.message
    assert error.line == 9
    four = fisheye.replace("cols: 5", "cols: 4").replace(", 0.03]", "]")
    lens, _ = read_calibration(write(tmp_path, "lens.yaml", four))
    assert (lens.model, lens.distortion.tolist()) == ("fisheye", DISTORTION[:4])
    error = refused(write(tmp_path, "lens.yaml", text.replace("plumb_bob", "omnidirectional")))
    assert "'omnidirectional' is not supported" in error.message
    assert error.line == 4


@pytest.mark.parametrize("choice", ["left", "cam_0"])
def test_aniposelib_toml_by_name(tmp_path, choice):
    path = write(tmp_path, "rig.toml", TOML)
    assert_is_the_lens(read_calibration(path, choice)[0])
    assert_is_the_lens(read_calibration(f"{path}#{choice}", "whatever")[0])
    assert read_calibration(path, "right")[0].distortion.tolist() == [0] * 5


def test_aniposelib_toml_with_one_camera_needs_no_name(tmp_path):
    path = write(tmp_path, "rig.toml", TOML[: TOML.index("[cam_1]")] + "fps = 25\n")
    lens, rate_hz = read_calibration(path, "phone")
    assert_is_the_lens(lens)
    assert rate_hz == 25
    assert "no camera named 'phone'" in refused(f"{path}#phone").message


def test_a_name_goes_before_another_cameras_table_key(tmp_path):
    text = TOML.replace('"left"', '"cam_1"').replace('"right"', '"cam_0"')
    assert_is_the_lens(read_calibration(write(tmp_path, "rig.toml", text), "cam_1")[0])


@pytest.mark.parametrize(
    ("choice", "words", "line"),
    [
        (None, "several cameras; choose one", None),
        ("phone", "no camera named 'phone'", None),
    ],
)
def test_aniposelib_toml_refused(tmp_path, choice, words, line):
    path = write(tmp_path, "rig.toml", TOML)
    error = refused(path, choice)
    assert words in error.message
    assert error.line == line


def test_aniposelib_toml_with_a_fisheye(tmp_path):
    lens, _ = read_calibration(write(tmp_path, "rig.toml", TOML), "wide")
    assert (lens.model, lens.distortion.tolist()) == ("fisheye", [0.0] * 4)


def test_aniposelib_toml_names_the_line_in_the_right_table(tmp_path):
    error = refused(write(tmp_path, "rig.toml", TOML.replace("[ 1280, 720,]", "[ 1280, 0,]", 1)), "right")
    assert error.line == 11
    assert "size" in error.message


def test_aniposelib_toml_with_two_cameras_of_one_name(tmp_path):
    error = refused(write(tmp_path, "rig.toml", TOML.replace('"right"', '"left"')), "left")
    assert "2 cameras are named 'left'" in error.message


@pytest.mark.parametrize(
    "coefficients", [DISTORTION[:4], [*DISTORTION, 0, 0, 0], [DISTORTION], [[c] for c in DISTORTION]]
)
def test_distortion_lengths_and_shapes(tmp_path, coefficients):
    lens, _ = read_calibration(mvus(tmp_path, distCoeff=coefficients))
    flat = np.ravel(coefficients)
    assert lens.distortion.tolist() == [*flat[:4], 0 if len(flat) == 4 else flat[4]]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"K_matrix": ...}, "K-matrix: missing"),
        ({"K_matrix": K[:2]}, "3x3"),
        ({"K_matrix": [1506, 0, 966, 0, 1506, 530, 0, 0, 1]}, "3x3"),
        ({"K_matrix": [K[0], K[1], [0, 0]]}, "K-matrix: expected the 3x3"),
        ({"K_matrix": "K"}, "K-matrix: expected the 3x3"),
        ({"K_matrix": [*K[:2], [0, 0, 2]]}, "last row"),
        ({"K_matrix": np.array(K).T.tolist()}, "transposed"),
        ({"K_matrix": [[1506.0, 2.0, 966.0], *K[1:]]}, "skew"),
        ({"K_matrix": [K[0], [0.5, 1505.0, 530.0], K[2]]}, "skew"),
        ({"K_matrix": [[-1506.0, 0, 966.0], *K[1:]]}, "positive focal"),
        ({"K_matrix": [[float("nan"), 0, 966.0], *K[1:]]}, "not finite"),
        ({"K_matrix": [[1.5, 0, 966.0], [0, 1.5, 530], K[2]]}, "are they in pixels"),
        ({"K_matrix": [[50000.0, 0, 966.0], *K[1:]]}, "do not fit"),
        ({"K_matrix": [[1506.0, 0, 9660.0], *K[1:]]}, "principal point"),
        ({"K_matrix": [K[0], [0, 1505.0, -600.0], K[2]]}, "principal point"),
        ({"distCoeff": ...}, "distCoeff: missing"),
        ({"distCoeff": DISTORTION[:3]}, "expected 4 or 5 coefficients"),
        ({"distCoeff": [*DISTORTION, 0.1, 0, 0]}, "rational"),
        ({"distCoeff": [*DISTORTION, *[0] * 8, 0.1]}, "rational"),
        ({"distCoeff": [0, 0, None, 0]}, "not finite"),
        ({"resolution": ...}, "resolution: missing"),
        ({"resolution": [1920]}, "width and height"),
        ({"resolution": [1920, 0]}, "width and height"),
        ({"resolution": [1920.5, 1080]}, "width and height"),
        ({"fps": 0}, "frame rate"),
        ({"fps": -25}, "frame rate"),
        ({"fps": [25]}, "frame rate"),
        ({"fps": "fast"}, "frame rate"),
    ],
)
def test_bad_lenses(tmp_path, changes, words):
    path = mvus(tmp_path, **changes)
    error = refused(path)
    assert words in error.message
    key = next(iter(changes)).replace("K_matrix", "K-matrix")
    lines = path.read_text().split("\n")
    if changes[next(iter(changes))] is ...:
        assert error.line is None
    else:
        assert error.line is not None
        assert f'"{key}":' in lines[error.line - 1]


def test_frame_rate_may_be_missing(tmp_path):
    assert read_calibration(mvus(tmp_path, fps=...))[1] is None


@pytest.mark.parametrize(
    ("name", "text", "line", "words"),
    [
        ("lens.json", '{\n"fps": 50,\n}', 3, "not valid JSON"),
        ("lens.json", "[1, 2]", None, "JSON object"),
        ("lens.json", "", 1, "not valid JSON"),
        ("lens.yml", YAML.replace("cols: 3", "cols: 4"), 7, "expected 12 numbers, got 9"),
        ("lens.yml", YAML.replace("   rows: 3\n", ""), 7, "rows, cols and data"),
        ("lens.yml", YAML.replace("camera_matrix", "lens"), None, "camera_matrix: missing"),
        ("lens.yml", YAML.replace("image_height: 1080\n", ""), None, "image_width and image_height: missing"),
        ("lens.yml", YAML.replace("flags: 0", "fisheye_model: 1"), 13, "k1 k2 k3 k4 of a fisheye"),
        ("lens.yml", YAML.replace("flags: 0", "flags: [0"), 7, "not valid YAML"),
        ("lens.yml", YAML.replace("flags: 0", "flags: !!python/object:os.system x"), 6, "not valid YAML"),
        ("lens.yml", "- 1\n- 2\n", None, "YAML mapping"),
        ("rig.toml", "[cam_0]\nsize = [1, 2\n[cam_1]\n", 3, "not valid TOML"),
        ("rig.toml", "[metadata]\nadjusted = true\n", None, "no camera"),
        ("lens.xml", "<opencv_storage/>", None, "unknown kind of calibration '.xml'"),
        ("lens", "1 2 3", None, "unknown kind of calibration ''"),
    ],
)
def test_bad_files(tmp_path, name, text, line, words):
    error = refused(write(tmp_path, name, text))
    assert words in error.message
    assert error.line == line


def test_missing_file_and_a_name_where_there_is_one_camera(tmp_path):
    assert "does not exist" in refused(tmp_path / "none.json").message
    assert "one camera" in refused(f"{mvus(tmp_path)}#left").message
    assert "one camera" in refused(f"{write(tmp_path, 'l.yml', YAML)}#left").message


def test_a_hash_in_a_file_name_is_no_choice_of_camera(tmp_path):
    path = write(tmp_path, "rig#2.toml", TOML)
    assert split_camera_name(path) == (path, None)
    assert split_camera_name(f"{path}#left") == (path, "left")
    assert_is_the_lens(read_calibration(f"{path}#left")[0])


FISHEYE = Intrinsics(
    [871.8, 890.1],
    [973.2, 535.0],
    [-0.034, 0.1, -0.03, 0.002],
    (1920, 1080),
    "fisheye",
    LensDeviation(0.002, 0.0005, np.array([0.6, 0.3]), np.array([0.001, 0.002, 0.003, 0.004])),
)
PINHOLE = Intrinsics([1506.0, 1505.0], [966.0, 530.0], DISTORTION, (1920, 1080))


@pytest.mark.parametrize("lens", [PINHOLE, FISHEYE])
@pytest.mark.parametrize("rate_hz", [None, 29.97])
def test_what_is_written_is_read_back(tmp_path, lens, rate_hz):
    path = write(tmp_path, "lens.json", calibration_text(lens, rate_hz, {"calibration": {"rms_px": 0.2}}))
    found, found_rate_hz = read_calibration(path)
    assert found_rate_hz == rate_hz
    assert (found.model, found.size_px) == (lens.model, lens.size_px)
    for name in ("focal_px", "principal_px", "distortion"):
        assert getattr(found, name).tolist() == getattr(lens, name).tolist()
    if lens.deviation is None:
        assert found.deviation is None
    else:
        assert (found.deviation.focal, found.deviation.aspect) == (lens.deviation.focal, lens.deviation.aspect)
        assert found.deviation.principal_px.tolist() == lens.deviation.principal_px.tolist()
        assert found.deviation.distortion.tolist() == lens.deviation.distortion.tolist()


GOOD_DEVIATION = {"focal": 0.01, "aspect": 0.001, "principal_px": [1.0, 2.0], "distortion": [0.1] * 5}


@pytest.mark.parametrize(
    "wrong",
    [
        "small",
        {**GOOD_DEVIATION, "focal": None},
        {**GOOD_DEVIATION, "focal": -0.01},
        {**GOOD_DEVIATION, "principal_px": [1.0]},
        {**GOOD_DEVIATION, "distortion": [0.1] * 4},
        {**GOOD_DEVIATION, "aspect": "no"},
    ],
)
def test_bad_deviations(tmp_path, wrong):
    assert read_calibration(mvus(tmp_path, deviation=GOOD_DEVIATION))[0].deviation.focal == 0.01
    path = mvus(tmp_path, deviation=wrong)
    error = refused(path)
    assert "deviation" in error.message
    assert "focal, aspect, principal_px (2) and distortion (5)" in error.message
    assert error.line is not None
