"""Model of a calibrated camera: from pixels to positions without lens distortion, and back."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from nvsdata.data.events import check_sensor_size

DistortionModel = Literal["radtan", "equidistant"]
COUNTS = {"radtan": (0, 4, 5, 8, 12, 14), "equidistant": (4,)}  # numbers of coefficients
_ITERATIONS, _PRECISION = 200, 1e-7  # of the inverse of the distortion; pixels
_FAR = 0.01  # pixels; a position whose distortion is farther from the pixel isn't a solution
_SOME = 1 << 14  # points that are projected at once, because OpenCV allocates their derivatives, too
_SKEW = 1e-3  # largest error of a rotation's elements, which files round


@dataclass(frozen=True)
class CameraModel:
    """Intrinsics and lens distortion of a camera, in OpenCV's conventions.

    Pixels have integer centers. Positions without distortion are those of a pinhole camera with `new_intrinsics`, which
    is rotated by `rectification`.

    Args:
        sensor_size: (width, height) in pixels of the sensor that was calibrated.
        intrinsics: (fx, fy, cx, cy) in pixels: focal lengths and principal point.
        distortion: Coefficients in OpenCV's order: 0, 4, 5, 8, 12 or 14 of "radtan" (k1, k2, p1, p2, k3, ...), 4 of
            "equidistant" (default: none).
        distortion_model: "radtan" (default), radial and tangential, or "equidistant", OpenCV's fisheye.
        rectification: Rotation [3][3] from the camera to the rectified camera (default None: no rotation).
        new_intrinsics: (fx, fy, cx, cy) in pixels of the rectified camera (default None: those of the camera).

    Raises:
        ValueError: A value isn't finite, focal lengths aren't positive, the number of coefficients doesn't belong to
            the model, or the rectification isn't a rotation.

    Example:
        >>> import nvsdata
        >>> camera = nvsdata.CameraModel((240, 180), (200.0, 200.0, 120.0, 90.0), (-0.3, 0.1, 0.0, 0.0))
        >>> x, y = camera.undistorted([0, 120], [0, 90])
        >>> x.round(1).tolist(), y.round(1).tolist()
        ([-26.6, 120.0], [-19.9, 90.0])
    """

    sensor_size: tuple[int, int]
    intrinsics: tuple[float, float, float, float]
    distortion: tuple[float, ...] = ()
    distortion_model: DistortionModel = "radtan"
    rectification: tuple[tuple[float, float, float], ...] | None = None
    new_intrinsics: tuple[float, float, float, float] | None = None

    def __post_init__(self) -> None:
        if self.distortion_model not in get_args(DistortionModel):
            raise ValueError(f"distortion_model must be 'radtan' or 'equidistant', not {self.distortion_model!r}")
        plain: dict[str, Any] = {"sensor_size": check_sensor_size(self.sensor_size)}
        plain["intrinsics"] = _focal_and_center("intrinsics", self.intrinsics)
        plain["distortion"] = _numbers("distortion", self.distortion)
        counts = COUNTS[self.distortion_model]
        if len(self.distortion) not in counts:
            allowed = " or ".join(map(str, counts))
            raise ValueError(f"{self.distortion_model} has {allowed} coefficients, not {len(self.distortion)}")
        if self.rectification is not None:
            plain["rectification"] = _rotation(self.rectification)
        if self.new_intrinsics is not None:
            plain["new_intrinsics"] = _focal_and_center("new_intrinsics", self.new_intrinsics)
        # plain numbers of Python, so that the repr doesn't depend on the arrays that were given
        for name, value in plain.items():
            object.__setattr__(self, name, value)

    def undistorted(self, x: npt.ArrayLike, y: npt.ArrayLike) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        """Return the positions without lens distortion of points in the camera's image.

        Args:
            x: Columns in pixels, [N].
            y: Rows in pixels, [N].

        Returns:
            Columns and rows, float64 [N] each, which may lie outside the sensor. NaN where the model has no solution,
            such as far outside the part of the image that was calibrated.
        """
        import cv2

        points = _points(x, y)
        if not len(points):
            return points[:, 0], points[:, 1]
        criteria = cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, _ITERATIONS, _PRECISION
        inverse: Any
        if self.distortion_model == "equidistant":
            inverse = cv2.fisheye.undistortPoints
        else:
            # OpenCV 4 has the criteria, and requires R and P, in a function of its own
            inverse = getattr(cv2, "undistortPointsIter", None) or cv2.undistortPoints
        same = {"R": np.eye(3), "P": np.eye(3)}
        matrix = _matrix_of(self.intrinsics)
        flat = inverse(points[:, None], matrix, self._coefficients(), **same, criteria=criteria)[:, 0]
        with np.errstate(all="ignore"):
            flat[~(np.abs(self._projected(flat) - points).max(1) < _FAR)] = np.nan
            rays = np.column_stack((flat, np.ones(len(flat)))) @ self._rotation_matrix().T
            rays[~(rays[:, 2] > 0)] = np.nan
            fx, fy, cx, cy = self.new_intrinsics or self.intrinsics
            return rays[:, 0] / rays[:, 2] * fx + cx, rays[:, 1] / rays[:, 2] * fy + cy

    def distorted(self, x: npt.ArrayLike, y: npt.ArrayLike) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        """Return where the camera sees positions without lens distortion: the inverse of `undistorted`.

        Args:
            x: Columns in pixels, [N].
            y: Rows in pixels, [N].

        Returns:
            Columns and rows in the camera's image, float64 [N] each. NaN behind the camera.
        """
        fx, fy, cx, cy = self.new_intrinsics or self.intrinsics
        points = _points(x, y)
        with np.errstate(all="ignore"):
            flat = (points - (cx, cy)) / (fx, fy)
            rays = np.column_stack((flat, np.ones(len(flat)))) @ self._rotation_matrix()
            rays[~(rays[:, 2] > 0)] = np.nan
            seen = self._projected(rays[:, :2] / rays[:, 2:])
        return seen[:, 0], seen[:, 1]

    def _rotation_matrix(self) -> npt.NDArray[np.float64]:
        """Return the rectification as a matrix [3, 3]."""
        return np.eye(3) if self.rectification is None else np.array(self.rectification)

    def _coefficients(self) -> npt.NDArray[np.float64]:
        return np.array(self.distortion or (0.0, 0.0, 0.0, 0.0))

    def _projected(self, flat: np.ndarray) -> np.ndarray:
        """Return the pixels of rays (x, y, 1), given as [N, 2]."""
        import cv2

        still, matrix, coefficients = np.zeros(3), _matrix_of(self.intrinsics), self._coefficients()
        found = np.empty_like(flat)
        for at in range(0, len(flat), _SOME):
            some = flat[at : at + _SOME, None]
            if self.distortion_model == "equidistant":
                seen = cv2.fisheye.distortPoints(some, matrix, coefficients)
            else:
                rays = cv2.convertPointsToHomogeneous(some)
                seen, _ = cv2.projectPoints(rays, still, still, matrix, coefficients)
            found[at : at + _SOME] = seen[:, 0]
        return found


def _matrix_of(intrinsics: Sequence[float]) -> npt.NDArray[np.float64]:
    """Return the camera matrix [3, 3] of (fx, fy, cx, cy)."""
    fx, fy, cx, cy = intrinsics
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def _points(x: npt.ArrayLike, y: npt.ArrayLike) -> np.ndarray:
    return np.stack(np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64)), 1)


def _numbers(name: str, values: Sequence[float]) -> tuple[float, ...]:
    numbers = tuple(map(float, values))
    if not all(map(math.isfinite, numbers)):
        raise ValueError(f"{name} must be finite numbers, not {numbers}")
    return numbers


def _focal_and_center(name: str, values: Sequence[float]) -> tuple[float, ...]:
    if np.shape(values) != (4,):
        raise ValueError(f"{name} must be (fx, fy, cx, cy), not {values}")
    fx, fy, *_ = numbers = _numbers(name, values)
    if not (fx > 0 and fy > 0):
        raise ValueError(f"focal lengths in {name} must be positive, not {fx} and {fy}")
    return numbers


def _rotation(values: Sequence[Sequence[float]]) -> tuple[tuple[float, ...], ...]:
    if np.shape(values) != (3, 3):
        raise ValueError(f"rectification must be 3 rows of 3 numbers, not {values}")
    rows = tuple(_numbers("rectification", row) for row in values)
    matrix = np.array(rows)
    with np.errstate(all="ignore"):
        if not (np.abs(matrix @ matrix.T - np.eye(3)).max() < _SKEW and np.linalg.det(matrix) > 0):
            raise ValueError(f"rectification must be a rotation, not {rows}")
    return rows
