"""AEDAT 4 files of events: packets compressed with LZ4, and the table that tells where each is."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import numpy as np

from nvsdata.data.events import Events
from nvsdata.formats.aedat4_packets import EVENT, LZ4, MAGIC, PACKET, deflater
from nvsdata.formats.writing import Pieces, headed, time_comment

MOST = 8192  # events in a packet
STREAM = 0
SOURCE = "nvsdata"  # where a file names the camera
# a row of the table: where its layout is described, then its fields
ROW = np.dtype("<i4, <i4, <i8, <i4, <i4, <i8, <i8, <i8")
# of place, stream and size, number, first and last time
LAYOUT = struct.pack("<7H2x", 14, ROW.itemsize, 8, 16, 24, 32, 40)
XML = """<dv version="2.0">
    <node name="outInfo" path="/mainloop/Recorder/outInfo/">
        <node name="0" path="/mainloop/Recorder/outInfo/0/">
            <attr key="compression" type="string">LZ4</attr>
            <attr key="originalModuleName" type="string">nvsdata</attr>
            <attr key="originalOutputName" type="string">events</attr>
            <attr key="typeDescription" type="string">Array of events (polarity ON/OFF).</attr>
            <attr key="typeIdentifier" type="string">EVTS</attr>
            <node name="info" path="/mainloop/Recorder/outInfo/0/info/">
                <attr key="sizeX" type="int">{0}</attr>
                <attr key="sizeY" type="int">{1}</attr>
                <attr key="source" type="string">{source}</attr>
                <attr key="time" type="string">{2}</attr>
            </node>
        </node>
    </node>
</dv>
"""


def write(pieces: Pieces, path: Path) -> None:
    """Write events. ImportError if the package lz4 is missing."""
    compress, rows = deflater(), []
    end = -1  # where the table begins

    def header(pieces: Pieces) -> bytes:
        return _header(XML.format(*pieces.sensor_size, time_comment(pieces), source=SOURCE), end)

    with headed(path, pieces, header) as file:
        for part in chain.from_iterable(map(_parts, pieces)):
            content = compress(_events(part))
            file.write(struct.pack(PACKET, STREAM, len(content)))
            rows.append((0, 0, file.tell(), STREAM, len(content), len(part), part.t[0], part.t[-1]))
            file.write(content)
        end = file.tell()
        file.write(compress(_table(np.array(rows, ROW))))


def _parts(events: Events) -> Iterator[Events]:
    """The events of each packet."""
    for first in range(0, len(events), MOST):
        yield events[first : first + MOST]


def _header(xml: str, end: int) -> bytes:
    """What comes before the packets. Its length depends on that of `xml` alone."""
    text = xml.encode()
    # place of the table, name, its layout (places of the fields), the table, the string
    flat = struct.pack("<I4s5H2x", 20, b"IOHE", 10, 20, 4, 8, 16) + struct.pack("<iiqI", 12, LZ4[0], end, 4)
    flat += struct.pack("<I", len(text)) + text + b"\0"
    return MAGIC + struct.pack("<I", len(flat)) + flat


def _events(events: Events) -> bytes:
    """The content of a packet."""
    packed = np.zeros(len(events), EVENT)
    packed["t"], packed["x"], packed["y"], packed["on"] = events.columns
    # place of the table, name, its layout, the table, length of the vector
    flat = struct.pack("<I4s2x3HiII", 16, b"EVTS", 6, 8, 4, 6, 4, len(packed)) + packed.tobytes()
    return struct.pack("<I", len(flat)) + flat


def _table(rows: np.ndarray) -> bytes:
    """The table of the packets; `rows` is changed."""
    # bytes from where the length is on; the rows and their layout are aligned
    slots = 32 + 4 * np.arange(rows.size + 1)
    begin = int(slots[-1] + -slots[-1] % 8)
    at = begin + len(LAYOUT) + ROW.itemsize * np.arange(rows.size)
    rows["f0"] = at - begin
    ways = (at - slots[:-1]).astype("<u4").tobytes()
    flat = struct.pack("<I4s3H2xiII", 16, b"FTAB", 6, 8, 4, 8, 4, rows.size) + ways
    flat += bytes(begin - 4 - len(flat)) + LAYOUT + rows.tobytes()
    return struct.pack("<I", len(flat)) + flat
