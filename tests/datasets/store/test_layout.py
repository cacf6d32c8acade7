"""What lies in a store's file: as docs/store.md describes it, and up to which bounds."""

from __future__ import annotations

import os
import zlib

import h5py
import numpy as np
import pytest
import trees
from distributions import check_same

import nvsdata
from nvsdata import EventFolder, Events, FormatError
from nvsdata.datasets.source import Folder
from nvsdata.datasets.store import writer as packing
from nvsdata.datasets.store.part import Part
from nvsdata.datasets.store.reader import INDEX, Store, checksum
from nvsdata.datasets.store.writer import pack

LONG = 2**32 - 1  # µs that 32 bits can count


def store_of(folder, *recordings, **options):
    """A store of these recordings, in one class."""
    (folder / "data/a").mkdir(parents=True)
    for number, events in enumerate(recordings):
        nvsdata.write(events, folder / f"data/a/{number}.h5")
    report = pack(EventFolder(folder / "data"), folder / "a.h5", **options)
    assert (report.packed, report.events) == (len(recordings), sum(map(len, recordings)))
    store = EventFolder(folder / "a.h5")
    assert [store[number][0] for number in range(len(store))] == list(recordings)
    return folder / "a.h5"


def kinds(path):
    with h5py.File(path) as file:
        return {name: column.dtype.name for name, column in file["events"].items()}


@pytest.mark.parametrize("compress", [False, True])
def test_the_index_is_as_described(tmp_path, compress):
    recordings = [trees.some(seed, n, first=100) for seed, n in enumerate((1, 255, 256, 257, 600))]
    path = store_of(tmp_path, *recordings, compress=compress)
    with h5py.File(path) as file:
        index = {name: file[f"index/{name}"][()] for name in INDEX}
        events = {name: file[f"events/{name}"][()] for name in "txyp"}
        assert file.attrs["version"] == 2
        assert file.attrs["fold"] == 0
        crc = 0
        for name in INDEX:
            crc = zlib.crc32(index[name].tobytes(), crc)
        assert file.attrs["checksum"] == crc
        assert (file["events/t"].compression, file["events/t"].shuffle) == (
            ("gzip", True) if compress else (None, False)
        )
    assert index["offset"].tolist() == [0, 1, 256, 512, 769, 1369]
    assert index["base"].tolist() == [int(ev.t[0]) for ev in recordings]
    assert index["duration"].tolist() == [int(ev.t[-1] - ev.t[0]) for ev in recordings]
    assert index["mark"].tolist() == [int(t - ev.t[0]) for ev in recordings for t in ev.t[::256]]
    assert index["bytes"].tolist() == [(tmp_path / f"data/a/{n}.h5").stat().st_size for n in range(5)]
    for number, (begin, end) in enumerate(zip(index["offset"][:-1], index["offset"][1:], strict=True)):
        columns = b"".join(events[name][begin:end].tobytes() for name in "txyp")
        assert index["crc"][number] == zlib.crc32(columns)
    store = Store(path)
    assert [store.size(name) for name in store.names] == index["bytes"].tolist()
    assert len({store.stamp(name) for name in store.names}) == 5
    assert store.settled(store.names[0], 0)


@pytest.mark.parametrize("compress", [False, True])
def test_windows_around_every_mark(tmp_path, compress):
    events = trees.some(1, 1_000, gap=3)
    path = store_of(tmp_path, trees.some(2, 300), events, compress=compress)
    recording = EventFolder(path).recording(1)
    for place in (0, 255, 256, 512, 999):
        for shift in (-1, 0, 1):
            t = int(events.t[place]) + shift
            for start, stop in ((t, None), (None, t), (t, t + 1), (t - 300, t), (t, t + 600)):
                assert recording.read(start, stop) == events.window(start, stop)


@pytest.mark.parametrize(
    ("size", "kind"), [((256, 256), "uint8"), ((257, 1), "uint16"), ((1, 257), "uint16"), ((1280, 720), "uint16")]
)
@pytest.mark.parametrize("known", [False, True])
def test_pixels_take_a_byte_up_to_256(tmp_path, size, kind, known):
    events = Events([1, 2], [0, size[0] - 1], [0, size[1] - 1], [0, 1], size)
    path = store_of(tmp_path, events)
    assert kinds(path)["x"] == kinds(path)["y"] == kind
    # of a dataset whose size is stated
    pack(EventFolder(tmp_path / "data", sensor_size=size), path, overwrite=True)
    assert kinds(path)["x"] == kinds(path)["y"] == kind
    assert EventFolder(path)[0][0] == events


@pytest.mark.parametrize(("size", "kind"), [((256, 256), "uint8"), ((257, 1), "uint16"), (None, "uint16")])
def test_what_is_unfinished_takes_no_more_than_it_needs(tmp_path, size, kind):
    trees.put(tmp_path / "data", {"a/1.bin": b""})
    unfinished = Part(tmp_path / "part", EventFolder(tmp_path / "data", sensor_size=size), [])
    assert {name: dtype.name for name, dtype in unfinished.kinds.items()} == {
        "t": "int64",
        "x": kind,
        "y": kind,
        "p": "uint8",
    }


def test_what_states_no_time_begins_and_ends_with_its_events(tmp_path):
    trees.put(tmp_path / "data", {"a/1.bin": trees.atis(Events([5, 70], [1, 2], [3, 4], [0, 1], (9, 9)))})
    pack(EventFolder(tmp_path / "data"), tmp_path / "a.h5")
    recording = EventFolder(tmp_path / "a.h5").recording(0)
    assert (recording.start, recording.end, recording.span) == (5, 70, (5, 70))
    assert recording.path == f"{tmp_path / 'a.h5'}:a/1.bin"
    assert recording.format == "atis"


def test_columns_that_lie_in_another_file_are_read_where_links_are_followed(tmp_path, monkeypatch):
    events = trees.some(1)
    path = store_of(tmp_path, events)
    path.rename(tmp_path / "other.h5")
    with h5py.File(tmp_path / "other.h5") as other, h5py.File(path, "w") as file:
        for name in INDEX:
            file[f"index/{name}"] = other[f"index/{name}"][()]
        # where it would be read from if it lay in this file
        file["more"] = np.zeros(100_000, np.uint8)
        for name in "txyp":
            file[f"events/{name}"] = h5py.ExternalLink("other.h5", f"events/{name}")
        file.attrs.update(other.attrs)
    monkeypatch.setenv("NVSDATA_HDF5_LINKS", "1")
    assert EventFolder(path)[0][0] == events


@pytest.mark.parametrize(("duration", "kind"), [(LONG, "uint32"), (LONG + 1, "int64")])
def test_times_take_four_bytes_as_long_as_they_can(tmp_path, duration, kind):
    events = Events([7, 7 + duration], [1, 2], [1, 2], [0, 1], (4, 4))
    assert kinds(store_of(tmp_path, trees.some(1, 3), events))["t"] == kind


@pytest.mark.parametrize("step", [1, 7, 180, 1_000])
def test_columns_are_copied_in_steps(tmp_path, monkeypatch, step):
    monkeypatch.setattr(packing, "COPIED", step)
    store_of(tmp_path, *(trees.some(seed) for seed in range(3)))


def test_side_files_up_to_16_mib_travel_along(tmp_path, monkeypatch):
    trees.put(tmp_path / "data", {"list.txt": b"one", "notes.md": b"two", "a/x.HDF5": b"", "empty.csv": b""})
    real = Folder.size
    claimed = {"list.txt": 2**24, "notes.md": 2**24 + 1}
    monkeypatch.setattr(Folder, "size", lambda self, name: claimed.get(name) or real(self, name))
    (tmp_path / "data/a").mkdir(exist_ok=True)
    nvsdata.write(trees.some(1), tmp_path / "data/a/1.npy")
    pack(EventFolder(tmp_path / "data"), tmp_path / "a.h5")
    store = Store(tmp_path / "a.h5")
    assert store.listing() == {".": ["empty.csv", "list.txt"], "a": ["1.npy", "x.HDF5"]}
    assert (store.data("list.txt"), store.size("list.txt")) == (b"one", 3)
    assert (store.data("empty.csv"), store.size("empty.csv")) == (b"", 0)


def _changed(path, version=None, **arrays):
    with h5py.File(path, "r+") as file:
        for name, change in arrays.items():
            values = change(file[f"index/{name}"][()])
            del file[f"index/{name}"]
            file[f"index/{name}"] = values
        file.attrs["checksum"] = checksum({name: file[f"index/{name}"][()] for name in INDEX})
        file.attrs["version"] = version or file.attrs["version"]


def test_older_versions_are_refused(tmp_path):
    path = store_of(tmp_path, trees.some(1))
    _changed(path, version=1)
    with pytest.raises(FormatError, match="a store older than version 2: pack it again"):
        Store(path)
    _changed(path, version=3)
    with pytest.raises(FormatError, match="newer"):
        Store(path)


@pytest.mark.parametrize(
    ("arrays", "sound"),
    [
        ({"size": lambda a: a * 0 + 32_767}, True),
        ({"size": lambda a: a * 0 + 32_768}, False),
        ({"size": lambda a: a * 0 + 1}, True),
        ({"size": lambda a: a * 0}, False),
        ({"size": lambda a: a - 2 * a * (np.arange(2) == 1)}, False),
        # a recording without events, and one of fewer than none
        ({"offset": lambda a: a[[0, 2, 2, 3]], "mark": lambda a: a}, True),
        ({"offset": lambda a: a[[0, 2, 1, 3]], "mark": lambda a: np.append(a, 0)[:2]}, False),
        ({"base": lambda a: a[1:]}, False),
        ({"time": lambda a: a[1:]}, False),
        ({"bytes": lambda a: a[1:]}, False),
        ({"crc": lambda a: a[1:]}, False),
        ({"format": lambda a: a[:0]}, False),
        ({"mark": lambda a: a[1:]}, False),
    ],
)
def test_what_an_index_may_hold(tmp_path, arrays, sound):
    path = store_of(tmp_path, *(trees.some(seed, 3) for seed in range(3)))
    if "offset" in arrays:
        arrays = arrays | {"mark": lambda a: a[:2]} if sound else arrays
    _changed(path, **arrays)
    if sound:
        Store(path)
    else:
        with pytest.raises(FormatError, match="its index contradicts itself: pack it again"):
            Store(path)


def stopped(dataset, out, monkeypatch):
    """What is decoded until all is in the parts."""
    decode, seen = packing._decode, []

    def stops(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(packing, "_assemble", stops)
        patch.setattr(packing, "_decode", lambda *given: seen.append(given[2]) or decode(*given))
        with pytest.raises(KeyboardInterrupt):
            pack(dataset, out)
    return seen


def test_what_lies_behind_a_change_is_decoded_anew_once(tmp_path, monkeypatch):
    files = {f"a/{number}.bin": trees.atis(trees.some(number)) for number in range(5)} | {"a/5.bin": b"abc"}
    dataset = EventFolder(trees.put(tmp_path / "data", files))
    out = tmp_path / "a.h5"
    assert stopped(dataset, out, monkeypatch) == list(files)
    # those left out are always tried again
    assert stopped(dataset, out, monkeypatch) == ["a/5.bin"]
    trees.put(tmp_path / "data", {"a/2.bin": trees.atis(trees.some(9, 61))})
    os.utime(tmp_path / "data/a/2.bin", ns=(1, 1))
    assert stopped(dataset, out, monkeypatch) == list(files)[2:]
    assert stopped(dataset, out, monkeypatch) == ["a/5.bin"]
    assert list(pack(dataset, out).skipped) == ["a/5.bin"]
    check_same(EventFolder(out), dataset.subset(range(5)))


def test_a_recording_that_can_not_be_looked_at_is_decoded_anew(tmp_path, monkeypatch):
    files = {f"a/{number}.bin": trees.atis(trees.some(number)) for number in range(3)}
    dataset = EventFolder(trees.put(tmp_path / "data", files))
    stopped(dataset, tmp_path / "a.h5", monkeypatch)
    stamp, asked = Folder.stamp, []

    def fails_once(self, name):
        asked.append(name)
        if asked == ["a/0.bin", "a/1.bin"]:
            raise OSError("the disk")
        return stamp(self, name)

    monkeypatch.setattr(Folder, "stamp", fails_once)
    assert stopped(dataset, tmp_path / "a.h5", monkeypatch) == ["a/1.bin", "a/2.bin"]
    pack(dataset, tmp_path / "a.h5")
    check_same(dataset, EventFolder(tmp_path / "a.h5"))
