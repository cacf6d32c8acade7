"""Frames, inertial samples and triggers in the packets of AEDAT 4 files. struct.error or ValueError for broken ones."""

from __future__ import annotations

import numpy as np

from nvsdata.data.samples import Frame, Inertial, Triggers
from nvsdata.formats.flatbuffer import Rows, Table

RISING, FALLING, PULSE = 1, 2, 3  # types of external triggers; others are the camera's own signals


def frame_of(payload: memoryview) -> Frame:
    """The frame of a packet; of a colored one, its gray values."""
    table = Table.root(payload, 4, b"FRME")
    time, first, last, begin, end = (table.number(field, "<q", 0) for field in range(5))
    width, height, x, y = (table.number(field, "<h", 0) for field in range(6, 10))
    kind = table.number(5, "<b", 0)
    # as OpenCV numbers them: depth in three bits, then channels less one
    depth, channels = {0: np.uint8, 2: np.uint16}.get(kind & 7), (kind >> 3) + 1
    place, size = table.vector(10)
    if depth is None or min(width, height) < 1 or size != width * height * channels * np.dtype(depth).itemsize:
        raise ValueError(f"a frame of {width}x{height} pixels of type {kind} in {size} bytes")
    pixels = np.frombuffer(payload, depth, width * height * channels, place).reshape(height, width, channels)
    begin = begin or time
    return Frame(first or begin, begin, max(end, begin), max(last, end, begin), x, y, _gray(pixels).astype(np.uint16))


def _gray(pixels: np.ndarray) -> np.ndarray:
    if pixels.shape[2] == 1:
        return pixels[..., 0]
    import cv2

    how = {3: cv2.COLOR_BGR2GRAY, 4: cv2.COLOR_BGRA2GRAY}.get(pixels.shape[2])
    if how is None:
        raise ValueError(f"a frame of {pixels.shape[2]} channels")
    gray: np.ndarray = cv2.cvtColor(pixels, how)
    return gray


def inertial_of(payload: memoryview) -> Inertial:
    """The inertial samples of a packet."""
    rows = Rows(payload, *Table.root(payload, 4, b"IMUS").vector(0))
    temperature, *rest = (rows.column(field, "<f4") for field in range(1, 8))
    return Inertial(rows.column(0, "<i8"), np.stack(rest[:3], 1), np.stack(rest[3:], 1), temperature)


def triggers_of(payload: memoryview) -> Triggers:
    """The external triggers of a packet; a pulse counts as rising."""
    rows = Rows(payload, *Table.root(payload, 4, b"TRIG").vector(0))
    kind = rows.column(1, "<i1")
    external = (kind >= RISING) & (kind <= PULSE)
    level = (kind[external] != FALLING).astype(np.uint8)
    return Triggers(rows.column(0, "<i8")[external], np.zeros(level.size, np.uint8), level)
