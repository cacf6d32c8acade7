"""Temporal upsampling of videos: additional frames, by linear interpolation or along the optical flow."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal, NamedTuple

import cv2
import numpy as np

from nvsdata.kernels.emulate.frames import TILE, find_dirty
from nvsdata.video.video_frame import FULL, VideoFrame, stretch_levels

Upsample = Literal["none", "linear", "flow"]
PIXELS = 1.0  # largest motion from one frame to the next, as in ESIM's adaptive sampling
CHANGE = 0.5  # largest change of the logarithm of a pixel's brightness per step
DARK = 3.0  # gray levels that are added to the brightness before its logarithm
MOST = 64  # steps from one frame to the next
MARGIN = 16  # pixels around a changed region, in which the flow is computed, too
SMALLEST = 32  # pixels per side that OpenCV's optical flow needs
SLIGHT = 0.1  # change of the logarithm of brightness up to which linear interpolation is as good as flow
FLAT = 2.0  # gray levels; no flow is computed for images without larger differences


class Region(NamedTuple):
    """Rows and columns of a part of a frame."""

    rows: slice
    columns: slice


def upsample_frames(frames: Iterator[VideoFrame], how: Upsample | int) -> Iterator[VideoFrame]:
    """Return the frames, with additional ones (`whole=False`) between frames that differ.

    Parts of the frame that don't change are copied. Pixels of uint8 are rounded to whole levels.

    Args:
        frames: Frames of a video.
        how: "linear" makes steps in which no pixel's logarithm of brightness changes by more than `CHANGE`, and
            interpolates each pixel linearly. "flow" makes steps in which nothing moves by more than `PIXELS` (Rebecq,
            Gehrig and Scaramuzza 2018), along the optical flow (DIS, Kroeger et al. 2016). Both make `MOST` steps at
            most. A number makes that many linear steps, "none" makes no additional frames.
    """
    return frames if how in ("none", 1) else _upsampled(frames, how)


def _upsampled(frames: Iterator[VideoFrame], how: Upsample | int) -> Iterator[VideoFrame]:
    """Yield the frames, and additional ones between them."""
    last = None
    for frame in frames:
        if last is not None and last.pixels.shape == frame.pixels.shape and last.pixels.dtype == frame.pixels.dtype:
            yield from _between(last, frame, how)
        yield frame
        last = frame


def _between(last: VideoFrame, frame: VideoFrame, how: Upsample | int) -> Iterator[VideoFrame]:
    """Yield the additional frames between two frames."""
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
    """Return boxes around the differences of two images; adjacent tiles share a box."""
    height, width = before.shape[:2]
    rows = before.view(np.uint8).reshape(height, -1), after.view(np.uint8).reshape(height, -1)
    dirty = np.zeros((-(-height // TILE[0]), -(-width // TILE[1])), np.bool_)
    find_dirty(rows[1], rows[0], rows[0].shape[1] // width * TILE[1], dirty)
    # tiles nearer to each other than this share a box, so that boxes with margins don't overlap
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
    """Return the least number of steps between two frames such that nothing moves or changes too far per step."""
    most = 0.0
    for (a, b), flow in zip(lines, flows, strict=True):
        if flow is None:
            most = max(most, _change(a, b, levels) / CHANGE)
        else:
            differs = np.abs(_gray(b) - _gray(a)) > FLAT
            most = max(most, *(float(np.hypot(*part[differs].T).max(initial=0)) / PIXELS for part in flow))
    return max(math.ceil(most), 1)


def _change(a: np.ndarray, b: np.ndarray, levels: tuple[int, int]) -> float:
    """Return the largest change of the logarithm of a pixel's brightness from image `a` to image `b`."""
    before, after = (image if levels == FULL else stretch_levels(image, levels) for image in (a, b))
    return float(np.abs(np.log((after + DARK) / (before + DARK))).max())


def _gray(image: np.ndarray) -> np.ndarray:
    return image if image.ndim == 2 else image.mean(axis=2)


def _flow(before: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the optical flow from each of two images to the other, float32 [H, W, 2] each; zero for flat images."""
    zero = np.zeros((*before.shape, 2), np.float32)
    if min(np.ptp(before), np.ptp(after)) <= FLAT:
        return zero, zero
    more = [(0, max(SMALLEST - side, 0)) for side in before.shape]
    a, b = (np.pad(np.rint(image).astype(np.uint8), more, mode="edge") for image in (before, after))
    # a new object each time, because it isn't thread-safe
    finder = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    there, back = (finder.calc(*pair, np.zeros((*a.shape, 2), np.float32)) for pair in ((a, b), (b, a)))
    inside = tuple(slice(side) for side in before.shape)
    return there[inside], back[inside]


def _warped(before: np.ndarray, after: np.ndarray, there: np.ndarray, back: np.ndarray, share: float) -> np.ndarray:
    """Return the image at the fraction `share` between two: both, moved along the flow, combined (Jiang et al. 2018).

    `there` and `back` are the flows from `before` to `after` and from `after` to `before`.
    """
    to_before = share * share * back - (1 - share) * share * there
    to_after = (1 - share) * (1 - share) * there - share * (1 - share) * back
    return (1 - share) * _moved(before, to_before) + share * _moved(after, to_after)


def _moved(image: np.ndarray, by: np.ndarray) -> np.ndarray:
    y, x = np.indices(image.shape[:2], dtype=np.float32)
    return cv2.remap(image, x + by[..., 0], y + by[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
