"""Writer of AEDAT 4 files of events, frames and inertial samples: packets compressed by LZ4, and a table of them."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Sequence, Set
from pathlib import Path
from typing import Any

import numpy as np

from nvsdata.data.events import Events
from nvsdata.data.samples import Piece
from nvsdata.formats.aedat.aedat4_packets import EVENT, LZ4, MAGIC, PACKET, deflater
from nvsdata.formats.aedat.aedat4_samples import pack_frame, pack_inertial
from nvsdata.formats.aedat.flatbuffer import layout_of, packed_vector
from nvsdata.formats.writing import Pieces, file_with_header, time_comment

MOST = 8192  # events in a packet
SOURCE = "nvsdata"  # in place of the camera's name, if that is unknown
LONGEST = 64  # bytes of a camera's name
XML_BYTES = 3072  # the description of streams is padded to this size
# a row of the table: offset of its layout, padding (a named field, so that it is set to 0), fields
ROW = np.dtype(
    {
        "names": ["way", "gap", "at", "stream", "size", "count", "first", "last"],
        "formats": ["<i4", "<i4", "<i8", "<i4", "<i4", "<i8", "<i8", "<i8"],
        "offsets": [0, 4, 8, 16, 20, 24, 32, 40],
    }
)
LAYOUT = layout_of(ROW.itemsize, (8, 16, 24, 32, 40))
XML = """<dv version="2.0">
    <node name="outInfo" path="/mainloop/Recorder/outInfo/">
{streams}    </node>
</dv>
"""
STREAM = """        <node name="{number}" path="/mainloop/Recorder/outInfo/{number}/">
            <attr key="compression" type="string">LZ4</attr>
            <attr key="originalModuleName" type="string">nvsdata</attr>
            <attr key="originalOutputName" type="string">{name}</attr>
            <attr key="typeDescription" type="string">{description}</attr>
            <attr key="typeIdentifier" type="string">{kind}</attr>
            <node name="info" path="/mainloop/Recorder/outInfo/{number}/info/">
{facts}            </node>
        </node>
"""
FACT = """                <attr key="{}" type="{}">{}</attr>
"""
# name, type and description of the streams, by number
EVENTS, FRAMES, SAMPLES = range(3)
STREAMS = (
    ("events", "EVTS", "Array of events (polarity ON/OFF)."),
    ("frames", "FRME", "Standard frame (8-bit image)."),
    ("imu", "IMUS", "Inertial Measurement Unit data samples."),
)


def write(pieces: Pieces, path: Path) -> None:
    """Write events, frames and inertial samples. ImportError if the package lz4 is missing."""
    compress = deflater()
    rows: list[tuple[Any, ...]] = []
    about: dict[str, Any] = {}
    end = -1  # offset of the table

    def header(pieces: Pieces) -> bytes:
        # the streams and the camera's name are known only after all pieces
        seen = {EVENTS, *(stream for _, _, _, stream, *_ in rows)}
        camera = re.sub(r"[^ -~]|[<>&]", "?", str(about.get("camera", SOURCE)))
        return _header(_xml(pieces, seen, camera[:LONGEST]).ljust(XML_BYTES), end)

    with file_with_header(path, pieces, header) as file:
        for piece in pieces:
            for stream, content, times in _packets(piece):
                packed = compress(content)
                file.write(struct.pack(PACKET, stream, len(packed)))
                rows.append((0, 0, file.tell(), stream, len(packed), len(times), times[0], times[-1]))
                file.write(packed)
            about.update(piece.about if isinstance(piece, Piece) else {})
        end = file.tell()
        file.write(compress(packed_vector(b"FTAB", np.array(rows, ROW), LAYOUT)))


def _packets(piece: Events) -> Iterator[tuple[int, bytes, Sequence[int] | np.ndarray]]:
    """Divide a piece of a recording into packets; yield the stream number, content and times of each."""
    for part in _parts(piece):
        yield EVENTS, _events(part), part.t
    if isinstance(piece, Piece):
        for frame in piece.frames:
            yield FRAMES, pack_frame(frame), [frame.exposure_start]
        if piece.inertial.t.size:
            yield SAMPLES, pack_inertial(piece.inertial), piece.inertial.t


def _xml(pieces: Pieces, streams: Set[int], source: str) -> str:
    """Return the description of the streams; its length depends on their number and on the camera's name."""
    facts = FACT.format("source", "string", source)
    size = "".join(FACT.format(f"size{axis}", "int", side) for axis, side in zip("XY", pieces.sensor_size, strict=True))
    time = FACT.format("time", "string", time_comment(pieces))
    facts_of = ((size, facts, time), (size, facts), (facts,))
    return XML.format(
        streams="".join(
            STREAM.format(number=n, name=name, description=description, kind=kind, facts="".join(facts_of[n]))
            for n, (name, kind, description) in enumerate(STREAMS)
            if n in streams
        )
    )


def _parts(events: Events) -> Iterator[Events]:
    """Yield the events of each packet."""
    for first in range(0, len(events), MOST):
        yield events[first : first + MOST]


def _header(xml: str, end: int) -> bytes:
    """Return the bytes before the packets. Their number depends only on the length of `xml`."""
    text = xml.encode()
    # offset of the table, name, its layout (offsets of the fields), the table, the string
    flat = struct.pack("<I4s5H2x", 20, b"IOHE", 10, 20, 4, 8, 16) + struct.pack("<iiqI", 12, LZ4[0], end, 4)
    flat += struct.pack("<I", len(text)) + text + b"\0"
    return MAGIC + struct.pack("<I", len(flat)) + flat


def _events(events: Events) -> bytes:
    """Return the content of a packet of events."""
    packed = np.zeros(len(events), EVENT)
    packed["t"], packed["x"], packed["y"], packed["on"] = events.columns
    # offset of the table, name, its layout, the table, length of the vector
    flat = struct.pack("<I4s2x3HiII", 16, b"EVTS", 6, 8, 4, 6, 4, len(packed)) + packed.tobytes()
    return struct.pack("<I", len(flat)) + flat
