"""Frames, inertial samples and triggers in packets of AEDAT 4.

Damaged packets raise struct.error or ValueError.
"""

from __future__ import annotations

import struct

import numpy as np

from nvsdata.data.samples import Frame, Inertial, Triggers
from nvsdata.formats.aedat.flatbuffer import Rows, Table, layout_of, packed_vector

RISING, FALLING, PULSE = 1, 2, 3  # types of external triggers; others are the camera's own signals
LONG = 1_000_000  # µs; longer than the time from a frame's first to its last time
LARGEST = 2**15 - 1  # pixels along a side
GRAY_8, GRAY_16 = 0, 2  # types of frames, as OpenCV numbers them
SAMPLE = np.dtype(
    [("way", "<i4"), ("temperature", "<f4"), ("t", "<i8"), ("acceleration", "<f4", 3), ("rotation", "<f4", 3)]
)
SAMPLE_LAYOUT = layout_of(SAMPLE.itemsize, (8, 4, 16, 20, 24, 28, 32, 36))
FRAME_LAYOUT = layout_of(60, (4, 12, 20, 28, 36, 52, 44, 46, 48, 50, 56))


def unpack_frame(payload: memoryview) -> Frame:
    """Return the frame of a packet; colors are converted to gray."""
    table = Table.root(payload, 4, b"FRME")
    time = table.number(0, "<q", 0)
    # a time of 0 may mean unknown, except near the clock's start
    begin = table.number(3, "<q", time)
    begin = begin if begin or abs(time) < LONG else time
    first = table.number(1, "<q", begin)
    first = first if first or abs(begin) < LONG else begin
    last, end = (table.number(field, "<q", 0) for field in (2, 4))
    width, height, x, y = (table.number(field, "<h", 0) for field in range(6, 10))
    kind = table.number(5, "<b", 0)
    # numbers of OpenCV: depth in three bits, then the number of channels minus 1
    depth, channels = {0: np.uint8, 2: np.uint16}.get(kind & 7), (kind >> 3) + 1
    place, size = table.vector(10)
    if depth is None or min(width, height) < 1 or size != width * height * channels * np.dtype(depth).itemsize:
        raise ValueError(f"a frame of {width}x{height} pixels of type {kind} in {size} bytes")
    pixels = np.frombuffer(payload, depth, width * height * channels, place).reshape(height, width, channels)
    return Frame(first, begin, max(end, begin), max(last, end, begin), x, y, _gray(pixels).astype(np.uint16))


def pack_frame(frame: Frame) -> bytes:
    """Return the content of a packet with a frame, with 8 bits per pixel if they suffice, otherwise 16."""
    height, width = frame.pixels.shape
    if min(height, width) < 1 or max(height, width, abs(frame.x), abs(frame.y)) > LARGEST:
        raise ValueError(
            f"a frame of {width}x{height} at {frame.x}, {frame.y}: AEDAT 4 supports 1 to {LARGEST} pixels along a side"
        )
    small = int(frame.pixels.max(initial=0)) < 256
    kind, pixels = (GRAY_8, frame.pixels.astype(np.uint8)) if small else (GRAY_16, frame.pixels.astype("<u2"))
    times = frame.exposure_start, frame.start, frame.end, frame.exposure_start, frame.exposure_end
    # offset of the table, name, layout, offset back to it; the fields; offset of the pixels, and their number
    flat = struct.pack("<I4s", 40, b"FRME") + FRAME_LAYOUT
    flat += (
        struct.pack("<i5q4hb3xII", len(FRAME_LAYOUT), *times, width, height, frame.x, frame.y, kind, 4, pixels.nbytes)
        + pixels.tobytes()
    )
    return struct.pack("<I", len(flat)) + flat


def _gray(pixels: np.ndarray) -> np.ndarray:
    if pixels.shape[2] == 1:
        return pixels[..., 0]
    import cv2

    how = {3: cv2.COLOR_BGR2GRAY, 4: cv2.COLOR_BGRA2GRAY}.get(pixels.shape[2])
    if how is None:
        raise ValueError(f"a frame of {pixels.shape[2]} channels")
    gray: np.ndarray = cv2.cvtColor(pixels, how)
    return gray


def unpack_inertial(payload: memoryview) -> Inertial:
    """Return the inertial samples of a packet."""
    rows = Rows(payload, *Table.root(payload, 4, b"IMUS").vector(0))
    temperature, *rest = (rows.column(field, "<f4") for field in range(1, 8))
    return Inertial(rows.column(0, "<i8"), np.stack(rest[:3], 1), np.stack(rest[3:], 1), temperature)


def pack_inertial(samples: Inertial) -> bytes:
    """Return the content of a packet with inertial samples."""
    rows = np.zeros(samples.t.size, SAMPLE)
    for name, column in samples._asdict().items():
        rows[name] = column
    return packed_vector(b"IMUS", rows, SAMPLE_LAYOUT)


def unpack_triggers(payload: memoryview) -> Triggers:
    """Return the external triggers of a packet; a pulse counts as a rising edge."""
    rows = Rows(payload, *Table.root(payload, 4, b"TRIG").vector(0))
    kind = rows.column(1, "<i1")
    external = (kind >= RISING) & (kind <= PULSE)
    level = (kind[external] != FALLING).astype(np.uint8)
    return Triggers(rows.column(0, "<i8")[external], np.zeros(level.size, np.uint8), level)
