"""Opening of packed stores of any layout."""

from __future__ import annotations

from pathlib import Path

from nvsdata.datasets.store.file import LocalFile
from nvsdata.datasets.store.reader import Store
from nvsdata.datasets.store.second import SecondStore
from nvsdata.formats.registry import STORE
from nvsdata.remote.url import Url


def open_store(path: Path | Url) -> Store:
    """Return a packed store of any layout. FormatError if the file is none. A remote one has the newest layout."""
    if isinstance(path, Url):
        return Store(path)
    with LocalFile(path) as file:
        return Store(path) if file.read(len(STORE)) == STORE else SecondStore(path)


def refuse_shard(store: Store, root: Path | Url) -> None:
    """Raise ValueError if a store is one of several shards."""
    if store.shard is not None:
        part = "shard {}/{}".format(*store.shard[:2])
        raise ValueError(f"{root} is {part} of a store: join all shards with `nvsdata join`")
