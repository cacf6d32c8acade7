"""Joined shards of a small dataset."""

import pytest
import trees
from storefiles import packed

from nvsdata import join
from nvsdata.remote import file, transport


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    """An empty cache of remote blocks, and pauses of a millisecond."""
    monkeypatch.setenv("NVSDATA_BLOCKS", str(tmp_path / "blocks"))
    monkeypatch.setattr(file, "_process", None)
    monkeypatch.setattr(transport, "PAUSE", 0.001)


@pytest.fixture
def animals(tmp_path):
    """A folder of ten recordings, of which one is damaged and one empty, with a side file and an empty class."""
    names = [f"{name}/{i}.bin" for name in ("ant", "cat") for i in range(5)]
    files = {name: trees.atis(trees.some(n + 1)) for n, name in enumerate(names)}
    root = trees.put(tmp_path / "data", files | {"ant/4.bin": b"abc", "cat/3.bin": b"", "list.txt": b"ant/1 ant/2"})
    (root / "dog").mkdir()
    return root


@pytest.fixture
def joined(animals, tmp_path):
    """The index file of three shards; the last joined one comes first."""
    out = tmp_path / "a.nvs"
    assert join(packed(animals, out)[::-1], out) == 8
    return out
