"""Calibrated cameras of the files of DSEC, Kalibr, ROS and OpenCV."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from nvsdata.common.errors import FormatError, line_of
from nvsdata.data.camera_model import CameraModel, DistortionModel
from nvsdata.formats.cameras.parsing import parsed

MOST = 16  # numbers of the longest list that is read, a matrix [4, 4]
# names of distortion models in files
MODELS: Mapping[str, DistortionModel] = {
    "none": "radtan",
    "radtan": "radtan",
    "plumb_bob": "radtan",
    "rational_polynomial": "radtan",
    "equidistant": "equidistant",
    "fisheye": "equidistant",
}


def read_camera(path: str | os.PathLike[str], name: str | None = None) -> CameraModel:
    """Read a calibrated camera from a file.

    The layout is recognized by the content:

    - DSEC's `cam_to_cam.yaml`, with the rectification that the dataset's own rectified data have;
    - Kalibr's camera chains: `pinhole` with `radtan`, `equidistant` or no distortion; also with the rectification and
      projection matrices that MVSEC adds;
    - OpenCV's FileStorage in YAML, XML and JSON: `camera_matrix`, `distortion_coefficients`, `image_width` and
      `image_height`; and the files of ROS, which have the same names and rectification and projection matrices.

    Args:
        path: The file.
        name: Name of the camera (default None: the only camera of the file).

    Returns:
        The camera.

    Raises:
        FileNotFoundError: The file doesn't exist.
        FormatError: The file isn't a calibration, or has wrong values or a model that isn't supported; or it has
            several cameras and no `name` is given, or none of that name. The error lists the names.

    Example:
        >>> import pathlib, tempfile, nvsdata
        >>> path = pathlib.Path(tempfile.mkdtemp(), "camchain.yaml")
        >>> _ = path.write_text('''
        ... cam0:
        ...   camera_model: pinhole
        ...   intrinsics: [200, 200, 120, 90]
        ...   distortion_model: radtan
        ...   distortion_coeffs: [-0.3, 0.1, 0, 0]
        ...   resolution: [240, 180]
        ... ''')
        >>> nvsdata.read_camera(path).intrinsics
        (200.0, 200.0, 120.0, 90.0)
    """
    cameras = _cameras(parsed(path))
    if not cameras:
        raise FormatError(path, "has no camera in the layout of DSEC, Kalibr, ROS or OpenCV")
    if name is None and len(cameras) > 1:
        raise FormatError(path, f"has several cameras: choose one by its name, of {', '.join(cameras)}")
    chosen = next(iter(cameras)) if name is None else name
    if chosen not in cameras:
        raise FormatError(path, f"has no camera {chosen!r}; it has {', '.join(cameras)}")
    try:
        return cameras[chosen]()
    except KeyError as error:
        raise FormatError(path, f"{chosen}: {error.args[0]!r} is missing") from None
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        raise FormatError(path, f"{chosen}: {line_of(error)}") from None


def _cameras(content: Mapping[str, Any]) -> dict[str, Callable[[], CameraModel]]:
    """Return the functions that build each camera of a file."""
    inside = content.get("intrinsics")
    if isinstance(inside, dict):
        own = [name for name in inside if isinstance(name, str) and not name.startswith("camRect")]
        return {name: lambda name=name: _of_dsec(content, name) for name in own}  # type: ignore[misc]
    if "camera_matrix" in content:
        return {str(content.get("camera_name", "camera")): lambda: _of_opencv(content)}
    chain = {str(name): entry for name, entry in content.items() if isinstance(entry, dict) and "camera_model" in entry}
    return {name: lambda entry=entry: _of_kalibr(entry) for name, entry in chain.items()}  # type: ignore[misc]


def _of_dsec(content: Mapping[str, Any], name: str) -> CameraModel:
    entry = _entry(content["intrinsics"], name)
    rectified = content["intrinsics"].get(name.replace("cam", "camRect", 1))
    more: dict[str, Any] = {}
    if rectified is not None:
        rectified = _entry({"camRect": rectified}, "camRect")
        if _size(rectified["resolution"]) != _size(entry["resolution"]):
            raise ValueError("the rectified camera has another resolution, which isn't supported")
        more["rectification"] = _matrix(_entry(content, "extrinsics"), name.replace("cam", "R_rect", 1), (3, 3))
        more["new_intrinsics"] = _row(rectified, "camera_matrix", 4)
    return _camera(entry, _size(entry["resolution"]), _row(entry, "camera_matrix", 4), "distortion_coeffs", more)


def _of_kalibr(entry: Mapping[str, Any]) -> CameraModel:
    _check_pinhole(entry)
    size, intrinsics = _size(entry["resolution"]), _row(entry, "intrinsics", 4)
    return _camera(entry, size, intrinsics, "distortion_coeffs", _rectified(entry))


def _of_opencv(entry: Mapping[str, Any]) -> CameraModel:
    size = _size([entry["image_width"], entry["image_height"]])
    intrinsics = _intrinsics("camera_matrix", _matrix(entry, "camera_matrix", (3, 3)))
    return _camera(entry, size, intrinsics, "distortion_coefficients", _rectified(entry))


def _camera(
    entry: Mapping[str, Any], size: tuple[int, int], intrinsics: Any, coefficients: str, more: Mapping[str, Any]
) -> CameraModel:
    _check_pinhole(entry)
    fisheye = "fisheye_model" in entry and _number(entry["fisheye_model"]) != 0
    named = _word(entry, "distortion_model", "fisheye" if fisheye else "radtan")
    if named not in MODELS:
        raise ValueError(f"distortion_model {named!r} isn't supported; supported are {', '.join(MODELS)}")
    distortion = [] if named == "none" else _numbers(entry[coefficients])
    return CameraModel(size, tuple(intrinsics), tuple(distortion), MODELS[named], **more)


def _check_pinhole(entry: Mapping[str, Any]) -> None:
    named = _word(entry, "camera_model", "pinhole")
    if named != "pinhole":
        raise ValueError(f"camera_model {named!r} isn't supported; supported is 'pinhole'")


def _rectified(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of the matrices that ROS and MVSEC have in addition."""
    more: dict[str, Any] = {}
    if "rectification_matrix" in entry:
        more["rectification"] = _matrix(entry, "rectification_matrix", (3, 3))
    if "projection_matrix" in entry:
        projection = _matrix(entry, "projection_matrix", (3, 4))
        more["new_intrinsics"] = _intrinsics("projection_matrix", [row[:3] for row in projection])
    return more


def _intrinsics(name: str, matrix: list[list[float]]) -> tuple[float, ...]:
    """Return (fx, fy, cx, cy) of a camera matrix."""
    (fx, skew, cx), (zero, fy, cy), last = matrix
    if (skew, zero, *last) != (0, 0, 0, 0, 1):
        raise ValueError(f"{name} must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], not {matrix}")
    return fx, fy, cx, cy


def _word(entry: Mapping[str, Any], name: str, default: str) -> str:
    word = entry.get(name, default)
    # Kalibr's "none" may be written without quotes, or as null
    if word is not None and not isinstance(word, str):
        raise ValueError(f"{name} must be a name, not {type(word).__name__}")
    return "none" if word is None else word[:50]


def _entry(content: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    entry = content[name]
    if not isinstance(entry, dict):
        raise ValueError(f"{name} must have named values, not be of type {type(entry).__name__}")
    return entry


def _size(value: Any) -> tuple[int, int]:
    numbers = _numbers(value)
    if len(numbers) != 2 or not all(number.is_integer() for number in numbers):
        raise ValueError(f"the resolution must be a width and a height in pixels, not {numbers}")
    return int(numbers[0]), int(numbers[1])


def _row(entry: Mapping[str, Any], name: str, count: int) -> list[float]:
    numbers = _numbers(entry[name])
    if len(numbers) != count:
        raise ValueError(f"{name} must be {count} numbers, not {len(numbers)}")
    return numbers


def _matrix(entry: Mapping[str, Any], name: str, shape: tuple[int, int]) -> list[list[float]]:
    numbers = _numbers(entry[name])
    if len(numbers) != shape[0] * shape[1]:
        raise ValueError(f"{name} must be {shape[0]} rows of {shape[1]} numbers, not {len(numbers)} numbers")
    rows: list[list[float]] = np.array(numbers).reshape(shape).tolist()
    return rows


def _numbers(value: Any) -> list[float]:
    """Return the numbers of a list, of rows of them, or of one of OpenCV's matrices."""
    if isinstance(value, dict):
        value = value["data"]
    items = value if isinstance(value, list) else [value]
    # references in YAML can make a small file's lists very long
    rows = [item if isinstance(item, list) else [item] for item in items[: MOST + 1]]
    numbers = [_number(item) for row in rows for item in row[: MOST + 1]]
    if len(numbers) > MOST:
        raise ValueError(f"a list has more than {MOST} numbers")
    return numbers


def _number(value: Any) -> float:
    # YAML 1.1 takes 1e-05 for text
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"a number is expected, not {type(value).__name__}")
    return float(value)
