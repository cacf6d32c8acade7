"""Files of every format with times of 32 bits or words of time, and damage to just these."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from lookalikes import AEDAT3_HEADER, aedat2_bytes, aedat3_packet, aedat4_bytes, evt2_bytes, evt3_bytes

import nvsdata
from nvsdata import Events, FormatError

# of each kind: the extension, bytes in a record, and those of them that hold the time
KINDS = {
    "dat": (".dat", 8, slice(0, 4)),
    "aedat2": (".aedat", 8, slice(4, 8)),
    "davis": (".aedat", 8, slice(4, 8)),
    "aedat1": (".aedat1", 6, slice(2, 6)),
    "atis": (".bin", 5, slice(2, 5)),
    "evt2": (".raw", 4, slice(0, 4)),
    "evt3": (".raw", 2, slice(0, 2)),
    "aedat3": (".aedat3", 4, slice(0, 4)),
    "aedat4": (".aedat4", 4, slice(0, 4)),
}
DVS128 = b"#!AER-DAT2.0\r\n# AEChip: eu.DVS128\r\n#End Of ASCII Header\r\n"
DAVIS = b"#!AER-DAT2.0\r\n# AEChip: eu.DAVIS240C\r\n#End Of ASCII Header\r\n"
WORDS = (0xFFFFFFFF, 0, 0x7FFFFFFF, 0x80000000, 0xFFFF0000, 0x0000FFFF)


def file_of(kind: str, n: int, rng: np.random.Generator) -> tuple[bytes, bytearray]:
    """Header and records of a sound file of some `n` events: dense or sparse, in order or nearly, near a wrap."""
    gaps = rng.integers(0, int(rng.choice((1, 30, 3_000, 1 << 20))) + 1, n)
    t = np.cumsum(gaps) + int(rng.choice((0, 1_000, 2**31 - 500, 2**32 - 5_000)))
    if rng.random() < 0.3:
        t = np.maximum(t + rng.integers(-40, 40, n), 0)
    x, y, p = rng.integers(0, 128, n), rng.integers(0, 128, n), rng.integers(0, 2, n)
    if kind == "dat":
        words = np.stack([t % 2**32, x | y << 14 | p << 28], 1).astype("<u4")
        return b"% Version 2\n% Width 128\n% Height 128\n\x0c\x08", bytearray(words.tobytes())
    if kind in ("aedat2", "aedat1"):
        raw = aedat2_bytes(y << 8 | x << 1 | p, t, b"")
        if kind == "aedat2":
            return DVS128, bytearray(raw)
        short = np.frombuffer(raw, np.uint8).reshape(-1, 8)[:, 2:]
        return DVS128.replace(b"2.0", b"1.0"), bytearray(short.tobytes())
    if kind == "davis":
        others = (rng.random(n) < 0.2).astype(int) << 31
        return DAVIS, bytearray(aedat2_bytes(others | y << 22 | x << 12 | p << 11, t, b""))
    t = np.sort(t) % (2**23 if kind == "atis" else 2**24 if kind == "evt3" else 2**31)
    ev = Events(t, x, y, p, (128, 128))
    if kind == "atis":
        rest = np.stack([x, y, ev.p << 7 | ev.t >> 16, ev.t >> 8 & 255, ev.t & 255], 1)
        rest[rng.random(n) < float(rng.choice((0, 0.02))), 1] = 240
        return b"", bytearray(rest.astype(np.uint8).tobytes())
    if kind == "aedat3":
        return AEDAT3_HEADER, bytearray(b"".join(aedat3_packet(ev[i : i + 50]) for i in range(0, n, 50)))
    if kind == "aedat4":
        raw = aedat4_bytes(ev, 0, (128, 128))
        begin = 18 + struct.unpack_from("<I", raw, 14)[0]
        return raw[:begin], bytearray(raw[begin:])
    header = b"% evt " + kind[3:].encode() + b".0\n% geometry 128x128\n% end\n"
    return header, bytearray((evt2_bytes if kind == "evt2" else evt3_bytes)(ev, header)[len(header) :])


def damage(kind: str, raw: bytearray, rng: np.random.Generator) -> bytes:
    """Some words of time set to extremes, flipped, swapped or shifted; records repeated, removed or moved."""
    _, size, where = KINDS[kind]
    records = np.frombuffer(bytes(raw[: len(raw) // size * size]), np.uint8).reshape(-1, size).copy()
    for _ in range(int(rng.integers(0, 4))):
        places = np.arange(len(records))
        if kind in ("evt2", "evt3"):
            places = np.flatnonzero(records[:, -1] >> 4 == 8)
        if len(places) < 2:
            break
        at = int(rng.choice((0, len(places) - 1))) if rng.random() < 0.1 else int(rng.integers(0, len(places)))
        some = places[at : at + int(rng.choice((1, 1, 1, 2, 30)))]
        what = rng.integers(0, 7)
        if what == 0:
            _set_words(kind, records, some, int(rng.choice(WORDS)))
        elif what == 1:
            _set_words(kind, records, some, int.from_bytes(rng.bytes(4), "little"))
        elif what == 2:
            byte = where.start if kind in ("aedat2", "davis", "aedat1", "atis") else where.stop - 1
            flip = 1 << int(rng.integers(0, 4 if kind.startswith("evt") else 8))
            records[some, byte] ^= flip
        elif what == 3:
            other = int(rng.choice(places))
            records[[some[0], other], where] = records[[other, some[0]], where]
        elif what == 4:
            records = np.insert(records, int(rng.choice(places)), records[some], 0)
        elif what == 5:
            records = np.delete(records, some, 0)
        else:
            cut = int(some[0])
            records = np.concatenate((records[cut:], records[:cut])) if rng.random() < 0.3 else np.flipud(records)
    return records.tobytes()


def _set_words(kind: str, records: np.ndarray, some: np.ndarray, word: int) -> None:
    where = KINDS[kind][2]
    order = "<" if kind in ("dat", "evt2", "evt3", "aedat3", "aedat4") else ">"
    raw = np.frombuffer(struct.pack(f"{order}I", word), np.uint8)
    last = records[some, -1].copy()
    records[some, where] = raw[: where.stop - where.start]
    if kind in ("evt2", "evt3"):
        # the kind of the words stays
        records[some, -1] = last & 0xF0 | records[some, -1] & 0x0F
    elif kind == "atis":
        records[some, 2] &= 0x7F


def disagreement(path: Path, rng: np.random.Generator, block: int | None = None) -> str:
    """What windows and span say otherwise than the whole file, strictly read and repaired; nothing if they agree.

    A file that can't be read as a whole has nothing to agree with.
    """
    for strict in (True, False):
        try:
            whole = opened(path, strict, block).read()
        except FormatError as error:
            if not str(error).startswith(str(path)):
                return f"an error that doesn't name the file: {error}"
            continue
        span = (int(whole.t[0]), int(whole.t[-1])) if len(whole) else (0, 0)
        if (result := opened(path, strict, block).span) != span:
            return f"strict={strict}: span {result}, events from {span[0]} to {span[1]}"
        recording = opened(path, strict, block)
        for _ in range(2):
            edges = rng.choice(whole.t, 2) if len(whole) else np.array([0, 10])
            a, b = np.sort(edges + rng.integers(-2, 60, 2)).tolist()
            for start, stop in ((a, b), (None, a), (b, None)):
                if recording.read(start, stop) != whole.window(start, stop):
                    return f"strict={strict}: the window [{start}, {stop}) differs from the whole's"
    return ""


def opened(path: Path, strict: bool, block: int | None) -> nvsdata.Recording:
    """The recording, with an index of blocks of so many records."""
    recording = nvsdata.open(path, strict=strict)
    if block is not None:
        recording.block = block  # type: ignore[attr-defined]
    return recording
