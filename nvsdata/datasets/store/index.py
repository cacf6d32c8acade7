"""Head and index of a packed store's file (`docs/dev/store.md`)."""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Iterable, Iterator
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np

from nvsdata.common.files import parsed_line
from nvsdata.datasets.store.names import Names
from nvsdata.formats.registry import STORE
from nvsdata.kernels.decode.blocks import crc32c

VERSION = 3
# magic; version; checksum of the rest; place, size and checksum of the index
FILE_HEAD = struct.Struct("<8sIIQQI")
BEGIN = 64  # place of the first recording
TEXTS = ("name", "folder", "left_out", "reason", "file_name", "part")
NUMBERS = {"place": "<u8", "bytes": "<u8", "check": "<u4", "file_end": "<u8", "label": "<u4", "position": "<u4"}
OPTIONAL = ("label", "position", "part")  # sections of a store of precomputed samples
SECTIONS = ("facts", "place", "bytes", "check", *TEXTS[:-1], "file_end", "file_data", *OPTIONAL)
WHOLE = "(0|-?[1-9][0-9]{0,18})"
PART = re.compile(f"(?: {WHOLE}-{WHOLE})?(?: {WHOLE}[+]{WHOLE})?")  # as `Sample.part` writes it
ALIGNED = 8  # bytes; records and sections begin at multiples


class Shard(NamedTuple):
    """A shard as an index file states it.

    Attributes:
        file: name of the file, which is in the folder of the index file.
        bytes: bytes of its records.
        head: checksum of the first bytes of the file, which have the checksum of its own index.
    """

    file: str
    bytes: int
    head: int


class Precomputing(NamedTuple):
    """Transforms and classes of precomputed samples.

    Attributes:
        transform: the transform's repr.
        classes: names of the classes.
    """

    transform: str
    classes: list[str]


def head_check(head: bytes) -> int:
    """Return the checksum of a store's first `BEGIN` bytes, by which the index of joined shards identifies it."""
    return crc32c(np.frombuffer(head, np.uint8))


def file_head(place: int, index: bytes) -> bytes:
    """Return the first `BEGIN` bytes of a store whose index begins at `place`."""
    own = struct.pack("<QQI", place, len(index), crc32c(np.frombuffer(index, np.uint8))).ljust(BEGIN - 16, b"\0")
    return STORE + struct.pack("<II", VERSION, crc32c(np.frombuffer(own, np.uint8))) + own


def index_place(head: bytes, size: int | None) -> tuple[int, int, int]:
    """Return place, size and checksum of the index of a store of `size` bytes that begins with `head`.

    If `size` is None, it isn't checked.

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
    if place < BEGIN or size not in (None, place + length):
        raise ValueError("is cut short, or has more bytes than it states: pack it again")
    return place, length, of_index


def packed_index(facts: dict[str, Any], **sections: Any) -> bytes:
    """Return the bytes of an index: the length of each section, then the sections; those not given are empty."""
    values = {"facts": json.dumps(facts).encode(), "file_data": sections.get("file_data", b"")}
    values |= {name: pack_texts(sections.get(name, ())) for name in TEXTS}
    values |= {name: np.array(sections.get(name, ()), kind).tobytes() for name, kind in NUMBERS.items()}
    parts = [values[name] for name in SECTIONS]
    lengths = np.array([len(part) for part in parts], "<u8").tobytes()
    return lengths + b"".join(part + bytes(-len(part) % ALIGNED) for part in parts)


def unpacked_index(index: bytes | bytearray | np.ndarray) -> dict[str, Any]:
    """Return facts, arrays, texts and `Names` of an index, given as bytes or uint8. Arrays and names are views of it.

    Raises:
        ValueError: the sections contradict each other.
    """
    given = dict(zip(SECTIONS, _sections(np.frombuffer(index, np.uint8)), strict=True))
    facts = parsed_line(given["facts"].tobytes()) or {}
    kinds = {"dataset": str, "split": str, "fold": int}
    if any(type(facts.get(name)) is not kind for name, kind in kinds.items()):
        raise ValueError("its index doesn't state the dataset")
    found: dict[str, Any] = facts | {name: unpack_texts(given[name].tobytes()) for name in TEXTS[1:]}
    found["name"] = names = Names(given["name"])
    for name, kind in NUMBERS.items():
        if len(given[name]) % np.dtype(kind).itemsize:
            raise ValueError(f"its index has {len(given[name])} bytes of {name}")
        found[name] = _whole(given[name], kind)
        if (found[name] < 0).any():
            raise ValueError(f"its index has impossible values of {name}")
    found["file_data"] = given["file_data"].tobytes()
    others = [*found["left_out"], *found["file_name"]]
    place, ends = found["place"], found["file_end"]
    if not (
        len(place) == len(names) + 1
        and len(found["bytes"]) == len(found["check"]) == len(names)
        and len({*others}) == len(others)
        and not any(name in names for name in others)
        and len(found["left_out"]) == len(found["reason"])
        and place[0] == BEGIN
        and (np.diff(place) > 0).all()
        and (place % ALIGNED == 0).all()
        and len(ends) == len(found["file_name"])
        and (np.diff(ends, prepend=0) >= 0).all()
        and (ends[-1] if len(ends) else 0) == len(given["file_data"])
    ):
        raise ValueError("its index contradicts itself: pack it again")
    found["shards"], found["shard"] = _stated_shards(facts, place), _stated_shard(facts)
    found["precomputed"] = _stated_samples(facts, found)
    return found


def _whole(section: np.ndarray, kind: str) -> np.ndarray:
    """Return the numbers of a section: as they are or, if they have 8 bytes, int64 (above its largest value: < 0)."""
    numbers = section.view(kind)
    return numbers if numbers.itemsize < 8 else numbers.view("<i8").astype(np.int64, copy=False)


def _stated_samples(facts: dict[str, Any], found: dict[str, Any]) -> Precomputing | None:
    """Return how the samples of a store were made; None if it has recordings. ValueError if that can't be right."""
    given = facts.get("precomputed")
    lengths = {len(found[name]) for name in OPTIONAL}
    if given is None and lengths == {0}:
        return None
    match given:
        case {"transform": str(transform), "classes": [*classes]} if lengths == {len(found["name"])}:
            named = all(isinstance(name, str) for name in classes)
            parts = all(map(str.endswith, found["name"], found["part"])) and all(map(PART.fullmatch, found["part"]))
            once = np.unique(found["position"]).size == len(found["name"])
            if named and parts and once and (found["label"] < len(classes)).all():
                return Precomputing(transform, classes)
    raise ValueError("its index has impossible samples: precompute them again")


def _stated_shards(facts: dict[str, Any], place: np.ndarray) -> list[Shard]:
    """Return the shards that the facts of an index state; [] if the store is a single file.

    Raises:
        ValueError: they can't be right for records at `place` [N + 1].
    """
    given = facts.get("shards", [])
    if not (isinstance(given, list) and all(map(_is_shard, given)) and len({file for file, *_ in given}) == len(given)):
        raise ValueError("its index has impossible shards: join them again")
    shards = [Shard(*one) for one in given]
    begins = [*accumulate((shard.bytes for shard in shards), initial=BEGIN)]
    if shards and (begins[-1] != place[-1] or not _are_among(begins, place) or 0 in [one.bytes for one in shards]):
        raise ValueError("its index contradicts itself: join the shards again")
    return shards


def _are_among(few: list[int], places: np.ndarray) -> bool:
    """Return whether some places, at most the last one, are among `places`, which ascend."""
    return bool((places[np.searchsorted(places, few)] == few).all())


def _stated_shard(facts: dict[str, Any]) -> tuple[int, int, str] | None:
    """Return the shard that the facts of an index state, as `Store.shard`. ValueError if it can't be right."""
    given = facts.get("shard")
    if given is None:
        return None
    match given:
        case [number, count, str(recordings)] if type(number) is type(count) is int and 1 <= number <= count:
            return number, count, recordings
    raise ValueError("its index states an impossible shard: pack it again")


def _is_shard(given: Any) -> bool:
    """Return whether a part of an index's facts is a shard: a file's name, and two numbers."""
    if not (isinstance(given, list) and len(given) == 3):
        return False
    file, *numbers = given
    named = isinstance(file, str) and is_shard_name(file)
    return named and all(type(number) is int and 0 <= number < 1 << 62 for number in numbers)


def is_shard_name(name: str) -> bool:
    """Return whether a shard can have this name: on no system, it leads to another folder."""
    return name not in ("", ".", "..") and not set(name) & set("/\\:\0")


def _sections(raw: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the sections; ValueError if there isn't one of each, one after the other up to the end."""
    at = 8 * len(SECTIONS)
    lengths = raw[:at].view("<u8").tolist() if len(raw) >= at else []
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
