"""Removal of lens distortion from events, graphs, images and boxes."""

from __future__ import annotations

import os
from dataclasses import InitVar, dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple

import numpy as np
import torch

from nvsdata.common.memory import check_memory
from nvsdata.data.boxes import Boxes
from nvsdata.data.camera_model import CameraModel
from nvsdata.data.events import Columns, Events
from nvsdata.data.graph import Graph
from nvsdata.data.recording import wrong_type
from nvsdata.data.samples import Frame
from nvsdata.kernels.represent.moves import move_events, move_table
from nvsdata.transforms.apply import Change, SpatialTransform, size_of

IMAGES = (torch.uint8, torch.int16, torch.float32, torch.float64)  # types that OpenCV interpolates
SIDE = np.linspace(0, 1, 17)  # positions of a box's points along its sides


@dataclass(frozen=True)
class Undistort(SpatialTransform):
    """Remove lens distortion, and rectify if the camera has a rectification.

    The result is what a pinhole camera with the same sensor size records, with the matrix `new_intrinsics` of the
    camera model, or its own.

    Events move to whole pixels. An event goes to a pixel of the new image whose center lies within the event's own
    pixel. If there are several, because the image is stretched there, one is chosen by a hash of the event's time and
    pixel, so no pixel of the new image stays empty; after a shift in time the choice may be another. If there is none,
    the event goes to the nearest pixel. No event is duplicated, events that leave the sensor are dropped, and a window
    of the result is the result of the window.

    Nodes of graphs move to positions between pixels, and may leave the sensor. Images are interpolated linearly
    (`cv2.remap`), with zeros where the camera saw nothing. Boxes become the boxes around what they contained.

    Args:
        camera: A `CameraModel`, or the path of a calibration file, which is read when the transform is made; see
            `nvsdata.read_camera`. The repr contains the camera, not the path.
        name: Name of the camera in the file (default None: the only one).

    Returns:
        The sample without distortion. The call takes images [..., H, W] (uint8, int16, float32 or float64); a `Frame`
        of the same camera (`Recording.frames`); or a `Graph`, `Events`, a `Recording` (which is decoded) or a list of
        these.

    Raises:
        FormatError: The file isn't a calibration, or has several cameras and no `name` is given.
        ValueError: The sample has another size than the calibrated sensor.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> camera = nvsdata.CameraModel((240, 180), (200.0, 200.0, 120.0, 90.0), (-0.3, 0.1, 0.0, 0.0))
        >>> T.Undistort(camera)(nvsdata.example()).sensor_size
        (240, 180)
    """

    camera: CameraModel | str | os.PathLike[str]
    name: InitVar[str | None] = None
    deterministic: ClassVar[bool] = True
    graphs: ClassVar[bool] = True
    images: ClassVar[bool] = True

    def __post_init__(self, name: str | None) -> None:
        if not isinstance(self.camera, CameraModel | str | os.PathLike):
            raise TypeError(f"camera must be a CameraModel or the path of a calibration file, not {self.camera!r}")
        if not isinstance(self.camera, CameraModel):
            # readers of files aren't imported with the transforms
            from nvsdata.formats.cameras.layouts import read_camera

            object.__setattr__(self, "camera", read_camera(self.camera, name))
        elif name is not None:
            raise ValueError("name chooses a camera of a file, but the camera is given")

    def _map(self, sample: Any, change: Change) -> Any:
        return change(sample) if isinstance(sample, Frame) else super()._map(sample, change)

    def _change(self, sample: Any) -> Change:
        assert isinstance(self.camera, CameraModel)
        camera = self.camera
        return lambda part: _undistorted(part, camera)


def _undistorted(part: Any, camera: CameraModel) -> Any:
    size = size_of(part)
    if size not in (None, camera.sensor_size):
        found, calibrated = ("{}x{}".format(*one) for one in (size, camera.sensor_size))
        raise ValueError(f"the calibration has a sensor_size of {calibrated} pixels, but the sample has {found}")
    if isinstance(part, Events):
        table = _table(camera)
        moved = Columns.empty(len(part) + 1)
        count = move_events(*part.columns, table.moves, table.lists, moved)
        return part.of(moved.first(count))
    if isinstance(part, Boxes):
        return _around(part, camera)
    if isinstance(part, Graph):
        return part.moved(_moved(part.pos, camera))
    if isinstance(part, Frame):
        return replace(part, x=0, y=0, pixels=_remapped(_on_sensor(part, camera), camera))
    if part.dtype not in IMAGES:
        raise wrong_type("sample", "images of uint8, int16, float32 or float64", part)
    return torch.from_numpy(_remapped(part.numpy(), camera))


def _moved(pos: torch.Tensor, camera: CameraModel) -> torch.Tensor:
    """Return undistorted positions [N, 2]."""
    moved = np.stack(camera.undistorted(*pos.numpy().T), 1)
    if lost := int(np.isnan(moved).any(1).sum()):
        raise ValueError(f"{lost} nodes have no position without distortion: undistort the events instead")
    return torch.from_numpy(moved.astype(np.float32))


def _around(boxes: Boxes, camera: CameraModel) -> Boxes:
    """Return the boxes around moved points of boxes; boxes without any position without distortion are dropped."""
    left, top, right, bottom = (boxes.edges.numpy().astype(np.float64).T - 0.5)[:, :, None, None]
    x, y = np.broadcast_arrays(left + (right - left) * SIDE, top + (bottom - top) * SIDE[:, None])
    moved = np.stack(camera.undistorted(x.ravel(), y.ravel())).reshape(2, len(x), -1)
    # these leave out NaN, unless all are
    least, most = np.fmin.reduce(moved, 2), np.fmax.reduce(moved, 2)
    corners = np.stack((least, (most[0], least[1]), most, (least[0], most[1])), 0)
    return boxes.moved(torch.from_numpy(corners.transpose(2, 0, 1).reshape(-1, 2).astype(np.float32)))


def _on_sensor(frame: Frame, camera: CameraModel) -> np.ndarray:
    """Return a frame's pixels on the whole sensor, with zeros outside the frame."""
    width, height = camera.sensor_size
    rows, columns = frame.pixels.shape
    if not (0 <= frame.x <= width - columns and 0 <= frame.y <= height - rows):
        found = f"{columns}x{rows} pixels from ({frame.x}, {frame.y}) on"
        raise ValueError(f"the calibration has a sensor_size of {width}x{height} pixels, but the frame has {found}")
    pixels = np.zeros((height, width), frame.pixels.dtype)
    pixels[frame.y : frame.y + rows, frame.x : frame.x + columns] = frame.pixels
    return pixels


def _remapped(images: np.ndarray, camera: CameraModel) -> np.ndarray:
    """Return images [..., H, W], interpolated at the positions in the camera's image."""
    import cv2

    columns, rows = _table(camera).source
    found = np.empty(images.shape, images.dtype)
    for at in np.ndindex(images.shape[:-2]):
        found[at] = cv2.remap(images[at], columns, rows, cv2.INTER_LINEAR)
    return found


class _Table(NamedTuple):
    """Table of a camera.

    Args:
        moves: uint32 [H, W], targets of events by pixel, for `move_events`.
        lists: uint32 [K], targets of pixels with several.
        source: float32 [2, H, W], column and row in the camera's image of each pixel of the new image.
    """

    moves: np.ndarray
    lists: np.ndarray
    source: np.ndarray


@lru_cache(maxsize=8)
def _table(camera: CameraModel) -> _Table:
    width, height = camera.sensor_size
    check_memory(camera.sensor_size, (16, height, width), np.float64)
    y, x = (grid.ravel() for grid in np.mgrid[:height, :width])
    u, v = camera.distorted(x, y)
    source = np.stack((u, v)).astype(np.float32).reshape(2, height, width)
    # beyond a fold of the model, positions outside of the image come back into it; they aren't of this pixel
    back = np.abs(np.stack(camera.undistorted(u, v)) - (x, y)).max(0) < 0.5
    pixel, seen = _pixels(u, v, camera.sensor_size)
    seen &= back
    pixels, targets = pixel[seen], np.flatnonzero(seen)
    # pixels without a target of their own go to the nearest one
    left = np.flatnonzero(np.bincount(pixels, minlength=x.size) == 0)
    nearest, inside = _pixels(*camera.undistorted(x[left], y[left]), camera.sensor_size)
    pixels, targets = np.concatenate((pixels, left[inside])), np.concatenate((targets, nearest[inside]))
    return _Table(*move_table(pixels, targets, (height, width)), source)


def _pixels(u: np.ndarray, v: np.ndarray, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers of the nearest pixels, row by row, and which of them are on the sensor."""
    width, height = size
    with np.errstate(invalid="ignore"):
        column, row = np.rint(u), np.rint(v)
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    pixel = np.where(inside, row, 0).astype(np.int64) * width + np.where(inside, column, 0).astype(np.int64)
    return pixel, inside
