"""Small blocks, short pauses and a cache of its own for each test."""

import pytest

from nvsdata.remote import blocks, file, transport


@pytest.fixture(autouse=True)
def cache_folder(tmp_path, monkeypatch):
    """The folder of the cache of blocks."""
    folder = tmp_path / "blocks"
    monkeypatch.setenv("NVSDATA_BLOCKS", str(folder))
    monkeypatch.setattr(file, "_process", None)
    monkeypatch.setattr(transport, "PAUSE", 0.001)
    return folder


@pytest.fixture
def small(monkeypatch):
    """Blocks of 4,096 bytes, of 4 pieces."""
    monkeypatch.setattr(file, "BLOCK", 4096)
    monkeypatch.setattr(blocks, "PIECE", 1024)
