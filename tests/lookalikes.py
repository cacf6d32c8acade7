"""Files as cameras and other programs write them, made byte by byte from the formats' descriptions."""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io

from nvsdata import Events


def matlab_bytes(ev: Events, compress: bool = True, **more: np.ndarray) -> bytes:
    """A MATLAB v5 file with columns ts, x, y, pol, [N, 1] each, as ASL-DVS has them."""
    columns = {"ts": ev.t, "x": ev.x, "y": ev.y, "pol": ev.p} | more
    file = io.BytesIO()
    scipy.io.savemat(file, {name: np.asarray(c).reshape(-1, 1) for name, c in columns.items()}, do_compression=compress)
    return file.getvalue()


MATLAB_73 = b"MATLAB 7.3 MAT-file, Platform: PCWIN64".ljust(512)


def hdf5_bytes(datasets: dict[str, dict[str, Any]], before: bytes = b"") -> bytes:
    """HDF5 as h5py writes it by default, of what its `create_dataset` takes for each name; `before` it other bytes."""
    whole = io.BytesIO()
    with h5py.File(whole, "w", userblock_size=len(before)) as file:
        for name, how in datasets.items():
            file.create_dataset(name, **how)
    return before + whole.getvalue()[len(before) :]


def lead_elsewhere(file: h5py.File, name: str, how: str, other: Path, shape: tuple[int, ...], kind: Any) -> None:
    """Make a dataset of an open file one whose values `other` holds, in one of the ways that HDF5 knows."""
    if how == "external link":
        file[name] = h5py.ExternalLink(other, name)
    elif how == "virtual":
        layout = h5py.VirtualLayout(shape, kind)
        layout[:] = h5py.VirtualSource(other, name, shape)
        file.create_virtual_dataset(name, layout)
    else:
        size = int(np.prod(shape)) * np.dtype(kind).itemsize
        file.create_dataset(name, shape, kind, external=[(str(other), 0, size)])


def evt2_bytes(ev: Events, header: bytes = b"% evt 2.0\n% end\n") -> bytes:
    """EVT2: a word of high time whenever it changes, then a word an event."""
    out = bytearray(header)
    high = -1
    for t, x, y, p in rows(ev):
        if t >> 6 != high:
            high = t >> 6
            out += struct.pack("<I", 0x8 << 28 | high & 0xFFFFFFF)
        out += struct.pack("<I", p << 28 | (t & 63) << 22 | x << 11 | y)
    return bytes(out)


def evt21_bytes(ev: Events, header: bytes = b"% evt 2.1\n% end\n", little: bool = False) -> bytes:
    """EVT 2.1: like EVT2, with a bit for each of the 32 pixels from x on; `little`: with its halves exchanged."""
    out = bytearray(header)

    def word(head: int, mask: int) -> None:
        out.extend(struct.pack("<II", *((mask, head) if little else (head, mask))))

    high = -1
    groups: list[list[int]] = []
    for t, x, y, p in rows(ev):
        if t >> 6 != high:
            high = t >> 6
            groups.append([0x8 << 28 | high & 0xFFFFFFF, 0])
        head = p << 28 | (t & 63) << 22 | x // 32 * 32 << 11 | y
        bit = 1 << x % 32
        if groups[-1][0] == head and groups[-1][1] < bit:
            groups[-1][1] |= bit
        else:
            groups.append([head, bit])
    for head, mask in groups:
        word(head, mask)
    return bytes(out)


def evt3_bytes(ev: Events, header: bytes = b"% evt 3.0\n% end\n", vectors: bool = True) -> bytes:
    """EVT3: rows, columns and times as they change; neighbors in a row at one time as vectors."""
    out = bytearray(header)

    def word(kind: int, value: int) -> None:
        out.extend(struct.pack("<H", kind << 12 | value))

    high = low = row = -1
    events = list(rows(ev))
    i = 0
    while i < len(events):
        t, x, y, p = events[i]
        # the high part is told at every step of it, so that a reader can count its wraps
        while high != t >> 12:
            high = t >> 12 if high < 0 else min(high + (1 << 11) - 1, t >> 12)
            word(0x8, high & 0xFFF)
            low = 0
        if t & 0xFFF != low:
            low = t & 0xFFF
            word(0x6, low)
        if y != row:
            row = y
            word(0x0, row)
        run = [x]
        while i + len(run) < len(events) and events[i + len(run)][0::2] == (t, y) and events[i + len(run)][3] == p:
            after = events[i + len(run)][1]
            if not run[-1] < after < x + 20:
                break
            run.append(after)
        if vectors and len(run) > 1:
            word(0x3, p << 11 | x)
            mask = sum(1 << (column - x) for column in run)
            word(0x4, mask & 0xFFF)
            word(0x5, mask >> 12)
            i += len(run)
        else:
            word(0x2, p << 11 | x)
            i += 1
    return bytes(out)


def aedat2_bytes(address: np.ndarray, time: np.ndarray, header: bytes = b"#!AER-DAT2.0\r\n") -> bytes:
    """AEDAT 2.0: big-endian address and time."""
    return header + b"".join(struct.pack(">II", a, t % 2**32) for a, t in zip(address, time, strict=True))


def aedat3_packet(ev: Events, kind: int = 1, valid: bool = True, overflow: int = 0, marked: int | None = None) -> bytes:
    """One AEDAT 3.1 packet of polarity events, or of eight-byte events of another `kind`."""
    n = len(ev)
    head = struct.pack("<HHIIIIII", kind, 1, 8, 4, overflow, n, n, n if marked is None else marked)
    return head + b"".join(struct.pack("<II", x << 17 | y << 2 | p << 1 | valid, t) for t, x, y, p in rows(ev))


AEDAT3_HEADER = (
    b"#!AER-DAT3.1\r\n#Format: RAW\r\n#Source 1: DVS128\r\n"
    b"#Start-Time: 2020-11-19 18:13:37 (TZ+0300)\r\n#!END-HEADER\r\n"
)


def rows(ev: Events):
    """Events as tuples (t, x, y, p) of ints."""
    return zip(ev.t.tolist(), ev.x.tolist(), ev.y.tolist(), ev.p.tolist(), strict=True)


def aedat4_bytes(ev: Events, compression: int = 0, size: tuple[int, int] = (320, 240), packet: int = 50) -> bytes:
    """AEDAT 4 with a stream of events and one of something else, flatbuffers laid out by hand."""
    xml = f"""<dv version="2.0"><node name="outInfo" path="/mainloop/Recorder/outInfo/">
        <node name="0"><attr key="typeIdentifier" type="string">IMUS</attr></node>
        <node name="1"><attr key="typeIdentifier" type="string">EVTS</attr>
        <node name="info"><attr key="sizeX" type="int">{size[0]}</attr>
        <attr key="sizeY" type="int">{size[1]}</attr></node></node></node></dv>""".encode()
    # root offset, identifier, vtable (4, 8 and 16 are the fields' places), table, string
    header = struct.pack("<I4s5H2x", 20, b"IOHE", 10, 20, 4, 8, 16) + struct.pack("<iiqI", 12, compression, -1, 4)
    header += struct.pack("<I", len(xml)) + xml + b"\0"
    out = b"#!AER-DAT4.0\r\n" + struct.pack("<I", len(header)) + header
    for start in range(0, len(ev), packet):
        out += aedat4_packet(0, b"other", 0)
        out += aedat4_packet(1, aedat4_events(ev[start : start + packet]), compression)
    return out


def aedat4_events(ev: Events) -> bytes:
    """The content of a packet of events, before it is compressed."""
    body = struct.pack("<I4s3H2xiII", 16, b"EVTS", 6, 8, 4, 8, 4, len(ev))
    body += b"".join(struct.pack("<qhhB3x", t, x, y, p) for t, x, y, p in rows(ev))
    return struct.pack("<I", len(body)) + body


def aedat4_packet(stream: int, body: bytes, compression: int) -> bytes:
    """A packet with its header."""
    if compression in (1, 2):
        import lz4.frame

        body = lz4.frame.compress(body)
    elif compression in (3, 4):
        import zstandard

        body = zstandard.ZstdCompressor().compress(body)
    return struct.pack("<ii", stream, len(body)) + body


def saccade(rng: np.random.Generator, digit: int, n: int) -> tuple[np.ndarray, ...]:
    """Columns t, x, y, p of a bar that sweeps the sensor at an angle given by the digit."""
    t = np.sort(rng.integers(0, 100_000, n))
    along = rng.uniform(-12, 12, n)
    across = 10 * np.sin(2 * np.pi * t / 100_000)
    c, s = np.cos(digit * np.pi / 10), np.sin(digit * np.pi / 10)
    x = np.clip(17 + c * along - s * across, 0, 33).astype(int)
    y = np.clip(17 + s * along + c * across, 0, 33).astype(int)
    return t, x, y, rng.integers(0, 2, n)


def atis_bytes(t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> bytes:
    """ATIS records, straight from the format's description."""
    out = bytearray()
    for ti, xi, yi, pi in zip(t.tolist(), x.tolist(), y.tolist(), p.tolist(), strict=True):
        out += bytes([xi, yi, pi << 7 | ti >> 16, ti >> 8 & 0xFF, ti & 0xFF])
    return bytes(out)
