import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import events

import nvsdata
from nvsdata import Events, FormatError, formats
from nvsdata.formats.hdf5 import writer as hdf5_writer
from nvsdata.formats.hdf5.writer import deflated


def write(ev, path):
    return formats.write(ev, path, format="hdf5-gzip")


@given(events(max_size=80), st.sampled_from([1, 7, 1 << 14]), st.integers(0, 100_000), st.integers(0, 100_000))
def test_what_is_written_is_read(tmp_path, ev, chunk, start, length):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hdf5_writer, "DEFLATED", chunk)
        assert write(ev, tmp_path / "a.h5") == len(ev)
    found = nvsdata.open(tmp_path / "a.h5")
    assert found.read() == ev
    assert found.read(start, start + length) == ev.window(start, start + length)


@given(st.integers(1, 300), st.integers(0, 2**63 - 1))
def test_any_hdf5_library_undoes_shuffle_and_gzip(tmp_path, count, seed):
    values = np.random.default_rng(seed).integers(0, 2**63, count, np.int64)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        made = file.create_dataset("a", (count,), "i8", chunks=(count,), shuffle=True, compression="gzip")
        made.id.write_direct_chunk((0,), deflated(values))
    with h5py.File(tmp_path / "a.h5") as file:
        assert (file["a"][:] == values).all()


def test_a_long_recording_in_pieces_takes_a_third(tmp_path):
    rng = np.random.default_rng(0)
    count = 5 * hdf5_writer.DEFLATED + 3
    t = np.sort(rng.integers(0, 10_000_000, count))
    ev = Events(t, rng.integers(0, 346, count), rng.integers(0, 260, count), rng.integers(0, 2, count), (346, 260))
    write((ev[n : n + 1_000] for n in range(0, count, 1_000)), tmp_path / "a.h5")
    formats.write(ev, tmp_path / "b.h5")
    assert nvsdata.read(tmp_path / "a.h5") == ev
    for start in (0, 1_234_567, 9_999_000):
        assert nvsdata.read(tmp_path / "a.h5", start, start + 30_000) == ev.window(start, start + 30_000)
    # places without any order are its worst case
    assert (tmp_path / "a.h5").stat().st_size < 0.5 * (tmp_path / "b.h5").stat().st_size
    with h5py.File(tmp_path / "a.h5") as file:
        assert {file[f"events/{name}"].compression for name in "txyp"} == {"gzip"}
        assert (file["events/t"][:] == t).all()
    with h5py.File(tmp_path / "b.h5") as file:
        assert {file[f"events/{name}"].compression for name in "txyp"} == {None}


def test_a_recording_of_hours(tmp_path, monkeypatch):
    monkeypatch.setattr(hdf5_writer, "DEFLATED", 4)
    late = Events([1, 2, 3, 4, 5, 2**32, 2**33], [0] * 7, [0] * 7, [1] * 7, (9, 9))
    write((late[n : n + 1] for n in range(7)), tmp_path / "a.h5")
    assert nvsdata.read(tmp_path / "a.h5") == late


def test_damage_is_noticed(tmp_path):
    count = 20_000
    rng = np.random.default_rng(1)
    ev = Events(np.arange(count), rng.integers(0, 200, count), rng.integers(0, 99, count), np.ones(count), (240, 180))
    write(ev, tmp_path / "a.h5")
    whole = (tmp_path / "a.h5").read_bytes()
    for at in rng.integers(len(whole) // 4, len(whole) * 3 // 4, 20).tolist():
        bad = bytearray(whole)
        bad[at] ^= 0x40
        (tmp_path / "b.h5").write_bytes(bad)
        with pytest.raises(FormatError):
            nvsdata.read(tmp_path / "b.h5")


def test_names_and_suffixes(tmp_path):
    ev = Events([1], [2], [3], [1], (9, 9))
    write(ev, tmp_path / "a.hdf5")
    assert nvsdata.open(tmp_path / "a.hdf5").format == "hdf5"
    with pytest.raises(ValueError, match=r"can't write a file with '.aedat4' as 'hdf5-gzip'; known are .*hdf5-gzip"):
        write(ev, tmp_path / "a.aedat4")
