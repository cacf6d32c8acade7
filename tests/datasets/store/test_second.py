"""Stores of the second layout, which earlier versions packed, are still read.

second.h5 and second-compressed.h5 were packed at commit c989d076 by `nvsdata.pack(EventFolder("data"), ...)`, without
and with `compress=True`. The folder had the recordings of `EXPECTED`, written by `nvsdata.write`, a recording a/3.npy
of the bytes `broken`, and the side file list.txt.
"""

from __future__ import annotations

import multiprocessing
import pickle
import shutil
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from lookalikes import lead_elsewhere
from torch.utils.data import DataLoader

import nvsdata
from nvsdata import EventFolder, Events, FormatError
from nvsdata.datasets.store import second
from nvsdata.datasets.store.opening import open_store
from nvsdata.datasets.store.reader import Store
from nvsdata.datasets.store.second import INDEX, SecondStore, checksum

HERE = Path(__file__).parent


def made(seed):
    """600 events on a sensor of 34 x 30 pixels; some have the same time."""
    rng = np.random.default_rng(seed)
    t = 1_000 * seed + np.cumsum(rng.integers(0, 50, 600))
    x, y, p = rng.integers(0, 34, 600), rng.integers(0, 30, 600), rng.integers(0, 2, 600)
    return Events(t, x, y, p, (34, 30))


EXPECTED = {name: made(seed) for seed, name in enumerate(("a/0.npy", "a/1.npy", "b/2.npy"))}
FIRST = "a/0.npy"


@pytest.fixture(params=["second.h5", "second-compressed.h5"])
def either(request, tmp_path):
    """A copy of each store."""
    shutil.copy(HERE / request.param, tmp_path / "a.h5")
    return tmp_path / "a.h5"


@pytest.fixture
def plain(tmp_path):
    """A copy of the store that isn't compressed."""
    shutil.copy(HERE / "second.h5", tmp_path / "a.h5")
    return tmp_path / "a.h5"


def same_columns(found, expected):
    """Return True if events are the same, with the same types."""
    return all(
        ours.dtype == other.dtype and np.array_equal(ours, other)
        for ours, other in zip(found.columns, expected.columns, strict=True)
    )


def reindex(path, **changes):
    """Change arrays of the index, with a right checksum."""
    with h5py.File(path, "r+") as file:
        index = {name: file[f"index/{name}"][()] for name in INDEX}
        for name, change in changes.items():
            index[name] = change(index[name])
            del file[f"index/{name}"]
            file[f"index/{name}"] = index[name]
        file.attrs["checksum"] = checksum(index)


def test_events_are_those_that_were_packed(either):
    dataset = EventFolder(either)
    assert isinstance(dataset.source, SecondStore)
    assert dataset.source.names == list(EXPECTED)
    assert dataset.classes == ["a", "b"]
    assert dataset.targets == [0, 0, 1]
    for number, events in enumerate(EXPECTED.values()):
        recording = dataset.recording(number)
        # read, read again, and by a new recording
        for found in (recording.read(), recording.read(), dataset[number][0]):
            assert same_columns(found, events)
            assert found.sensor_size == (34, 30)
        assert recording.span == (int(events.t[0]), int(events.t[-1]))
        assert recording.path == f"{either}:{list(EXPECTED)[number]}"
        assert recording.format == "npy"


@pytest.mark.parametrize("checked", [second.CHECKED, 100])
def test_windows_are_those_of_the_events(either, monkeypatch, checked):
    monkeypatch.setattr(second, "CHECKED", checked)
    for number, events in enumerate(EXPECTED.values()):
        recording = EventFolder(either).recording(number)
        moments = [int(events.t[place]) + shift for place in (0, 255, 256, 512, 599) for shift in (-1, 0, 1)]
        windows = [(start, stop) for start in moments for stop in moments if start <= stop]
        windows += [(moment, None) for moment in moments] + [(None, moment) for moment in moments]
        for start, stop in windows:
            assert same_columns(recording.read(start, stop), events.window(start, stop))
    assert len(EventFolder(either).recording(0).read(-(2**63), 2**63 - 1)) == 600


def test_listing_side_file_and_what_was_left_out(either):
    store = open_store(either)
    assert store.listing() == {".": ["list.txt"], "a": ["0.npy", "1.npy", "3.npy"], "b": ["2.npy"]}
    assert (store.data("list.txt"), store.size("list.txt")) == (b"some words\n", 11)
    assert (store.dataset, store.split, store.fold) == (EventFolder.info.name, "all", 0)
    assert list(store.left_out) == ["a/3.npy"]
    with pytest.raises(FormatError, match=r"a/3\.npy was left out when it was packed: .*doesn't begin like one"):
        store.open("a/3.npy", None)
    assert all(store.size(name) > 600 for name in EXPECTED)
    assert len({store.stamp(name) for name in EXPECTED}) == 3
    assert all(store.stamp(name)[1:] == (int(events.t[0]), 34, 30) for name, events in EXPECTED.items())
    assert store.settled(FIRST, 0)


def test_a_store_of_the_second_layout_is_packed_into_one_of_the_third(either, tmp_path):
    report = nvsdata.pack(EventFolder(either), tmp_path / "b.nvs")
    assert (report.packed, report.events, list(report.skipped)) == (3, 1_800, ["a/3.npy"])
    store = open_store(tmp_path / "b.nvs")
    assert type(store) is Store
    assert store.listing() == open_store(either).listing()
    assert store.data("list.txt") == b"some words\n"
    for name, events in EXPECTED.items():
        assert same_columns(store.open(name, None).read(), events)
        assert store.open(name, None).format == "npy"


def test_pickling_is_cheap_and_keeps_the_kind(either):
    store = open_store(either)
    raw = pickle.dumps(store)
    assert len(raw) < 500
    again = pickle.loads(raw)
    assert type(again) is SecondStore
    assert same_columns(again.open(FIRST, None).read(), EXPECTED[FIRST])


@pytest.mark.parametrize("context", ["fork", "spawn"])
def test_workers_read_the_same(plain, context):
    if context not in multiprocessing.get_all_start_methods():
        pytest.skip(f"no {context} here")
    loader = DataLoader(EventFolder(plain), None, num_workers=1, multiprocessing_context=context, collate_fn=unchanged)
    for (found, _), events in zip(loader, EXPECTED.values(), strict=True):
        assert same_columns(found, events)


def unchanged(sample):
    """The sample; spawned workers can't import a lambda."""
    return sample


def outcomes(path):
    """Of each recording, read twice, its events or the error."""
    try:
        store = open_store(path)
    except FormatError as error:
        return [error]
    found = []
    for name in EXPECTED:
        for _ in range(2):
            try:
                found.append(store.open(name, None).read())
            except FormatError as error:
                found.append(error)
    return found


def test_any_flipped_byte_gives_an_error_or_the_same_events(either):
    raw, expected = either.read_bytes(), [events for events in EXPECTED.values() for _ in range(2)]
    random = np.random.default_rng(0)
    counts = {"the same": 0, "an error": 0}
    for at in random.choice(len(raw), 250, replace=False).tolist():
        changed = bytearray(raw)
        changed[at] ^= 1 << int(random.integers(8))
        either.write_bytes(changed)
        found = outcomes(either)
        errors = [one for one in found if isinstance(one, FormatError)]
        assert all("a.h5" in str(error) for error in errors)
        assert errors or len(found) == 6
        for one, events in zip(found, expected, strict=False):
            assert one in errors or same_columns(one, events)
        counts["an error" if errors else "the same"] += 1
    assert min(counts.values()) > 0


def flipped_event(path, number, name="x"):
    """Flip a bit of the 20th event of a recording that isn't compressed; returns the byte of its first time."""
    store = open_store(path)
    places = dict(zip("txyp", store._places, strict=True))
    first = store._offset[number]
    raw = bytearray(path.read_bytes())
    raw[places[name][2] + (first + 20) * places[name][1]] ^= 1
    path.write_bytes(raw)
    return places["t"][2] + first * places["t"][1]


@pytest.mark.parametrize("column", ["t", "x", "y", "p"])
@pytest.mark.parametrize("window", [(None, None), (0, 10**5)])
def test_an_error_names_store_recording_and_byte(plain, column, window):
    at = flipped_event(plain, 1, column)
    store = open_store(plain)
    for _ in range(2):
        with pytest.raises(FormatError, match=rf"a\.h5:a/1\.npy: byte {at}: its events fail their checksum"):
            store.open("a/1.npy", None).read(*window)
    assert [store.fault(name) for name in EXPECTED] == ["", "its events fail their checksum", ""]
    assert same_columns(store.open("b/2.npy", None).read(), EXPECTED["b/2.npy"])


def test_intact_recordings_have_no_fault(either):
    store = open_store(either)
    assert [store.fault(name) for name in EXPECTED] == ["", "", ""]


def test_a_window_of_a_large_recording_is_not_verified_and_the_whole_is(plain, monkeypatch):
    monkeypatch.setattr(second, "CHECKED", 100)
    flipped_event(plain, 0)
    recording = open_store(plain).open(FIRST, None)
    begin = int(EXPECTED[FIRST].t[300])
    assert same_columns(recording.read(begin), EXPECTED[FIRST].window(begin))
    with pytest.raises(FormatError, match="checksum"):
        recording.read()


@pytest.mark.parametrize("keep", [0, 7, 8, 100, 2_000, 8_000, -2_000, -1])
def test_a_store_cut_short_is_refused(either, keep):
    either.write_bytes(either.read_bytes()[:keep])
    with pytest.raises(FormatError, match=r"a\.h5"):
        open_store(either)


def test_a_store_that_is_cut_short_while_it_is_open(plain):
    store = open_store(plain)
    with plain.open("r+b") as file:
        file.truncate(store._places[0][2] + 8)
    with pytest.raises(FormatError, match="truncated while it was read"):
        store.open("b/2.npy", None).read()
    assert "truncated while it was read" in store.fault("b/2.npy")


@pytest.mark.parametrize(
    ("version", "reason"), [(1, "a store older than version 2: pack it again"), (3, "newer"), (9, "newer")]
)
def test_other_versions_are_refused(either, version, reason):
    with h5py.File(either, "r+") as file:
        file.attrs["version"] = version
    with pytest.raises(FormatError, match=reason):
        open_store(either)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda f: f.attrs.pop("version"), "attribute version is None"),
        (lambda f: f.attrs.update(checksum="?"), "attribute checksum is"),
        (lambda f: f.attrs.update(checksum=5), "its index fails its checksum: pack it again"),
        (lambda f: f.attrs.update(format="else"), "is neither a folder nor a packed store"),
        (lambda f: (f.pop("index/name"), f.create_group("index/name")), "/index/name is not a dataset"),
        (lambda f: f.pop("index/name"), "there is no /index/name"),
        (lambda f: f.pop("events/x"), "there is no /events/x"),
        (
            lambda f: (f.pop("index/base"), f.create_dataset("index/base", (10**12,), "i8", chunks=(9,))),
            "0 of 111111111112 pieces of /index/base are there",
        ),
        (
            lambda f: (f.pop("events/x"), f.create_dataset("events/x", (10**12,), "u1", chunks=(9,))),
            "0 of 111111111112 pieces of /events/x are there",
        ),
        (
            lambda f: (f.pop("events/x"), f.create_dataset("events/x", data=np.zeros(1_800))),
            "of other types than a store's",
        ),
        (lambda f: (f.pop("events/x"), f.create_dataset("events/x", data=np.zeros(9, "u1"))), "contradicts itself"),
    ],
)
def test_damage_is_named(either, change, reason):
    with h5py.File(either, "r+") as file:
        change(file)
    with pytest.raises(FormatError, match=reason):
        open_store(either)


@pytest.mark.parametrize("name", ["events/x", "events/t", "events/p", "index/base", "index/mark", "index/size"])
def test_a_type_of_another_sign_changes_no_byte_and_is_refused(plain, name):
    with h5py.File(plain, "r+") as file:
        values = file[name][()]
        other = ("u" if values.dtype.kind == "i" else "i") + str(values.dtype.itemsize)
        del file[name]
        file[name] = values.view(other)
    with pytest.raises(FormatError, match="of other types"):
        open_store(plain)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"size": lambda a: a * 0 + 32_767}, ""),
        ({"size": lambda a: a * 0 + 32_768}, "contradicts itself"),
        ({"size": lambda a: a * 0}, "contradicts itself"),
        ({"offset": lambda a: a + (np.arange(a.size) == a.size - 1)}, "contradicts itself"),
        ({"offset": lambda a: np.maximum(a, 1)}, "contradicts itself"),
        ({"offset": lambda a: a[[0, 2, 1, 3]]}, "contradicts itself"),
        ({"offset": lambda a: a[:0]}, "contradicts itself"),
        ({"base": lambda a: a[1:]}, "contradicts itself"),
        ({"base": lambda a: a + 2**62}, "contradicts itself"),
        ({"duration": lambda a: a - 10**6}, "contradicts itself"),
        ({"time": lambda a: a[1:]}, "contradicts itself"),
        ({"bytes": lambda a: a[1:]}, "contradicts itself"),
        ({"crc": lambda a: a[1:]}, "contradicts itself"),
        ({"crc": lambda a: a.astype(np.float64)}, "other types or shapes"),
        ({"format": lambda a: a[:0]}, "contradicts itself"),
        ({"mark": lambda a: a[1:]}, "contradicts itself"),
        ({"file_offset": lambda a: a + 1}, "contradicts itself"),
        ({"file_name": lambda a: np.frombuffer(b"a\0a\0", np.uint8)}, "contradicts itself"),
        ({"name": lambda a: np.where(a == ord("b"), 0xFF, a).astype(np.uint8)}, "no valid names"),
        ({"reason": lambda a: a[:0]}, "no valid names"),
    ],
)
def test_which_values_an_index_may_have(plain, changes, reason):
    reindex(plain, **changes)
    if reason:
        with pytest.raises(FormatError, match=rf"a\.h5: its index .*{reason}"):
            open_store(plain)
    else:
        open_store(plain)


@pytest.mark.parametrize("checked", [second.CHECKED, 0])
def test_an_index_with_a_right_checksum_that_states_a_smaller_sensor(either, monkeypatch, checked):
    monkeypatch.setattr(second, "CHECKED", checked)
    reindex(either, size=lambda a: a * 0 + 5)
    store = open_store(either)
    for window in ((), (0, 10**5), ()):
        with pytest.raises(FormatError, match="outside the sensor of 5x5"):
            store.open(FIRST, None).read(*window)
    # verifying must not make it trusted
    assert "outside the sensor of 5x5" in store.fault(FIRST)
    with pytest.raises(FormatError, match="outside the sensor of 5x5"):
        store.open(FIRST, None).read()


@pytest.mark.parametrize("name", ["mark", "duration"])
def test_an_index_with_a_right_checksum_and_other_times(either, name):
    reindex(either, **{name: lambda a: a + a.dtype.type(1_000)})
    store = open_store(either)
    with pytest.raises(FormatError, match="its index has other times than"):
        store.open(FIRST, None).read(0, 10**5)
    assert "its index has other times than" in store.fault(FIRST)


def test_another_sensor_than_the_packed_one(either):
    store = open_store(either)
    assert store.open(FIRST, (40, 34)).read().sensor_size == (40, 34)
    with pytest.raises(FormatError, match="outside the sensor of 34x5"):
        store.open(FIRST, (34, 5)).read()


@pytest.mark.parametrize("name", ["index/base", "events/x"])
@pytest.mark.parametrize("how", ["external link", "virtual", "stored externally"])
def test_a_store_does_not_speak_of_other_files(plain, name, how):
    shutil.copy(plain, plain.with_name("other.h5"))
    with h5py.File(plain, "r+") as file:
        shape, kind = file[name].shape, file[name].dtype
        del file[name]
        lead_elsewhere(file, name, how, plain.with_name("other.h5"), shape, kind)
    with pytest.raises(FormatError, match=f"{name} is .*{how}.*: other files are read only with NVSDATA_HDF5_LINKS=1"):
        open_store(plain)


def test_columns_in_another_file_are_read_where_links_are_followed(plain, monkeypatch):
    plain.rename(plain.with_name("other.h5"))
    with h5py.File(plain.with_name("other.h5")) as other, h5py.File(plain, "w") as file:
        for name in INDEX:
            file[f"index/{name}"] = other[f"index/{name}"][()]
        # where it would be read from if it were in this file
        file["more"] = np.zeros(100_000, np.uint8)
        for name in "txyp":
            file[f"events/{name}"] = h5py.ExternalLink("other.h5", f"events/{name}")
        file.attrs.update(other.attrs)
    monkeypatch.setenv("NVSDATA_HDF5_LINKS", "1")
    assert same_columns(open_store(plain).open(FIRST, None).read(), EXPECTED[FIRST])


def test_soft_links_within_a_store_are_followed(either):
    with h5py.File(either, "r+") as file:
        file.move("events/x", "elsewhere")
        file["events/x"] = h5py.SoftLink("/elsewhere")
    for name, events in EXPECTED.items():
        assert same_columns(open_store(either).open(name, None).read(), events)


def test_a_column_that_ends_beyond_the_file_is_refused(tmp_path):
    (tmp_path / "a.h5").write_bytes(bytes(100))

    def column(offset, size):
        numbers = SimpleNamespace(size=size, nbytes=4 * size, chunks=None, dtype=np.dtype("i4"), name="/t")
        numbers.id = SimpleNamespace(get_offset=lambda: offset)
        return second._place(tmp_path / "a.h5", numbers)

    assert column(20, 20) == (np.dtype("i4"), 4, 20)
    with pytest.raises(FormatError, match=r"a\.h5.*byte 24: cut short within /t"):
        column(24, 20)
    # nothing is stored of an empty one
    assert column(None, 0) == (np.dtype("i4"), 4, 0)
    assert column(None, 3) is None


def test_a_store_is_no_recording(either):
    with pytest.raises(FormatError, match="a packed store of many recordings"):
        nvsdata.open(either)
