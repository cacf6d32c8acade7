"""Indexes next to large files that somebody altered, or put something else in the place of."""

import os

import numpy as np
import pytest
from test_index_cache import about, every, made, small, untold  # noqa: F401

import nvsdata
from nvsdata.formats import index_cache


def altered(path, change):
    """Keep the file's index with its arrays changed by somebody who knows how it is kept, checksum and all."""
    index = index_cache.path_of(str(path))
    with np.load(index) as kept:
        about = bytes(kept["about"])
        arrays = {name: kept[name].copy() for name in kept.files if name not in ("about", "crc")}
    change(arrays)
    crc = np.array(index_cache._checksum(arrays))
    with index.open("wb") as file:
        np.savez(file, about=np.frombuffer(about, np.uint8), crc=crc, **arrays)


def shift_times(arrays):
    arrays["times"] += 10_000_000
    arrays["span"] += 10_000_000


def squeeze_times(arrays):
    """Times in order, but the later half is said to come at once."""
    half = len(arrays["times"]) // 2
    arrays["times"][half:] = arrays["times"][half]


def reverse_times(arrays):
    arrays["times"] = arrays["times"][::-1].copy()


def wild_states(arrays):
    arrays["states"][1:] = -30_000


def huge_states(arrays):
    arrays["states"][1:] = 2**62


def one_state(arrays):
    arrays["states"][len(arrays["states"]) // 2] += 7


def other_span(arrays):
    arrays["span"] = np.array([5, 7])


def small_extent(arrays):
    """Of the events, which ATIS files don't state."""
    if "extent" in arrays:
        arrays["extent"] = np.array([20, 20])


ALTERED = (shift_times, squeeze_times, reverse_times, wild_states, huge_states, one_state, other_span, small_extent)


@every
@pytest.mark.parametrize("change", ALTERED)
@pytest.mark.parametrize("seed", range(2))
def test_an_altered_index_changes_nothing(tmp_path, kind, change, seed):
    path, ev = made(kind, tmp_path, seed=seed)
    nvsdata.read(path, 0, 10)
    altered(path, change)
    recording = nvsdata.open(path)
    random = np.random.default_rng(seed)
    for start in (1_000_000, *random.integers(0, 2_000_000, 6).tolist()):
        assert recording.read(start, start + 30_000) == ev.window(start, start + 30_000)
    assert recording.span == (ev.t[0], ev.t[-1])
    assert recording.sensor_size == (240, 180)


@every
def test_an_index_that_a_window_finds_altered_is_replaced(tmp_path, monkeypatch, kind):
    path, ev = made(kind, tmp_path)
    nvsdata.read(path, 0, 10)
    whole = index_cache.path_of(str(path)).read_bytes()
    altered(path, one_state)
    # of the entries that are compared at random, none
    monkeypatch.setattr(index_cache, "entries_to_compare", lambda count: np.arange(0))
    times = nvsdata.open(path).blocks.times
    start = int(times[len(times) // 2]) + 1
    assert nvsdata.read(path, start, start + 30_000) == ev.window(start, start + 30_000)
    assert index_cache.path_of(str(path)).read_bytes() == whole


def hide_packets(arrays):
    arrays["packets"] = arrays["packets"][:, ::2].copy()


def move_packets(arrays):
    arrays["packets"][1] += 3


def packets_elsewhere(arrays):
    arrays["packets"][1] = 2**61


def packets_of_no_size(arrays):
    arrays["packets"][2] = -5


def packets_of_other_times(arrays):
    arrays["packets"][4:] += 10_000_000


@pytest.mark.parametrize(
    "change", [move_packets, packets_elsewhere, packets_of_no_size, packets_of_other_times, hide_packets]
)
def test_an_altered_index_of_packets_changes_nothing(tmp_path, change):
    path, ev = untold(tmp_path)
    nvsdata.read(path, 0, 10)
    altered(path, change)
    recording = nvsdata.open(path)
    for start in (0, 500_000, 1_900_000):
        assert recording.read(start, start + 30_000) == ev.window(start, start + 30_000)


@every
def test_a_link_in_the_place_of_an_index_is_neither_followed_nor_written_through(tmp_path, kind):
    path, ev = made(kind, tmp_path)
    nvsdata.read(path, 0, 10)
    index = index_cache.path_of(str(path))
    mine = tmp_path / "thesis.tex"
    for content in (b"a text", index.read_bytes()):
        mine.write_bytes(content)
        index.unlink(missing_ok=True)
        index.symlink_to(mine)
        assert nvsdata.read(path, 500_000, 600_000) == ev.window(500_000, 600_000)
        assert mine.read_bytes() == content
        # the link itself was replaced
        assert not index.is_symlink()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes as POSIX has them")
def test_a_pipe_and_a_folder_in_the_place_of_an_index(tmp_path):
    path, ev = made("evt3", tmp_path)
    index = index_cache.path_of(str(path))
    os.mkfifo(index)
    assert nvsdata.read(path, 500_000, 600_000) == ev.window(500_000, 600_000)
    index.unlink()
    index.mkdir()
    assert nvsdata.read(path, 500_000, 600_000) == ev.window(500_000, 600_000)
    assert index.is_dir()


def test_a_huge_or_compressed_index_is_not_read(tmp_path, monkeypatch):
    path, ev = made("evt3", tmp_path)
    nvsdata.read(path, 0, 10)
    index = index_cache.path_of(str(path))
    with np.load(index) as kept:
        arrays = {name: kept[name] for name in kept.files}
    # a few kB that become 80 MB
    np.savez_compressed(tmp_path / "bomb.npz", **arrays, more=np.zeros(10_000_000))
    (tmp_path / "bomb.npz").rename(index)
    loaded = []
    monkeypatch.setattr(index_cache.np, "load", lambda *given, **how: loaded.append(1))
    assert index_cache.load_index(str(path), about(path)) is None
    with index.open("wb") as file:
        file.truncate(1 << 30)
    assert nvsdata.read(path, 500_000, 600_000) == ev.window(500_000, 600_000)
    assert loaded == []
