"""Head and index of a packed store's file (`docs/dev/store.md`)."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from nvsdata.common.files import parsed_line
from nvsdata.formats.registry import STORE
from nvsdata.kernels.decode.blocks import crc32c

VERSION = 3
# magic; version; checksum of the rest; place, size and checksum of the index
FILE_HEAD = struct.Struct("<8sIIQQI")
BEGIN = 64  # place of the first recording
TEXTS = ("name", "folder", "left_out", "reason", "file_name")
NUMBERS = {"place": "<u8", "bytes": "<u8", "check": "<u4", "file_end": "<u8"}
SECTIONS = ("facts", "place", "bytes", "check", *TEXTS, "file_end", "file_data")
ALIGNED = 8  # bytes; records and sections begin at multiples


def file_head(place: int, index: bytes) -> bytes:
    """Return the first `BEGIN` bytes of a store whose index begins at `place`."""
    own = struct.pack("<QQI", place, len(index), crc32c(np.frombuffer(index, np.uint8))).ljust(BEGIN - 16, b"\0")
    return STORE + struct.pack("<II", VERSION, crc32c(np.frombuffer(own, np.uint8))) + own


def index_place(head: bytes, size: int) -> tuple[int, int, int]:
    """Return place, size and checksum of the index of a store of `size` bytes that begins with `head`.

    Raises:
        ValueError: the head isn't one of a store of this version, is damaged, or the store is cut short.
    """
    if len(head) < BEGIN:
        raise ValueError("is cut short")
    magic, version, check, place, length, of_index = FILE_HEAD.unpack_from(head)
    if magic != STORE:
        raise ValueError("isn't a packed store")
    if version != VERSION:
        raise ValueError(f"is of version {version}, and this nvsdata reads up to {VERSION}: install a newer one")
    if crc32c(np.frombuffer(head[16:BEGIN], np.uint8)) != check:
        raise ValueError("its first bytes fail their checksum: pack it again")
    if place < BEGIN or place + length != size:
        raise ValueError("is cut short, or has more bytes than it states: pack it again")
    return place, length, of_index


def packed_index(facts: dict[str, Any], **sections: Any) -> bytes:
    """Return the bytes of an index: the length of each section, then the sections."""
    values = {"facts": json.dumps(facts).encode(), "file_data": sections["file_data"]}
    values |= {name: pack_texts(sections[name]) for name in TEXTS}
    values |= {name: np.array(sections[name], kind).tobytes() for name, kind in NUMBERS.items()}
    parts = [values[name] for name in SECTIONS]
    lengths = np.array([len(part) for part in parts], "<u8").tobytes()
    return lengths + b"".join(part + bytes(-len(part) % ALIGNED) for part in parts)


def unpacked_index(raw: bytes) -> dict[str, Any]:
    """Return facts, arrays and texts of an index.

    Raises:
        ValueError: the sections contradict each other.
    """
    given = dict(zip(SECTIONS, _sections(raw), strict=True))
    facts = parsed_line(given["facts"]) or {}
    kinds = {"dataset": str, "split": str, "fold": int}
    if any(type(facts.get(name)) is not kind for name, kind in kinds.items()):
        raise ValueError("its index doesn't state the dataset")
    found: dict[str, Any] = facts | {name: unpack_texts(given[name]) for name in TEXTS}
    for name, kind in NUMBERS.items():
        if len(given[name]) % np.dtype(kind).itemsize:
            raise ValueError(f"its index has {len(given[name])} bytes of {name}")
        numbers = np.frombuffer(given[name], kind)
        if (numbers > np.iinfo(np.int64).max).any():
            raise ValueError(f"its index has impossible values of {name}")
        found[name] = numbers.astype(np.int64)
    found["file_data"] = given["file_data"]
    names, place, ends = found["name"], found["place"], found["file_end"]
    if not (
        len(place) == len(names) + 1
        and len(found["bytes"]) == len(found["check"]) == len(names)
        and len({*names, *found["left_out"], *found["file_name"]})
        == len(names) + len(found["left_out"]) + len(found["file_name"])
        and len(found["left_out"]) == len(found["reason"])
        and place[0] == BEGIN
        and (np.diff(place) > 0).all()
        and (place % ALIGNED == 0).all()
        and len(ends) == len(found["file_name"])
        and (np.diff(ends, prepend=0) >= 0).all()
        and (ends[-1] if len(ends) else 0) == len(given["file_data"])
    ):
        raise ValueError("its index contradicts itself: pack it again")
    return found


def _sections(raw: bytes) -> Iterator[bytes]:
    """Yield the sections; ValueError if there isn't one of each, one after the other up to the end."""
    at = 8 * len(SECTIONS)
    lengths = np.frombuffer(raw[:at], "<u8").tolist() if len(raw) >= at else []
    if len(raw) < at or at + sum(length + -length % ALIGNED for length in lengths) != len(raw):
        raise ValueError("its index contradicts itself: pack it again")
    for length in lengths:
        yield raw[at : at + length]
        at += length + -length % ALIGNED


def pack_texts(texts: Iterable[str]) -> bytes:
    """Return strings as bytes: UTF-8, each followed by a zero byte, which no file name contains."""
    return "".join(text + "\0" for text in texts).encode("utf-8", "surrogatepass")


def unpack_texts(kept: bytes) -> list[str]:
    """Return the strings that `pack_texts` converted to bytes; ValueError if they aren't UTF-8."""
    *texts, rest = kept.decode("utf-8", "surrogatepass").split("\0")
    if rest:
        raise ValueError("its index has a text without an end")
    return texts
