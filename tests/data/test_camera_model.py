"""Camera models against OpenCV."""

import pickle

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nvsdata import CameraModel

SIZE = 60, 40
INTRINSICS = (50.0, 52.0, 31.0, 18.5)
MATRIX = np.array([[50.0, 0, 31], [0, 52, 18.5], [0, 0, 1]])
TURN = cv2.Rodrigues(np.array([0.02, -0.03, 0.01]))[0]
NEW = (45.0, 44.0, 29.0, 21.0)
NEW_MATRIX = np.array([[45.0, 0, 29], [0, 44, 21], [0, 0, 1]])
COEFFICIENTS = {
    4: (-0.3, 0.1, 1e-3, -2e-3),
    5: (-0.3, 0.1, 1e-3, -2e-3, -0.01),
    8: (-0.2, 0.1, 1e-3, -2e-3, 0.01, 0.1, 0.02, 0.01),
    12: (-0.2, 0.1, 1e-3, -2e-3, 0.01, 0.1, 0.02, 0.01, 1e-3, 2e-3, -1e-3, 1e-3),
    14: (-0.2, 0.1, 1e-3, -2e-3, 0.01, 0.1, 0.02, 0.01, 1e-3, 2e-3, -1e-3, 1e-3, 0.01, -0.02),
}
RADTAN = [CameraModel(SIZE, INTRINSICS, one) for one in COEFFICIENTS.values()]
FISHEYE = CameraModel(SIZE, INTRINSICS, (-0.03, 0.02, -0.01, 0.002), "equidistant")
RECTIFIED = [
    CameraModel(SIZE, INTRINSICS, COEFFICIENTS[5], "radtan", TURN, NEW),
    CameraModel(SIZE, INTRINSICS, (-0.03, 0.02, -0.01, 0.002), "equidistant", TURN, NEW),
]
EVERY = [*RADTAN, FISHEYE, *RECTIFIED]
every = pytest.mark.parametrize(
    "camera", EVERY, ids=lambda one: f"{len(one.distortion)}-{one.distortion_model}-{one.new_intrinsics is not None}"
)
Y, X = (grid.ravel().astype(float) for grid in np.mgrid[: SIZE[1], : SIZE[0]])


@every
def test_positions_are_those_of_opencv(camera):
    points = np.stack((X, Y), 1)[:, None]
    turned = camera.rectification is not None
    more = {"R": TURN if turned else np.eye(3), "P": NEW_MATRIX if turned else MATRIX}
    criteria = cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 1000, 1e-10
    kind = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)  # the former in OpenCV 4
    kind = cv2.fisheye.undistortPoints if camera.distortion_model == "equidistant" else kind
    expected = kind(points, MATRIX, np.array(camera.distortion), criteria=criteria, **more)[:, 0]
    np.testing.assert_allclose(np.stack(camera.undistorted(X, Y), 1), expected, atol=1e-4)


@every
def test_there_and_back(camera):
    np.testing.assert_allclose(camera.distorted(*camera.undistorted(X, Y)), (X, Y), atol=1e-4)


@every
def test_distorted_positions_are_those_that_opencv_projects(camera):
    turned = camera.rectification is not None
    matrix, turn = (NEW_MATRIX, TURN) if turned else (MATRIX, np.eye(3))
    rays = (turn.T @ np.linalg.inv(matrix) @ np.stack((X, Y, np.ones_like(X)))).T[:, None]
    kind = cv2.fisheye.projectPoints if camera.distortion_model == "equidistant" else cv2.projectPoints
    seen = kind(rays, np.zeros(3), np.zeros(3), MATRIX, np.array(camera.distortion))[0].reshape(-1, 2)
    np.testing.assert_allclose(np.stack(camera.distorted(X, Y), 1), seen, atol=1e-6)


@given(st.lists(st.tuples(st.floats(-20, 80), st.floats(-20, 60)), max_size=20))
def test_without_distortion_points_stay(points):
    x, y = np.array(points).reshape(-1, 2).T
    for there in (CameraModel(SIZE, INTRINSICS).undistorted, CameraModel(SIZE, INTRINSICS).distorted):
        np.testing.assert_allclose(there(x, y), (x, y), atol=1e-9)


def test_positions_that_the_model_cannot_reach_are_nan():
    # x (1 - x^2) is at most 0.385, so the image ends 50 * 0.385 pixels from its center
    folded = CameraModel(SIZE, (50.0, 50.0, 30.0, 20.0), (-1.0, 0.0, 0.0, 0.0))
    x, y = folded.undistorted([30, 45, 50], [20, 20, 20])
    assert np.isnan(x).tolist() == np.isnan(y).tolist() == [False, False, True]
    assert abs(x[1] - 30) / 50 < 0.5774


def test_rays_behind_a_rectified_camera_are_nan():
    turned = cv2.Rodrigues(np.array([0.0, 1.5, 0.0]))[0]
    camera = CameraModel(SIZE, INTRINSICS, (), "radtan", turned)
    assert np.isnan(camera.undistorted(X, Y)).any()
    assert not np.isnan(camera.undistorted(X, Y)).all()


def test_it_contains_plain_numbers_whatever_it_was_given():
    array = CameraModel(np.array(SIZE), np.float32(INTRINSICS), np.zeros(4), "radtan", np.eye(3), np.float32(NEW))
    plain = CameraModel(SIZE, INTRINSICS, (0.0,) * 4, "radtan", ((1.0, 0, 0), (0, 1, 0), (0, 0, 1)), NEW)
    assert array == plain
    assert hash(array) == hash(plain)
    assert "np." not in repr(array)
    assert eval(repr(array)) == pickle.loads(pickle.dumps(array)) == array


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sensor_size": (0, 4)}, "sensor_size"),
        ({"intrinsics": (1.0, 1.0, 1.0)}, r"intrinsics must be \(fx, fy, cx, cy\)"),
        ({"intrinsics": np.eye(3)}, r"intrinsics must be \(fx, fy, cx, cy\)"),
        ({"intrinsics": (0.0, 1.0, 1.0, 1.0)}, "focal lengths in intrinsics must be positive, not 0.0 and 1.0"),
        ({"intrinsics": (1.0, 1.0, np.nan, 1.0)}, "intrinsics must be finite"),
        ({"new_intrinsics": (1.0, -1.0, 1.0, 1.0)}, "focal lengths in new_intrinsics"),
        ({"distortion": (1.0, 2.0, 3.0)}, "radtan has 0 or 4 or 5 or 8 or 12 or 14 coefficients, not 3"),
        ({"distortion": (0.0, 0.0, np.inf, 0.0)}, "distortion must be finite"),
        ({"distortion_model": "equidistant"}, "equidistant has 4 coefficients, not 0"),
        ({"distortion_model": "fov"}, "distortion_model must be 'radtan' or 'equidistant', not 'fov'"),
        ({"rectification": np.zeros((3, 3))}, "rectification must be a rotation"),
        ({"rectification": -np.eye(3)}, "rectification must be a rotation"),
        ({"rectification": np.eye(4)}, "rectification must be 3 rows of 3 numbers"),
        ({"rectification": np.full((3, 3), np.nan)}, "rectification must be finite"),
    ],
)
def test_wrong_values_are_named(change, message):
    with pytest.raises(ValueError, match=message):
        CameraModel(**{"sensor_size": SIZE, "intrinsics": INTRINSICS, **change})
