"""Joining of shards: one index file for the recordings of all."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import closing
from itertools import islice, pairwise
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.common.files import creating, put
from nvsdata.common.progress import bar
from nvsdata.datasets.store.index import (
    BEGIN,
    TEXTS,
    Shard,
    file_head,
    head_check,
    is_shard_name,
    packed_index,
    unpacked_index,
)
from nvsdata.datasets.store.opened import opened_index

AGAIN = "join the shards of one `nvsdata pack`"
SHOWN = 5  # missing shards in a message


def join(shards: Sequence[str | os.PathLike[str]], out: str | os.PathLike[str], *, overwrite: bool = False) -> int:
    """Write the index file `out` of shards that `pack(..., shard=(i, n))` packed.

    The dataset's class opens the index file in place of a folder. It has the index of all recordings and a checksum of
    each shard's head, but no events: the shards must stay next to it. Their events aren't read.

    Args:
        shards: all shards of a store, in any order, in the folder of `out`.
        out: path of the index file.
        overwrite: whether to replace an existing file; if it is a link, its target.

    Returns:
        Number of recordings.

    Raises:
        FileExistsError: `out` exists, unless `overwrite`.
        FormatError: a file isn't a shard, or it is damaged.
        ValueError: a shard is missing, given twice, in another folder, or of another dataset or state of it.

    Example:
        >>> import tempfile, nvsdata
        >>> from pathlib import Path
        >>> root = Path(tempfile.mkdtemp())
        >>> for i in (0, 1):
        ...     (root / "data/waving").mkdir(parents=True, exist_ok=True)
        ...     _ = nvsdata.write(nvsdata.example(), root / f"data/waving/{i}.npy")
        >>> for i in (1, 2):
        ...     _ = nvsdata.pack(nvsdata.EventFolder(root / "data"), root / "a.nvs", shard=(i, 2))
        >>> nvsdata.join([root / "a-1-of-2.nvs", root / "a-2-of-2.nvs"], root / "a.nvs")
        2
    """
    target = Path(out).expanduser()
    paths = [Path(path).expanduser() for path in shards]
    with creating(target, overwrite=overwrite):
        found = _in_order([_index_of(path) for path in bar(paths, "joining", unit="shard")], target)
        index = _joined(found)
        put(target, file_head(BEGIN, index) + index, through_link=True)
    return sum(len(one["name"]) for one in found)


def _index_of(path: Path) -> dict[str, Any]:
    """Return the index of a shard, its path and the checksum of its head. FormatError if the file isn't a shard."""
    file, found = opened_index(path)
    with closing(file):
        if found["shard"] is None:
            raise FormatError(path, "isn't a shard: `nvsdata pack --shard` makes one")
        head = np.empty(BEGIN, np.uint8)
        file.fill(0, head)
        return found | {"path": path, "head": head_check(head.tobytes())}


def _in_order(given: list[dict[str, Any]], target: Path) -> list[dict[str, Any]]:
    """Return the indices of the shards, in order. ValueError unless they make a store."""
    if not given:
        raise ValueError("no shards to join")
    first = given[0]
    for found in given:
        path = found["path"]
        if path.absolute().parent != target.absolute().parent:
            raise ValueError(f"{path} isn't in the folder of {target}: move all shards there")
        if os.path.realpath(path) == os.path.realpath(target):
            raise ValueError(f"{path} is a shard: choose another name for the index file")
        if not is_shard_name(path.name):
            raise ValueError(f"{path}: a shard's name can't have : or \\: rename it")
        if _identity(found) != _identity(first):
            raise ValueError(f"{path} and {first['path']} are of different datasets or runs: {AGAIN}")
    ordered = sorted(given, key=itemgetter("shard"))
    for one, other in pairwise(ordered):
        if one["shard"] == other["shard"]:
            raise ValueError(f"{other['path']} and {one['path']} are the same shard: give each shard once")
    count, numbers = first["shard"][1], {found["shard"][0] for found in given}
    if missing := count - len(numbers):
        some = islice((number for number in range(1, count + 1) if number not in numbers), SHOWN)
        named = ", ".join(f"{number}/{count}" for number in some)
        raise ValueError(f"{missing:,} of {count:,} shards are missing: {named}{', ...' * (missing > SHOWN)}")
    return ordered


def _identity(found: dict[str, Any]) -> list[Any]:
    """Return what all shards of a store share: dataset, split, fold, transform, number of shards, recordings."""
    return [found[name] for name in ("dataset", "split", "fold", "precomputed")] + [*found["shard"][1:]]


def _joined(indices: list[dict[str, Any]]) -> bytes:
    """Return the index of all recordings of the shards. ValueError if it can't be read back."""
    texts = {name: [text for one in indices for text in one[name]] for name in TEXTS}
    # each shard lists all folders
    texts["folder"] = list(dict.fromkeys(texts["folder"]))
    lengths = np.concatenate([np.diff(one["place"]) for one in indices])
    shards = [Shard(one["path"].name, int(one["place"][-1]) - BEGIN, one["head"]) for one in indices if one["name"]]
    if not shards:
        raise ValueError("the shards have no recordings")
    facts = {name: indices[0][name] for name in ("dataset", "split", "fold")}
    if (how := indices[0]["precomputed"]) is not None:
        facts["precomputed"] = how._asdict()
    index = packed_index(
        facts | {"shards": shards},
        place=np.append(BEGIN, BEGIN + np.cumsum(lengths)),
        **{name: np.concatenate([one[name] for one in indices]) for name in ("bytes", "check", "label", "position")},
        # the first shard has the side files
        file_end=indices[0]["file_end"],
        file_data=indices[0]["file_data"],
        **texts,
    )
    try:
        unpacked_index(index)
    except ValueError:
        # only shards that `pack` didn't write: for example, two have the same recording
        raise ValueError(f"{indices[0]['path']} and the others contradict each other: {AGAIN}") from None
    return index
