"""HDF5 files as Metavision writes them, without Prophesee's plugin."""

import sys

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from metavision_files import ECF, EVENT, SEPARATE, TOGETHER, X_WITH_POLARITY, ecf_bytes, metavision_bytes

import nvsdata
from nvsdata import FormatError
from nvsdata.formats.hdf5.chunks import Chunks

CHUNK = 64


@pytest.mark.parametrize("coding", [SEPARATE, X_WITH_POLARITY, TOGETHER])
def test_recordings_and_windows(tmp_path, ev, coding, monkeypatch):
    monkeypatch.setitem(sys.modules, "hdf5plugin", None)
    path = tmp_path / "a.h5"
    path.write_bytes(metavision_bytes(ev, CHUNK, coding))
    assert len(ev) % CHUNK, "the last chunk is to have fewer events"
    recording = nvsdata.open(path)
    assert recording.sensor_size == ev.sensor_size
    assert not recording.size_is_guessed
    assert recording.read() == ev
    for first, last in ((0, 10), (CHUNK - 1, CHUNK + 1), (len(ev) - 5, len(ev) - 1)):
        window = int(ev.t[first]), int(ev.t[last])
        assert recording.read(*window) == ev.window(*window)


def test_an_empty_recording(tmp_path, ev):
    path = tmp_path / "a.h5"
    path.write_bytes(metavision_bytes(ev[:0]))
    assert len(nvsdata.read(path)) == 0


def changed(path, ev, first, change):
    """A file with another chunk at `first`."""
    path.write_bytes(metavision_bytes(ev, CHUNK))
    with h5py.File(path, "r+") as file:
        table = file["CD/events"].id
        table.write_direct_chunk((first,), change(table.read_direct_chunk((first,))[1]))
    return path


def test_damaged_chunks_are_named(tmp_path, ev):
    path = changed(tmp_path / "a.h5", ev, CHUNK, lambda raw: raw[:-1])
    with pytest.raises(FormatError, match="a chunk of /CD/events at 64 is damaged ECF data"):
        nvsdata.read(path)
    # sound chunks of other files: with fewer events than there are, or more than a chunk has
    last = len(ev) // CHUNK * CHUNK
    few, many = ev[: len(ev) - last - 1], ev[: CHUNK + 1]
    for first, other, reason in (
        (last, few, f"{16 * len(few)} of its {16 * len(few) + 16}"),
        (0, many, "more than its 1024"),
    ):
        (tmp_path / "other.h5").write_bytes(metavision_bytes(other, 2 * CHUNK))
        with h5py.File(tmp_path / "other.h5") as source:
            raw = source["CD/events"].id.read_direct_chunk((0,))[1]
        path = changed(tmp_path / "a.h5", ev, first, lambda _, raw=raw: raw)
        with pytest.raises(FormatError, match=f"a chunk of /CD/events at {first} expands to {reason} bytes"):
            nvsdata.read(path)


@given(st.data())
def test_any_damage_is_an_error_or_events_on_the_sensor(tmp_path, ev, data):
    raw = bytearray(metavision_bytes(ev, CHUNK))
    for _ in range(data.draw(st.integers(1, 4))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / "a.h5"
    path.write_bytes(raw)
    try:
        found = nvsdata.read(path, sensor_size=(2053, 2048))
    except (FormatError, ImportError):
        return
    assert (np.diff(found.t) >= 0).all()


@pytest.mark.parametrize("change", ["checksum", "shuffle", "order", "packed", "big-endian"])
def test_other_tables_by_ecf_are_refused(tmp_path, ev, change):
    """Only Metavision's rows are what ECF expands to, and no library undoes a second filter."""
    names = list("xypt" if change != "order" else "txyp")
    kind = np.dtype({"names": names, "formats": [EVENT[name] for name in names]}, align=change == "order")
    kind = {"packed": kind, "order": kind, "big-endian": EVENT.newbyteorder()}.get(change, EVENT)
    layout = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    layout.set_chunk((CHUNK,))
    if change == "shuffle":
        layout.set_shuffle()
    layout.set_filter(ECF, h5py.h5z.FLAG_OPTIONAL, ())
    if change == "checksum":
        layout.set_fletcher32()
    with h5py.File(tmp_path / "a.h5", "w") as file:
        space = h5py.h5s.create_simple((CHUNK,))
        table = h5py.h5d.create(
            file.create_group("CD").id, b"events", h5py.h5t.py_create(kind, logical=True), space, layout
        )
        table.write_direct_chunk((0,), ecf_bytes(*ev[:CHUNK].columns, SEPARATE))
    with pytest.raises(FormatError, match=r"compressed by ECF, but isn't a table of events|filtered after that"):
        nvsdata.read(tmp_path / "a.h5")


@pytest.mark.parametrize(
    ("geometry", "size"),
    [(b"1280x720", (1280, 720)), (np.bytes_("64x48 \n"), (64, 48)), ("1280 720", None), (7, None), ("x" * 5000, None)],
)
def test_the_attribute_of_the_sensor_size(tmp_path, ev, geometry, size):
    path = tmp_path / "a.h5"
    path.write_bytes(metavision_bytes(ev, CHUNK))
    with h5py.File(path, "r+") as file:
        file.attrs["geometry"] = geometry
    recording = nvsdata.open(path)
    recording.read()
    assert recording.size_is_guessed == (size is None)
    assert size in (None, recording.sensor_size)
    with h5py.File(path, "r+") as file:
        file.attrs["geometry"] = "99999x5"
    with pytest.raises(FormatError, match=r"invalid sensor size: .*\(99999, 5\)"):
        nvsdata.open(path)


def test_a_table_is_read_once_for_all_columns(tmp_path, ev, monkeypatch):
    read, counted = Chunks._read, []
    monkeypatch.setattr(
        Chunks, "_read", lambda self, first, last: counted.append((first, last)) or read(self, first, last)
    )
    for how in ({}, {"compression": "gzip", "chunks": (CHUNK,)}):
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file.create_dataset("CD/events", data=ev.to_structured(), **how)
        assert nvsdata.read(tmp_path / "a.h5", sensor_size=ev.sensor_size) == ev
        assert counted == [(0, len(ev))]
        counted.clear()
