"""Calibration files of DSEC, Kalibr, ROS and OpenCV, and damaged ones."""

import json
import os
from contextlib import suppress

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from nvsdata import CameraModel, FormatError, read_camera

TURN = cv2.Rodrigues(np.array([0.02, -0.03, 0.01]))[0].round(9).tolist()
TURN_3 = cv2.Rodrigues(np.array([-0.01, 0.02, 0.03]))[0].round(9).tolist()


def dsec_camera(fx, size, coefficients=(-0.09, 0.13, -1e-4, 5e-4)):
    return {
        "camera_matrix": [fx, fx + 1, 342.5, 215.25],
        "camera_model": "pinhole",
        "distortion_coeffs": list(coefficients),
        "distortion_model": "radtan",
        "resolution": list(size),
    }


def rectified(fx, size):
    return {"camera_matrix": [fx, fx, 335.0, 220.0], "camera_model": "pinhole", "resolution": list(size)}


DSEC = {
    "disparity_to_depth": {"cams_03": [[1.0, 0, 0, 0]] * 4},
    "extrinsics": {
        "R_rect0": TURN,
        "R_rect1": TURN,
        "R_rect3": TURN_3,
        "T_10": [[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
    },
    "intrinsics": {
        "cam0": dsec_camera(555.6, (640, 480)),
        "cam1": dsec_camera(1150.0, (1440, 1080)),
        "cam3": dsec_camera(553.0, (640, 480)),
        "camRect0": rectified(570.0, (640, 480)),
        "camRect1": rectified(1160.0, (1440, 1080)),
        "camRect3": rectified(571.0, (640, 480)),
    },
}
KALIBR = """\
cam0:
  cam_overlaps: []
  camera_model: pinhole
  distortion_coeffs: [-0.04, 0.01, -0.009, 1.5e-05]
  distortion_model: equidistant
  intrinsics: [226.38, 226.15, 173.65, 133.73]
  resolution: [346, 260]
  rostopic: /davis/left/image_raw
cam1:
  T_cn_cnm1:
  - [0.9999, 0.003, -0.008, -0.09]
  - [-0.003, 0.9999, -0.002, 0.0]
  - [0.008, 0.002, 0.9999, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [-0.3, 0.1, 1e-04, -2e-04]
  distortion_model: radtan
  intrinsics: [226.0, 225.7, 174.8, 124.2]
  resolution: [346, 260]
cam2:
  camera_model: omni
  distortion_coeffs: [-0.3, 0.1, 0.0, 0.0]
  distortion_model: radtan
  intrinsics: [0.8, 226.0, 225.7, 174.8, 124.2]
  resolution: [346, 260]
cam3:
  camera_model: pinhole
  distortion_coeffs: [0.9]
  distortion_model: fov
  intrinsics: [226.0, 225.7, 174.8, 124.2]
  resolution: [346, 260]
cam4:
  camera_model: pinhole
  distortion_coeffs: []
  distortion_model: none
  intrinsics: [226.0, 225.7, 174.8, 124.2]
  resolution: [346, 260]
"""
ROS = """\
image_width: 346
image_height: 260
camera_name: DAVIS-00000254
camera_matrix:
  rows: 3
  cols: 3
  data: [248.1, 0.0, 180.6, 0.0, 247.7, 128.0, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.358, 0.115, -0.0004, -0.0005, 0.0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
projection_matrix:
  rows: 3
  cols: 4
  data: [196.4, 0.0, 184.5, 0.0, 0.0, 211.6, 129.9, 0.0, 0.0, 0.0, 1.0, 0.0]
"""
MATRIX = np.array([[200.123456789, 0, 120.5], [0, 201.5, 89.25], [0, 0, 1]])
COEFFICIENTS = np.array([[-0.3, 0.1, 1e-5, -2e-3, 0.05]])


def written(tmp_path, content, name="camera.yaml"):
    path = tmp_path / name
    path.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
    return path


def test_dsec(tmp_path):
    path = written(tmp_path, DSEC, "cam_to_cam.yaml")
    found = read_camera(path, "cam3")
    size, coefficients = (640, 480), (-0.09, 0.13, -1e-4, 5e-4)
    rows, new = tuple(map(tuple, TURN_3)), (571.0, 571.0, 335.0, 220.0)
    assert found == CameraModel(size, (553.0, 554.0, 342.5, 215.25), coefficients, "radtan", rows, new)
    with pytest.raises(FormatError, match=r"cam_to_cam.yaml: has several cameras: .* of cam0, cam1, cam3$"):
        read_camera(path)
    with pytest.raises(FormatError, match="has no camera 'camRect0'; it has cam0, cam1, cam3"):
        read_camera(path, "camRect0")
    as_json = written(tmp_path, json.dumps(DSEC), "cam_to_cam.json")
    assert read_camera(as_json, "cam3") == found


def test_rectified_positions_of_dsec_are_those_of_opencv(tmp_path):
    camera = read_camera(written(tmp_path, DSEC), "cam0")
    matrix = np.array([[555.6, 0, 342.5], [0, 556.6, 215.25], [0, 0, 1]])
    new = np.array([[570.0, 0, 335], [0, 570, 220], [0, 0, 1]])
    columns, rows = cv2.initUndistortRectifyMap(
        matrix, np.array(camera.distortion), np.array(TURN), new, (640, 480), cv2.CV_32FC1
    )
    y, x = np.mgrid[:480, :640]
    u, v = camera.distorted(x.ravel(), y.ravel())
    np.testing.assert_allclose((u, v), (columns.ravel(), rows.ravel()), atol=1e-3)


def test_kalibr(tmp_path):
    path = written(tmp_path, KALIBR)
    intrinsics, coefficients = (226.38, 226.15, 173.65, 133.73), (-0.04, 0.01, -0.009, 1.5e-05)
    assert read_camera(path, "cam0") == CameraModel((346, 260), intrinsics, coefficients, "equidistant")
    # YAML takes 1e-04 for text
    assert read_camera(path, "cam1").distortion == (-0.3, 0.1, 1e-4, -2e-4)
    assert read_camera(path, "cam4") == CameraModel((346, 260), (226.0, 225.7, 174.8, 124.2))
    with pytest.raises(FormatError, match="cam2: camera_model 'omni' isn't supported; supported is 'pinhole'"):
        read_camera(path, "cam2")
    with pytest.raises(FormatError, match="cam3: distortion_model 'fov' isn't supported; supported are none, radtan"):
        read_camera(path, "cam3")


def test_the_matrices_that_mvsec_adds(tmp_path):
    chain = yaml.safe_load(KALIBR)
    new = {"projection_matrix": [[199.0, 0, 177.4, -19.9], [0, 199.5, 126.8, 0], [0, 0, 1, 0]]}
    path = written(tmp_path, {"cam0": chain["cam0"] | new | {"rectification_matrix": TURN}})
    found = read_camera(path)
    assert found.rectification == tuple(map(tuple, TURN))
    assert found.new_intrinsics == (199.0, 199.5, 177.4, 126.8)


def test_ros(tmp_path):
    path = written(tmp_path, ROS)
    found = read_camera(path)
    assert found == read_camera(path, "DAVIS-00000254")
    assert found.sensor_size == (346, 260)
    assert found.intrinsics == (248.1, 247.7, 180.6, 128.0)
    assert found.distortion == (-0.358, 0.115, -0.0004, -0.0005, 0.0)
    assert found.new_intrinsics == (196.4, 211.6, 184.5, 129.9)


@pytest.mark.parametrize("suffix", ["yml", "yaml", "xml", "json"])
@pytest.mark.parametrize("fisheye", [False, True])
def test_what_opencv_writes(tmp_path, suffix, fisheye):
    path = tmp_path / f"camera.{suffix}"
    coefficients = COEFFICIENTS[:, :4] if fisheye else COEFFICIENTS
    storage = cv2.FileStorage(os.fspath(path), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "Sat 28 Nov 2026")
    storage.write("image_width", 240)
    storage.write("image_height", 180)
    if fisheye:
        storage.write("fisheye_model", 1)
    storage.write("camera_matrix", MATRIX)
    storage.write("distortion_coefficients", coefficients)
    storage.write("image_points", np.arange(24, dtype=np.float32).reshape(2, 6, 2))
    storage.release()
    model = "equidistant" if fisheye else "radtan"
    intrinsics = (200.123456789, 201.5, 120.5, 89.25)
    assert read_camera(path) == CameraModel((240, 180), intrinsics, tuple(coefficients[0]), model)


def without(content, *names):
    """A copy of a DSEC file without an entry."""
    found = json.loads(json.dumps(content))
    inner = found
    for name in names[:-1]:
        inner = inner[name]
    del inner[names[-1]]
    return found


def with_value(value, *names):
    found = json.loads(json.dumps(DSEC))
    inner = found
    for name in names[:-1]:
        inner = inner[name]
    inner[names[-1]] = value
    return found


CAM0 = "intrinsics", "cam0"
DAMAGED = [
    (without(DSEC, *CAM0, "camera_matrix"), "cam0: 'camera_matrix' is missing"),
    (without(DSEC, *CAM0, "distortion_coeffs"), "cam0: 'distortion_coeffs' is missing"),
    (without(DSEC, *CAM0, "resolution"), "cam0: 'resolution' is missing"),
    (without(DSEC, "extrinsics"), "cam0: 'extrinsics' is missing"),
    (without(DSEC, "extrinsics", "R_rect0"), "cam0: 'R_rect0' is missing"),
    (with_value([1, 2, 3], *CAM0, "camera_matrix"), "cam0: camera_matrix must be 4 numbers, not 3"),
    (with_value([1, 2, 3], *CAM0, "distortion_coeffs"), "cam0: radtan has 0 or 4 or 5"),
    (with_value(list(range(30)), *CAM0, "distortion_coeffs"), "cam0: a list has more than 16 numbers"),
    (with_value([0.0, 1.0, 1.0, 1.0], *CAM0, "camera_matrix"), "cam0: focal lengths in intrinsics must be positive"),
    (with_value([1.0, 1.0, float("nan"), 1.0], *CAM0, "camera_matrix"), "cam0: intrinsics must be finite numbers"),
    (with_value([float("inf")] * 4, *CAM0, "distortion_coeffs"), "cam0: distortion must be finite numbers"),
    (with_value([640.5, 480], *CAM0, "resolution"), "cam0: the resolution must be a width and a height"),
    (with_value([640], *CAM0, "resolution"), "cam0: the resolution must be a width and a height"),
    (with_value([1e400, 480], *CAM0, "resolution"), "cam0: the resolution must be a width and a height"),
    (with_value("abc", *CAM0, "camera_matrix"), "cam0: could not convert"),
    (with_value([True] * 4, *CAM0, "camera_matrix"), "cam0: a number is expected, not bool"),
    (with_value({"a": 1}, *CAM0, "camera_matrix"), "cam0: 'data' is missing"),
    (with_value([[[1]]] * 4, *CAM0, "camera_matrix"), "cam0: a number is expected, not list"),
    (with_value([1], *CAM0, "distortion_model"), "cam0: distortion_model must be a name, not list"),
    (with_value(5, *CAM0), "cam0: cam0 must have named values, not be of type int"),
    (with_value(5, "intrinsics", "camRect0"), "cam0: camRect must have named values, not be of type int"),
    (
        with_value([320, 240], "intrinsics", "camRect0", "resolution"),
        "cam0: the rectified camera has another resolution",
    ),
    (with_value([[0.0] * 3] * 3, "extrinsics", "R_rect0"), "cam0: rectification must be a rotation"),
    (
        with_value([[1.0, 0], [0, 1]], "extrinsics", "R_rect0"),
        "cam0: R_rect0 must be 3 rows of 3 numbers, not 4 numbers",
    ),
]


@pytest.mark.parametrize(("content", "message"), DAMAGED, ids=[message[:60] for _, message in DAMAGED])
def test_damaged_values_are_named(tmp_path, content, message):
    path = written(tmp_path, content, "cam_to_cam.yaml")
    with pytest.raises(FormatError, match="cam_to_cam.yaml: " + message) as caught:
        read_camera(path, "cam0")
    assert "\n" not in str(caught.value)
    assert os.fspath(path) == caught.value.path


OTHER = [
    ("", "is not a calibration file"),
    ("- 1\n- 2\n", "is not a calibration file: it has no names"),
    ("a: 1\n", "has no camera in the layout of DSEC, Kalibr, ROS or OpenCV"),
    ("intrinsics: {}\n", "has no camera in the layout"),
    ("a: [1, 2\n", "is not a valid calibration file"),
    ("{", "is not a valid calibration file"),
    ("<a>", "is not a valid calibration file"),
    ("<!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>", "it defines entities"),
    ("a: !!python/object/apply:os.getcwd []\n", "could not determine a constructor"),
    ("a: &a {b: 1}\nc: {<<: *a}\n", "is not a valid calibration file"),
    ("a: !!bool 5\n", "is not a valid calibration file"),
    ("a: !!timestamp x\n", "is not a valid calibration file"),
    ("[" * 20_000, "is not a valid calibration file"),
    ("{" + '"a":{' * 20_000, "is not a valid calibration file"),
    ("<a>" * 20_000 + "</a>" * 20_000, "is not a valid calibration file"),
    ("a" * (1 << 20) + "a", "has more than 1 MiB"),
    (ROS.replace("[248.1, 0.0,", "[248.1, 0.5,"), r"camera_matrix must be \[\[fx, 0, cx\]"),
    (ROS.replace("0.0, 1.0]\ndis", "0.0, 2.0]\ndis"), r"camera_matrix must be \[\[fx, 0, cx\]"),
    (ROS.replace("image_width: 346\n", ""), "'image_width' is missing"),
    (ROS.replace("image_width: 346", "image_width: 0"), "sensor_size must be"),
    (ROS.replace("plumb_bob", "thin_prism"), "distortion_model 'thin_prism' isn't supported"),
]


@pytest.mark.parametrize(("content", "message"), OTHER, ids=[message[:60] for _, message in OTHER])
def test_other_files_are_refused(tmp_path, content, message):
    path = written(tmp_path, content)
    with pytest.raises(FormatError, match="camera.yaml: .*" + message) as caught:
        read_camera(path)
    assert "\n" not in str(caught.value)


def test_references_that_multiply_are_not_followed(tmp_path):
    lines = ["l0: &l0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"l{n}: &l{n} [{', '.join([f'*l{n - 1}'] * 10)}]" for n in range(1, 30)]
    entry = "cam0: {camera_model: pinhole, intrinsics: *l29, distortion_model: none, resolution: *l29}"
    with pytest.raises(FormatError, match="cam0: a number is expected, not list"):
        read_camera(written(tmp_path, "\n".join([*lines, entry])))


def test_what_is_no_file_is_refused(tmp_path):
    with pytest.raises(FormatError, match="is not a file"):
        read_camera(tmp_path)
    with pytest.raises(FileNotFoundError):
        read_camera(tmp_path / "none.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"a: \xff")
    with pytest.raises(FormatError, match=r"binary\.yaml: byte 3: is not text"):
        read_camera(tmp_path / "binary.yaml")
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe")
        with pytest.raises(FormatError, match="is not a file"):
            read_camera(tmp_path / "pipe")


@given(data=st.data())
@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_changed_bytes_give_a_camera_or_a_format_error(tmp_path, data):
    content = bytearray(data.draw(st.sampled_from([yaml.safe_dump(DSEC), KALIBR, ROS, json.dumps(DSEC)])).encode())
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(content) - 1))
        content[at : at + data.draw(st.integers(0, 3))] = data.draw(st.binary(max_size=3))
    path = tmp_path / "camera.yaml"
    path.write_bytes(content)
    for name in (None, "cam0", "cam1"):
        with suppress(FormatError):
            assert isinstance(read_camera(path, name), CameraModel)
