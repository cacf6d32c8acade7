"""Files of packed stores, taken apart and changed so that all their checksums are right."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from nvsdata import EventFolder, pack
from nvsdata.datasets.store import index
from nvsdata.datasets.store.record import BLOCK, HEAD
from nvsdata.datasets.store.shards import shard_path
from nvsdata.kernels.decode.blocks import crc32c

# of a record's head
FIELDS = "check blocks events base duration begin end width height t_bytes xy_bytes compressed guessed format".split()
COUNT = 3  # shards


def packed(root: Path, out: Path, count: int = COUNT, **settings: Any) -> list[Path]:
    """Pack a folder in shards, and return their paths."""
    for i in range(1, count + 1):
        pack(EventFolder(root), out, shard=(i, count), **settings)
    return [shard_path(out, (i, count)) for i in range(1, count + 1)]


def check_of(raw: bytes | np.ndarray) -> int:
    """CRC-32C of bytes."""
    return crc32c(np.frombuffer(raw, np.uint8))


def index_of(path: Path) -> dict[str, Any]:
    """Facts and sections of a store's index."""
    raw = path.read_bytes()
    place, length, _ = index.index_place(raw[: index.BEGIN], len(raw))
    # a bytearray, so that tests can change the arrays
    return index.unpacked_index(bytearray(raw[place : place + length]))


def put_index(path: Path, packed: bytes) -> None:
    """Replace a store's index, with a right checksum."""
    raw = path.read_bytes()
    place, *_ = index.index_place(raw[: index.BEGIN], len(raw))
    path.write_bytes(index.file_head(place, packed) + raw[index.BEGIN : place] + packed)


def reindex(path: Path, facts: dict[str, Any] | None = None, **changes: Any) -> None:
    """Change facts and sections of a store's index."""
    found = index_of(path)
    sections = {name: found[name] for name in index.SECTIONS[1:]} | changes
    put_index(path, index.packed_index(facts_of(found) if facts is None else facts, **sections))


def facts_of(found: dict[str, Any]) -> dict[str, Any]:
    """Facts of an index: dataset, split and fold, and the shard that the store is, or the shards that it has."""
    return {
        name: found[name] for name in ("dataset", "split", "fold", "shard", "shards") if found[name] not in (None, [])
    }


def head_at(path: Path, number: int) -> tuple[int, dict[str, Any], np.ndarray]:
    """Place, head and table of blocks of a record."""
    raw, place = path.read_bytes(), int(index_of(path)["place"][number])
    head = dict(zip(FIELDS, HEAD.unpack_from(raw, place), strict=True))
    return place, head, np.frombuffer(raw, BLOCK, head["blocks"], place + HEAD.size).copy()


def put_head(path: Path, number: int, change: Callable[[np.ndarray], None] | None = None, **fields: Any) -> None:
    """Change a record's head, and its table of blocks in place, with a right checksum of as many blocks as stated."""
    place, head, table = head_at(path, number)
    if change:
        change(table)
    head |= fields
    changed = HEAD.pack(*head.values()) + table.tobytes()
    raw = bytearray(path.read_bytes())
    raw[place : place + len(changed)] = changed
    checked = raw[place + 4 : place + HEAD.size + head["blocks"] * BLOCK.itemsize]
    raw[place : place + 4] = struct.pack("<I", check_of(checked))
    path.write_bytes(raw)
    checks = index_of(path)["check"]
    checks[number] = check_of(checked)
    reindex(path, check=checks)


def block_places(path: Path, number: int) -> list[int]:
    """First byte of each block of a record, and the byte after the last one."""
    place, _, table = head_at(path, number)
    ends = np.cumsum(table["bytes"], dtype=np.int64)
    return [place + HEAD.size + table.nbytes + end for end in (0, *ends.tolist())]


def put_block(path: Path, number: int, block: int, change: Callable[[bytearray], bytes | bytearray]) -> None:
    """Change the bytes of a block, not their number, with right checksums. ValueError if the file ends before it."""
    begin, end = block_places(path, number)[block : block + 2]
    raw = bytearray(path.read_bytes())
    if end > len(raw):
        raise ValueError(f"block {block} ends at byte {end} of {len(raw)}")
    raw[begin:end] = changed = change(raw[begin:end])
    assert len(changed) == end - begin
    path.write_bytes(raw)

    def checked(table: np.ndarray) -> None:
        table["check"][block] = check_of(changed)

    put_head(path, number, checked)
