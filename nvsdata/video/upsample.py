"""Frames between frames, where something moves: along a line of brightness, or along the optical flow."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal, NamedTuple

import cv2
import numpy as np

from nvsdata.kernels.emulate.tiles import TILE, find_dirty
from nvsdata.video.video_frame import FULL, VideoFrame, stretch_levels

Upsample = Literal["none", "linear", "flow"]
PIXELS = 1.0  # by which anything moves from one frame to the next at most, as ESIM's adaptive rate has it
CHANGE = 0.5  # of the logarithm of anything's brightness, per step
DARK = 3.0  # gray levels added before that logarithm
MOST = 64  # frames in place of one
MARGIN = 16  # pixels around what changes in which flow looks for where it comes from
SMALLEST = 32  # pixels on a side of an image whose flow OpenCV finds
SLIGHT = 0.1  # change of that logarithm up to which a line is as good as flow, wherever things move
FLAT = 2.0  # gray levels: an image without larger differences has no flow


class Region(NamedTuple):
    """Rows and columns of a part of the picture."""

    rows: slice
    columns: slice


def upsample_frames(frames: Iterator[VideoFrame], how: Upsample | int) -> Iterator[VideoFrame]:
    """The frames, and between two that differ as many others as are needed, which have `whole=False`.

    - `how`: "linear" makes a step for each `CHANGE` of the logarithm of brightness, where that changes most, and each
      pixel goes along a line; "flow" so many that nothing moves by more than `PIXELS` (Rebecq, Gehrig and Scaramuzza
      2018), along the optical flow (DIS, Kroeger et al. 2016), both up to `MOST`; a number so many steps along a line;
      "none" none

    What doesn't change is only copied. Bytes stay bytes: they are rounded to whole levels.
    """
    if how in ("none", 1):
        yield from frames
        return
    last = None
    for frame in frames:
        if last is not None and last.pixels.shape == frame.pixels.shape and last.pixels.dtype == frame.pixels.dtype:
            yield from _between(last, frame, how)
        yield frame
        last = frame


def _between(last: VideoFrame, frame: VideoFrame, how: Upsample | int) -> Iterator[VideoFrame]:
    boxes = _changed(last.pixels, frame.pixels, MARGIN if how == "flow" else 0)
    if not boxes:
        return
    lines = [(last.pixels[box].astype(np.float32), frame.pixels[box].astype(np.float32)) for box in boxes]
    moved = [how == "flow" and _change(a, b, last.levels) > SLIGHT for a, b in lines]
    flows = [_flow(_gray(a), _gray(b)) if moves else None for (a, b), moves in zip(lines, moved, strict=True)]
    gap = frame.time - last.time
    steps = min(min(_steps(lines, flows, last.levels), MOST) if isinstance(how, str) else how, gap)
    for k in range(1, steps):
        share = k / steps
        pixels = last.pixels.copy()
        for box, (a, b), flow in zip(boxes, lines, flows, strict=True):
            made = a + share * (b - a) if flow is None else _warped(a, b, *flow, share)
            pixels[box] = np.rint(made) if pixels.dtype == np.uint8 else made
        yield last._replace(time=last.time + round(share * gap), pixels=pixels, whole=False)


def _changed(before: np.ndarray, after: np.ndarray, margin: int) -> list[Region]:
    """Boxes around what differs between two pictures, in which tiles that touch are together."""
    height, width = before.shape[:2]
    rows = before.view(np.uint8).reshape(height, -1), after.view(np.uint8).reshape(height, -1)
    dirty = np.zeros((-(-height // TILE[0]), -(-width // TILE[1])), np.bool_)
    find_dirty(rows[1], rows[0], rows[0].shape[1] // width * TILE[1], dirty)
    # wide enough apart that boxes with margins don't overlap
    reach = 1 + 2 * (-(-margin // TILE[0]))
    near = cv2.dilate(dirty.astype(np.uint8), np.ones((reach, 3), np.uint8)) if margin else dirty.astype(np.uint8)
    _, labels = cv2.connectedComponents(near)
    found = []
    for label in np.unique(labels[dirty]):
        r, c = np.nonzero((labels == label) & dirty)
        top, bottom = max(int(r.min()) * TILE[0] - margin, 0), min(int(r.max() + 1) * TILE[0] + margin, height)
        left, right = max(int(c.min()) * TILE[1] - margin, 0), min(int(c.max() + 1) * TILE[1] + margin, width)
        found.append(Region(slice(top, bottom), slice(left, right)))
    return found


def _steps(
    lines: list[tuple[np.ndarray, np.ndarray]],
    flows: list[tuple[np.ndarray, np.ndarray] | None],
    levels: tuple[int, int],
) -> int:
    """Steps from one frame to the next by which nothing moves, or changes, too far."""
    most = 0.0
    for (a, b), flow in zip(lines, flows, strict=True):
        if flow is None:
            most = max(most, _change(a, b, levels) / CHANGE)
        else:
            differs = np.abs(_gray(b) - _gray(a)) > FLAT
            most = max(most, *(float(np.hypot(*part[differs].T).max(initial=0)) / PIXELS for part in flow))
    return max(math.ceil(most), 1)


def _change(a: np.ndarray, b: np.ndarray, levels: tuple[int, int]) -> float:
    """The largest change of a logarithm of brightness."""
    before, after = (picture if levels == FULL else stretch_levels(picture, levels) for picture in (a, b))
    return float(np.abs(np.log((after + DARK) / (before + DARK))).max())


def _gray(picture: np.ndarray) -> np.ndarray:
    return picture if picture.ndim == 2 else picture.mean(axis=2)


def _flow(before: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where pixels of each of two pictures move to in the other one, float32 [H, W, 2] each; zero in flat pictures."""
    zero = np.zeros((*before.shape, 2), np.float32)
    if min(np.ptp(before), np.ptp(after)) <= FLAT:
        return zero, zero
    more = [(0, max(SMALLEST - side, 0)) for side in before.shape]
    a, b = (np.pad(np.rint(picture).astype(np.uint8), more, mode="edge") for picture in (before, after))
    # one of its own, because it isn't made for several threads
    finder = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    there, back = (finder.calc(*pair, np.zeros((*a.shape, 2), np.float32)) for pair in ((a, b), (b, a)))
    inside = tuple(slice(side) for side in before.shape)
    return there[inside], back[inside]


def _warped(before: np.ndarray, after: np.ndarray, there: np.ndarray, back: np.ndarray, share: float) -> np.ndarray:
    """The picture at a share of the way: both, moved along the flow to that moment and combined (Jiang et al. 2018)."""
    to_before = share * share * back - (1 - share) * share * there
    to_after = (1 - share) * (1 - share) * there - share * (1 - share) * back
    return (1 - share) * _moved(before, to_before) + share * _moved(after, to_after)


def _moved(picture: np.ndarray, by: np.ndarray) -> np.ndarray:
    y, x = np.indices(picture.shape[:2], dtype=np.float32)
    return cv2.remap(picture, x + by[..., 0], y + by[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
