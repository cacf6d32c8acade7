"""HDF5 files as Metavision writes them: events compressed by ECF, chunk by chunk."""

import io
import struct
from itertools import groupby

import h5py
import numpy as np

ECF = 0x8ECF
EVENT = np.dtype(
    {"names": list("xypt"), "formats": ["<u2", "<u2", "<i2", "<i8"], "offsets": [0, 2, 4, 8], "itemsize": 16}
)
SEPARATE, X_WITH_POLARITY, TOGETHER = range(3)


def metavision_bytes(ev, chunk=16_384, coding=SEPARATE):
    """A file of events. The last chunk has only the events that are there, as Metavision writes it."""
    raw = io.BytesIO()
    with h5py.File(raw, "w") as file:
        layout = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        layout.set_chunk((chunk,))
        layout.set_filter(ECF, h5py.h5z.FLAG_OPTIONAL, ())
        space = h5py.h5s.create_simple((len(ev),), (h5py.h5s.UNLIMITED,))
        kind = h5py.h5t.py_create(EVENT, logical=True)
        made = h5py.h5d.create(file.create_group("CD").id, b"events", kind, space, layout)
        for first in range(0, len(ev), chunk):
            made.write_direct_chunk((first,), ecf_bytes(*ev[first : first + chunk].columns, coding))
        file.attrs["geometry"] = "{}x{}".format(*ev.sensor_size)
        file.attrs["version"] = "1.0"
    return raw.getvalue()


def ecf_bytes(t, x, y, p, coding):
    """A chunk of events whose times never fall."""
    t, x, y, p = (column.tolist() for column in (t, x, y, p))
    head = struct.pack("<IQ", len(t) << 2 | coding, t[0]) + times(t)
    if coding == TOGETHER:
        return head + fours([b << 12 | a << 1 | c for a, b, c in zip(x, y, p, strict=True)], 24)
    head += b"".join(
        struct.pack("<H", b << 5 | n) if n < 31 else struct.pack("<HH", b << 5 | 31, n) for b, n in runs(y)
    )
    if coding == X_WITH_POLARITY:
        return head + fours([a << 1 | c for a, c in zip(x, p, strict=True)], 12)
    head += columns(x)
    return head + b"".join(bytes([c << 7 | n]) if n < 127 else struct.pack("<BH", c << 7 | 127, n) for c, n in runs(p))


def runs(values):
    return [(value, len(list(same))) for value, same in groupby(values)]


def times(t):
    """Differences, and how many events have each time."""
    raw, before = bytearray(), t[0]
    for now, count in runs(t):
        gap, before = now - before, now
        if gap >= 15:
            while gap:
                raw.append(0xF0 | gap & 15)
                gap >>= 4
        raw += bytes([gap << 4 | count]) if count < 15 else struct.pack("<BH", gap << 4 | 15, count)
    return raw


def columns(x):
    """Each x, with a bit for each of the five columns to the right that follow."""
    raw, x = bytearray(), list(x)
    while x:
        first, mask = x.pop(0), 0
        for right in range(1, 6):
            if x and x[0] == first + right:
                mask |= 1 << (5 - right)
                x.pop(0)
        raw += struct.pack("<H", first << 5 | mask)
    return bytes(raw)


def fours(values, bits):
    """Four numbers in three words: the middle two are divided, their lowest bits first."""
    word, part = (16, 4) if bits == 12 else (32, 8)
    words = []
    for i in range(0, len(values), 4):
        a, b, c, d = (values[i : i + 4] + [0] * 3)[:4]
        words.append(a << part | b % (1 << part))
        words.append(b >> part << 2 * part | c % (1 << 2 * part))
        words.append(c >> 2 * part << bits | d)
    return b"".join(one.to_bytes(word // 8, "little") for one in words)
