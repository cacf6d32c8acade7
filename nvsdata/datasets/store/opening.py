"""Opening of packed stores of any layout."""

from __future__ import annotations

from pathlib import Path

from nvsdata.datasets.store.reader import Store
from nvsdata.datasets.store.second import SecondStore
from nvsdata.formats.registry import STORE


def open_store(path: Path) -> Store:
    """Return a packed store of any layout. FormatError if the file is none."""
    with path.open("rb") as file:
        return Store(path) if file.read(len(STORE)) == STORE else SecondStore(path)
