"""Indices that are kept beside large files."""

import errno
import os

import numpy as np
import pytest
from lookalikes import aedat4_bytes

import nvsdata
from nvsdata import Events, FormatError
from nvsdata.common.files import atomic
from nvsdata.data.events import Columns
from nvsdata.formats import index_cache
from nvsdata.formats.aedat.aedat4 import Aedat4Recording

KINDS = {"evt2": ".raw", "evt2.1": ".raw", "evt3": ".raw", "atis": ".bin"}
every = pytest.mark.parametrize("kind", KINDS)


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setattr(index_cache, "LEAST", 1_000)
    monkeypatch.setattr(index_cache, "SETTLED_NS", 0)


def made(kind, folder, seed=0, count=40_000):
    """A file of a kind that was written long ago, and its events."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(0, 2_000_000, count))
    ev = Events(t, rng.integers(0, 240, count), rng.integers(0, 180, count), rng.integers(0, 2, count), (240, 180))
    path = folder / f"a{KINDS[kind]}"
    nvsdata.write(ev, path, format=kind)
    os.utime(path, ns=(10**18 + seed, 10**18 + seed))
    return path, ev


def forbidden(self):
    raise AssertionError("the file was walked over")


@every
def test_the_second_time_the_file_is_not_walked_over(tmp_path, monkeypatch, kind):
    path, ev = made(kind, tmp_path)
    assert nvsdata.read(path, 500_000, 600_000) == ev.window(500_000, 600_000)
    assert index_cache.path_of(str(path)).is_file()
    assert {p.name for p in tmp_path.iterdir()} == {path.name, f".{path.name}.nvsdata-index"}
    again = nvsdata.open(path)
    monkeypatch.setattr(type(again), "_walk", forbidden)
    for start, stop in ((0, 10), (500_000, 600_000), (1_999_000, 2_000_001), (-5, 3_000_000)):
        assert nvsdata.read(path, start, stop) == ev.window(start, stop)
    assert again.span == (ev.t[0], ev.t[-1])
    assert again.sensor_size == (240, 180)
    assert nvsdata.open(path, sensor_size=(300, 200)).read(0, 10).sensor_size == (300, 200)


@every
def test_a_changed_file_gets_another_index(tmp_path, kind):
    path, ev = made(kind, tmp_path)
    nvsdata.read(path, 0, 10)
    before = index_cache.path_of(str(path)).read_bytes()
    path, other = made(kind, tmp_path, seed=1)
    assert other != ev
    assert nvsdata.read(path, 500_000, 600_000) == other.window(500_000, 600_000)
    assert index_cache.path_of(str(path)).read_bytes() != before


def test_an_index_of_another_version_is_not_used(tmp_path, monkeypatch):
    path, ev = made("evt3", tmp_path)
    nvsdata.read(path, 0, 10)
    monkeypatch.setattr(index_cache, "VERSION", index_cache.VERSION + 1)
    assert index_cache.load_index(str(path), about(path)) is None
    assert nvsdata.read(path, 500_000, 600_000) == ev.window(500_000, 600_000)
    assert index_cache.load_index(str(path), about(path)) is not None


def about(path):
    recording = nvsdata.open(path)
    size, *stamp = recording.contents.stamp
    return {"format": recording.format, "block": recording.block, "size": size, "stamp": stamp}


@every
def test_a_broken_index_is_made_again(tmp_path, kind):
    path, ev = made(kind, tmp_path)
    nvsdata.read(path, 0, 10)
    index = index_cache.path_of(str(path))
    whole = index.read_bytes()
    rng = np.random.default_rng(0)
    broken = [b"", b"nonsense", whole[:100], whole[:-30], whole + b"more"]
    for _ in range(20):
        changed = bytearray(whole)
        changed[int(rng.integers(len(whole)))] ^= 1 << int(rng.integers(8))
        broken.append(bytes(changed))
    for content in broken:
        index.write_bytes(content)
        assert nvsdata.read(path, 500_000, 600_000) == ev.window(500_000, 600_000)
    index.write_bytes(b"")
    nvsdata.read(path, 0, 10)
    assert index.read_bytes() == whole


def test_what_cannot_be_kept_is_not(tmp_path, monkeypatch):
    path, ev = made("evt3", tmp_path)
    index = index_cache.path_of(str(path))

    def full(*args, **kwargs):
        raise OSError(errno.ENOSPC, "no space")

    with monkeypatch.context() as patch:
        patch.setattr(index_cache.np, "savez", full)
        assert nvsdata.read(path, 500_000, 600_000) == ev.window(500_000, 600_000)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    # it may change again within the same tick of the clock
    with monkeypatch.context() as patch:
        patch.setattr(index_cache, "SETTLED_NS", 10**12)
        assert nvsdata.read(path, 500_000, 600_000) == ev.window(500_000, 600_000)
    assert not index.exists()
    monkeypatch.setattr(index_cache, "LEAST", path.stat().st_size + 1)
    nvsdata.read(path, 0, 10)
    assert not index.exists()
    monkeypatch.setattr(index_cache, "LEAST", path.stat().st_size)
    nvsdata.open(path, strict=False).read(0, 10)
    assert not index.exists()
    nvsdata.read(path)
    assert not index.exists()
    nvsdata.read(path, 0, 10)
    assert index.exists()


@every
def test_damage_is_named_and_no_index_kept(tmp_path, kind):
    path, _ = made(kind, tmp_path)
    raw = bytearray(path.read_bytes())
    begin = nvsdata.open(path).header_size
    if kind == "atis":
        raw[5 * 20_000 + 1] = 250
    else:
        # a word of time far away
        size = {"evt2": 4, "evt2.1": 8, "evt3": 2}[kind]
        at = begin + 20_000 * size
        word = {2: 0x8A00, 4: 0x8FF00000, 8: 0x8FF00000}[size]
        raw[at : at + size] = word.to_bytes(size, "little")
    path.write_bytes(raw)
    os.utime(path, ns=(10**18, 10**18))
    for _ in range(2):
        with pytest.raises(nvsdata.FormatError, match=path.name):
            nvsdata.read(path, 500_000, 600_000)
    assert not index_cache.path_of(str(path)).exists()


def test_datasets_do_not_take_an_index_for_a_recording(tmp_path):
    (tmp_path / "cat").mkdir()
    path, ev = made("evt3", tmp_path / "cat")
    nvsdata.read(path, 0, 10)
    assert index_cache.path_of(str(path)).exists()
    dataset = nvsdata.EventFolder(tmp_path)
    assert len(dataset) == 1
    assert dataset[0][0] == ev


@every
def test_a_file_put_in_the_place_of_another_with_its_size_and_time(tmp_path, kind):
    path, ev = made(kind, tmp_path)
    nvsdata.read(path, 0, 10)
    index = index_cache.path_of(str(path)).read_bytes()
    (tmp_path / "new").mkdir()
    other_path, _ = made(kind, tmp_path / "new", seed=1)
    raw, size = other_path.read_bytes(), path.stat().st_size
    if kind.startswith("evt"):
        # as long as the other, filled up with words that mean nothing
        raw = raw[:size] + b"\0\0\0\xf0" * (max(size - len(raw), 0) // 4)
        raw += bytes(size - len(raw))
    path.write_bytes(raw)
    os.utime(path, ns=(10**18, 10**18))
    assert path.stat().st_size == size
    whole = nvsdata.read(path)
    assert nvsdata.read(path, 500_000, 600_000) == whole.window(500_000, 600_000) != ev.window(500_000, 600_000)
    assert index_cache.path_of(str(path)).read_bytes() != index


@every
@pytest.mark.parametrize("change", ["shorter", "other type", "missing", "more states"])
def test_arrays_of_another_file_are_not_used(tmp_path, kind, change):
    path, ev = made(kind, tmp_path)
    nvsdata.read(path, 0, 10)
    arrays = index_cache.load_index(str(path), about(path))
    if change == "shorter":
        arrays["times"] = arrays["times"][:-1]
    elif change == "other type":
        arrays["times"] = arrays["times"].astype(np.float32)
    elif change == "missing":
        del arrays["span"]
    else:
        arrays["states"] = np.concatenate((arrays["states"], arrays["states"]))
    index_cache.save_index(str(path), about(path), 0, arrays)
    assert nvsdata.read(path, 500_000, 600_000) == ev.window(500_000, 600_000)


def test_a_file_that_is_being_written_gets_no_index(tmp_path):
    path, _ = made("evt3", tmp_path)
    part = path.rename(tmp_path / "a.raw.part")
    nvsdata.read(part, 0, 10)
    assert [p.name for p in tmp_path.iterdir()] == [part.name]


def test_what_a_killed_process_left_is_removed(tmp_path):
    path, _ = made("evt3", tmp_path)
    with atomic(index_cache.path_of(str(path))) as temporary:
        name = temporary.name
    # of a process of this machine that is no more
    left = tmp_path / name.replace(f"-{os.getpid()}-", "-999999999-")
    left.write_bytes(b"half")
    nvsdata.read(path, 0, 10)
    assert not left.exists()
    assert index_cache.path_of(str(path)).stat().st_size > 1_000


def untold(folder, seed=0, count=20_000):
    """An AEDAT 4 file without a table, of packets of 50 events, and its events."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(0, 2_000_000, count))
    ev = Events(t, rng.integers(0, 320, count), rng.integers(0, 240, count), rng.integers(0, 2, count), (320, 240))
    path = folder / "a.aedat4"
    path.write_bytes(aedat4_bytes(ev))
    os.utime(path, ns=(10**18 + seed, 10**18 + seed))
    return path, ev


def test_packets_without_a_table_are_walked_over_once(tmp_path, monkeypatch):
    path, ev = untold(tmp_path)
    assert nvsdata.read(path, 500_000, 600_000) == ev.window(500_000, 600_000)
    assert index_cache.path_of(str(path)).is_file()
    monkeypatch.setattr(Aedat4Recording, "_packets", forbidden)
    inflated = []
    content = Aedat4Recording._content
    monkeypatch.setattr(Aedat4Recording, "_content", lambda *given: inflated.append(1) or content(*given))
    for start, stop in ((0, 10), (500_000, 600_000), (1_999_000, 2_000_001)):
        inflated.clear()
        assert nvsdata.read(path, start, stop) == ev.window(start, stop)
        assert len(inflated) <= (stop - start) / 2_000_000 * len(ev) / 50 + 7 + index_cache.COMPARED
    assert nvsdata.open(path).span == (ev.t[0], ev.t[-1])
    monkeypatch.undo()
    assert nvsdata.read(path) == ev


def test_packets_that_changed_or_overlap_or_are_torn(tmp_path, monkeypatch):
    path, _ = untold(tmp_path)
    nvsdata.read(path, 0, 10)
    path, other = untold(tmp_path, seed=1)
    assert nvsdata.read(path, 700_000, 800_000) == other.window(700_000, 800_000)
    # an index of something else
    np.savez(tmp_path / "x.npz", about=np.load(index_cache.path_of(str(path)))["about"], packets=np.zeros((2, 3)))
    os.replace(tmp_path / "x.npz", index_cache.path_of(str(path)))
    assert nvsdata.read(path, 700_000, 800_000) == other.window(700_000, 800_000)
    # packets whose times overlap: all is decoded, and sorted
    late = Events(np.arange(100), [0] * 100, [0] * 100, [1] * 100, (320, 240))
    swapped = Events.trusted(late.columns.take(np.r_[50:100, 0:50]), (320, 240))
    path = tmp_path / "b.aedat4"
    path.write_bytes(aedat4_bytes(swapped))
    assert nvsdata.read(path, 10, 90) == late.window(10, 90)
    # and one whose own events aren't in order
    t = np.arange(1_000, 1_200)
    t[75] = 100
    odd = Events.trusted(Columns(t, *late.columns.take(np.zeros(200, int))[1:]), (320, 240))
    path = tmp_path / "d.aedat4"
    path.write_bytes(aedat4_bytes(odd))
    for _ in range(2):
        assert nvsdata.read(path, 0, 200).t.tolist() == [100]
    raw = (tmp_path / "a.aedat4").read_bytes()
    (tmp_path / "c.aedat4").write_bytes(raw[:-20])
    with pytest.raises(FormatError, match="truncated"):
        nvsdata.read(tmp_path / "c.aedat4", 0, 10)
