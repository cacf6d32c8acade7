"""Bytes of a store that have changed since it was packed: an error, or no difference; never other events."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
import trees

import nvsdata
from nvsdata import NMNIST, FormatError
from nvsdata.datasets.store import reader


@pytest.fixture
def store(home, tmp_path):
    nvsdata.pack(NMNIST(home(trees.nmnist()), "all"), tmp_path / "digits.h5")
    return tmp_path / "digits.h5"


def flipped(path, at, bit=0):
    raw = bytearray(path.read_bytes())
    raw[at] ^= 1 << bit
    other = path.with_name("flipped.h5")
    other.write_bytes(raw)
    return other


def place_of_events(path, number, column=1):
    """The byte of the first event's `column` of a recording."""
    opened = reader.Store(path)
    _, size, begin = opened._places[column]
    return begin + opened._offset[number] * size


def test_any_flipped_byte_gives_an_error_or_the_same_events(store):
    expected = list(NMNIST(store, "all"))
    random = np.random.default_rng(0)
    found = {"the same": 0, "an error": 0}
    for at in random.choice(store.stat().st_size, 400, replace=False).tolist():
        try:
            samples = list(NMNIST(flipped(store, at, int(random.integers(8))), "all"))
        except FormatError as error:
            found["an error"] += "flipped.h5" in str(error)
        else:
            assert samples == expected
            found["the same"] += 1
    assert sum(found.values()) == 400
    assert min(found.values()) > 0


@pytest.mark.parametrize("name", ["events/x", "events/t", "events/p", "index/base", "index/mark", "index/size"])
def test_a_type_of_another_sign_changes_no_byte_and_is_found_out(store, name):
    with h5py.File(store, "r+") as file:
        values = file[name][()]
        other = ("u" if values.dtype.kind == "i" else "i") + str(values.dtype.itemsize)
        del file[name]
        file[name] = values.view(other)
    with pytest.raises(FormatError, match="of other types"):
        NMNIST(store, "all")


@pytest.mark.parametrize("window", [(None, None), (0, 10)])
def test_an_error_names_store_recording_and_byte(store, window):
    at = place_of_events(store, 3)
    dataset = NMNIST(flipped(store, at), "all")
    name = dataset.source.names[3]
    begin = place_of_events(store, 3, column=0)
    with pytest.raises(FormatError, match=rf"flipped\.h5:{name}: byte {begin}: .* checksum"):
        dataset.open_recording(name).read(*window)
    # and no other recording
    assert len(dataset.open_recording(dataset.source.names[4]).read())


def test_a_recording_is_verified_at_its_first_read_only(store, monkeypatch):
    dataset = NMNIST(store, "all")
    verified = []
    monkeypatch.setattr(reader, "crc_of", lambda raw, real=reader.crc_of: verified.append(len(raw[0])) or real(raw))
    lengths = [len(dataset[index][0]) for index in (0, 1, 0)]
    dataset.recording(1).read(0, 5)
    assert verified == lengths[:2]


def test_a_window_of_a_long_recording_is_not_verified_the_whole_is(store, monkeypatch):
    monkeypatch.setattr(reader, "CHECKED", 100)
    damaged = NMNIST(flipped(store, place_of_events(store, 0)), "all")
    recording = damaged.open_recording(damaged.source.names[0])
    recording.read(recording.span[0] + 1)
    with pytest.raises(FormatError, match="checksum"):
        recording.read()


def test_verification_can_be_turned_off(store, monkeypatch):
    expected = NMNIST(store, "all").source.read(0, 0, 2**40)
    monkeypatch.setenv("NVSDATA_STORE_CHECK", "0")
    found = NMNIST(flipped(store, place_of_events(store, 0)), "all").source.read(0, 0, 2**40)
    assert np.array_equal(found.t, expected.t)
    assert (found.x != expected.x).sum() == 1


def other_type(index):
    index["crc"] = index["crc"].astype(">u4").astype(np.float64)


def no_text(index):
    index["name"] = np.where(index["name"] == ord("b"), 0xFF, index["name"]).astype(np.uint8)


def far_times(index):
    index["base"] = index["base"] + 2**62


def fewer_files(index):
    index["file_name"] = np.frombuffer(b"a\0a\0", np.uint8)


@pytest.mark.parametrize("change", [other_type, no_text, far_times, fewer_files])
def test_an_index_with_a_right_checksum_that_is_none(store, change):
    with h5py.File(store, "r+") as file:
        index = {name: file[f"index/{name}"][()] for name in reader.INDEX}
        change(index)
        for name, array in index.items():
            del file[f"index/{name}"]
            file[f"index/{name}"] = array
        file.attrs["checksum"] = reader.checksum(index)
    with pytest.raises(FormatError, match="its index"):
        reader.Store(store)


@pytest.mark.parametrize("checked", [1 << 22, 0])
def test_an_index_with_a_right_checksum_that_states_a_smaller_sensor(store, monkeypatch, checked):
    monkeypatch.setattr(reader, "CHECKED", checked)
    with h5py.File(store, "r+") as file:
        file["index/size"][...] = 5
        file.attrs["checksum"] = reader.checksum({name: file[f"index/{name}"][()] for name in reader.INDEX})
    opened = reader.Store(store)
    recording = opened.open(opened.names[0], None)
    for window in ((), (0, 10**5)):
        with pytest.raises(FormatError, match="outside the sensor of 5x5"):
            recording.read(*window)
    # verifying must not make it trusted
    assert "outside the sensor of 5x5" in opened.fault(opened.names[0])
    with pytest.raises(FormatError, match="outside the sensor of 5x5"):
        opened.open(opened.names[0], None).read()


def test_a_smaller_sensor_than_the_packed_one(store):
    opened = reader.Store(store)
    assert opened.open(opened.names[0], (40, 34)).read().sensor_size == (40, 34)
    with pytest.raises(FormatError, match="outside the sensor of 34x5"):
        opened.open(opened.names[0], (34, 5)).read()


def test_events_of_other_types(store):
    with h5py.File(store, "r+") as file:
        values = file["events/x"][()].astype(np.float64)
        del file["events/x"]
        file["events/x"] = values
    with pytest.raises(FormatError, match="of other types than a store's"):
        reader.Store(store)


@pytest.mark.parametrize("name", ["mark", "duration"])
def test_an_index_with_a_right_checksum_and_other_times(store, name):
    with h5py.File(store, "r+") as file:
        file[f"index/{name}"][...] += 1_000
        file.attrs["checksum"] = reader.checksum({name: file[f"index/{name}"][()] for name in reader.INDEX})
    opened = reader.Store(store)
    with pytest.raises(FormatError, match="its index has other times than"):
        opened.open(opened.names[0], None).read(0, 10**5)
