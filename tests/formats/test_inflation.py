"""Small files that inflate to far more than any recording does: an error, before the memory is taken."""

import struct
import tracemalloc
import zlib

import h5py
import numpy as np
import pytest
from flatbuffers import aedat4_file, frame, row
from lookalikes import MATLAB_73, aedat4_events, aedat4_packet, hdf5_bytes

import nvsdata
from nvsdata import Events, FormatError
from nvsdata.formats import contents
from nvsdata.formats.aedat import aedat4
from nvsdata.formats.contents import Allowance
from nvsdata.formats.hdf5.chunks import Chunks

EV = Events([1, 5], [1, 2], [3, 4], [0, 1], (320, 240))
SIZE = (320, 240)
STREAMS = ("EVTS", "FRME", "IMUS", "TRIG")


def packed(packets, compression):
    """An AEDAT 4 file of packets (stream, content, how often), each compressed only once; it has no table."""
    pytest.importorskip("lz4" if compression < 3 else "zstandard")
    raw = bytearray(aedat4_file([], compression))
    raw[46:54] = struct.pack("<q", -1)
    for stream, content, count in packets:
        raw += aedat4_packet(STREAMS.index(stream), content, compression) * count
    return bytes(raw)


def zeros(count):
    """A packet of events at time 0."""
    body = struct.pack("<I4s3H2xiII", 16, b"EVTS", 6, 8, 4, 8, 4, count) + bytes(16 * count)
    return struct.pack("<I", len(body)) + body


def opened(tmp_path, raw, **how):
    (tmp_path / "a.aedat4").write_bytes(raw)
    return nvsdata.open(tmp_path / "a.aedat4", sensor_size=SIZE, **how)


@pytest.fixture
def small(monkeypatch):
    """A bound of 100 kB in the place of 64 MiB, so that tests need no memory, and 2 times the size for 100."""
    monkeypatch.setattr(contents, "ALWAYS", 100_000)
    monkeypatch.setattr(contents, "RATIO", 2)


def test_parts_take_from_what_a_file_is_allowed(small):
    left = Allowance(1_000)
    assert (left.left, left.of(10), left.of(10**9)) == (100_000,) * 3
    left.take(99_000)
    assert left.of(10) == 1_000
    left.take(1_000)
    with pytest.raises(ValueError, match="expands too far: a file of 1000 bytes may expand to 100000 at most"):
        left.take(1)
    assert Allowance(60_000).left == 120_000
    assert Allowance(60_000).of(10) == 100_000


@pytest.mark.parametrize("compression", [1, 2, 3, 4])
@pytest.mark.parametrize("window", [(), (0, 10)])
def test_packets_of_events_inflate_to_the_bound_all_together(tmp_path, compression, window, small):
    content = zeros(2_000)
    assert len(opened(tmp_path, packed([("EVTS", content, 3)], compression)).read(*window)) == 6_000
    raw = packed([("EVTS", content, 4)], compression)
    with pytest.raises(FormatError, match=rf"expands to .* a file of {len(raw)} bytes may expand to") as caught:
        opened(tmp_path, raw).read(*window)
    assert caught.value.offset == len(raw) - (len(raw) - len(packed([], compression))) // 4
    # one alone
    with pytest.raises(FormatError, match="expands to"):
        opened(tmp_path, packed([("EVTS", zeros(6_500), 1)], compression)).read(*window)


def test_a_window_counts_only_the_packets_that_it_touches(tmp_path, small):
    pytest.importorskip("lz4")
    packets, rows, at = [], [], 0
    for n in range(8):
        content = aedat4_events(Events(np.full(2_000, n * 100), [1] * 2_000, [1] * 2_000, [0] * 2_000, SIZE))
        packets.append(("EVTS", content))
        size = len(aedat4_packet(0, content, 1)) - 8
        rows.append((at + 8, 0, size, 2_000, n * 100, n * 100))
        at += 8 + size
    raw = aedat4_file(packets, 1, table=lambda begin: [(begin + first, *rest) for first, *rest in rows])
    recording = opened(tmp_path, raw)
    assert len(recording.read(700, 800)) == 2_000
    assert recording._whole is None
    with pytest.raises(FormatError, match="may expand to"):
        recording.read()


@pytest.mark.parametrize("compression", [1, 3])
def test_without_strict_packets_beyond_the_bound_are_left_out(tmp_path, compression, small):
    raw = packed([("EVTS", zeros(2_000), 2), ("EVTS", zeros(20_000), 3)], compression)
    recording = opened(tmp_path, raw, strict=False)
    assert len(recording.read()) == 4_000
    assert recording.repairs == {"damaged packets, left out": 3}


@pytest.mark.parametrize("compression", [1, 3])
def test_frames_inflate_to_the_bound_all_together(tmp_path, compression, small):
    picture = frame([1] * 5, 0, 100, 300, (0, 0), bytes(30_000))
    events = ("EVTS", aedat4_events(EV), 1)
    assert len(list(opened(tmp_path, packed([events, ("FRME", picture, 3)], compression)).frames())) == 3
    with pytest.raises(FormatError, match="may expand to 100000 at most"):
        list(opened(tmp_path, packed([events, ("FRME", picture, 4)], compression)).frames())


@pytest.mark.parametrize("stream", ["IMUS", "TRIG"])
def test_samples_that_are_all_the_same_table(tmp_path, stream):
    """Four bytes of the vector for each would otherwise become hundreds in memory."""
    count, (table, begin) = 1_000, row([("<q", 1)])
    out = struct.pack("<I4s3H2xiII", 16, stream.encode(), 6, 8, 4, 8, 4, count)
    out += b"".join(struct.pack("<I", 4 * count + begin - 4 * n) for n in range(count)) + table
    content = struct.pack("<I", len(out)) + out
    recording = opened(tmp_path, packed([("EVTS", aedat4_events(EV), 1), (stream, content, 1)], 1))
    with pytest.raises(FormatError, match="1000 tables in"):
        recording.inertial() if stream == "IMUS" else recording.triggers()


def test_a_table_at_the_end_that_inflates_too_far_is_not_used(tmp_path, small):
    pytest.importorskip("lz4")
    raw = aedat4_file([("EVTS", aedat4_events(EV))], 1, table=[])
    assert opened(tmp_path, raw + aedat4_packet(0, bytes(200_000), 1)[8:]).read(0, 9) == EV.window(0, 9)


def test_a_header_of_megabytes_is_refused(tmp_path, monkeypatch):
    raw = aedat4_file([("EVTS", aedat4_events(EV))])
    length = struct.unpack_from("<I", raw, 14)[0]
    monkeypatch.setattr(aedat4, "MOST_HEADER", length)
    assert opened(tmp_path, raw).read() == EV
    monkeypatch.setattr(aedat4, "MOST_HEADER", length - 1)
    with pytest.raises(FormatError, match=f"a header of {length} bytes, more than {length - 1}"):
        opened(tmp_path, raw)


def test_a_bomb_of_a_few_kilobytes_takes_no_memory(tmp_path):
    """At the real bound: each packet is 32 MiB of zeros."""
    pytest.importorskip("zstandard")
    raw = packed([("EVTS", zeros(1 << 21), 30)], 3)
    assert len(raw) < 40_000
    recording = opened(tmp_path, raw)
    tracemalloc.start()
    with pytest.raises(FormatError, match="may expand to 67108864 at most"):
        recording.read()
    assert tracemalloc.get_traced_memory()[1] < 150 << 20
    tracemalloc.stop()


COLUMNS = {"t": "i8", "x": "i2", "y": "i2", "p": "u1"}


def chunked(path, before, content, count=1_000, filters=1, **columns):
    """HDF5 with deflated columns of `count` values in one chunk; `columns`: other contents of the chunks."""
    with h5py.File(path, "w") as file:
        space = h5py.h5s.create_simple((count,))
        for name, kind in COLUMNS.items():
            plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            plist.set_chunk((count,))
            for _ in range(filters):
                plist.set_deflate(1)
            group = file.require_group(before)
            made = h5py.h5d.create(group.id, name.encode(), h5py.h5t.py_create(np.dtype(kind)), space, plist)
            made.write_direct_chunk((0,), columns.get(name, content(count * np.dtype(kind).itemsize)))


@pytest.mark.parametrize("name", COLUMNS)
def test_a_chunk_of_hdf5_that_inflates_beyond_its_size(tmp_path, name):
    """HDF5 doubles its memory until all of a chunk's stream fits."""
    path = tmp_path / "a.h5"
    chunked(path, "events", lambda size: zlib.compress(bytes(size)))
    assert len(nvsdata.read(path)) == 1_000
    chunked(path, "events", lambda size: zlib.compress(bytes(size)), **{name: zlib.compress(bytes(1 << 20))})
    size = 1_000 * np.dtype(COLUMNS[name]).itemsize
    for window in ((), (0, 5)):
        with pytest.raises(FormatError, match=f"a chunk of /events/{name} at 0 expands to more than its {size} bytes"):
            nvsdata.read(path, *window)


@pytest.mark.parametrize("kind", ["u1", "<i2", ">i4", "<u8", "f4", "?"])
@pytest.mark.parametrize("how", [{}, {"shuffle": True}, {"fletcher32": True}, {"shuffle": True, "fletcher32": True}])
@pytest.mark.parametrize("size", [(1,), (100,), (99,), (30, 7)])
def test_values_are_those_that_the_library_reads(tmp_path, kind, how, size):
    values = np.random.default_rng(0).integers(0, 2 if kind == "?" else 250, size).astype(kind)
    chunks = (min(8, size[0]), *(3,) * (len(size) - 1))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        stored = file.create_dataset("a", data=values, chunks=chunks, compression="gzip", **how)
        if len(size) == 1 and size[0] > 8:
            # as HDF5 does where compression doesn't pay: no filter is applied to the chunk
            stored.id.write_direct_chunk((8,), values[8:16].tobytes(), 0xF)
        found = Chunks("a", stored)
        assert np.array_equal(found.read(), values)
        for lo, hi in ((0, 0), (0, 1), (7, 9), (50, 50), (90, 200), (size[0], size[0]), (120, 130)):
            assert np.array_equal(found.read(lo, hi), values[lo:hi])
            assert found.read(lo, hi).dtype == values.dtype


def test_hdf5_that_is_compressed_more_than_once_is_refused(tmp_path):
    chunked(tmp_path / "a.h5", "events", lambda size: zlib.compress(zlib.compress(bytes(size))), filters=2)
    with pytest.raises(FormatError, match="/events/t is compressed more than once"):
        nvsdata.read(tmp_path / "a.h5")
    # shuffled afterwards, so that what is stored is no stream of zlib
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_chunk((1_000,))
    plist.set_deflate(9)
    plist.set_shuffle()
    with h5py.File(tmp_path / "b.h5", "w") as file:
        for name, kind in COLUMNS.items():
            space, type = h5py.h5s.create_simple((1_000,)), h5py.h5t.py_create(np.dtype(kind))
            h5py.Dataset(h5py.h5d.create(file.id, name.encode(), type, space, plist))[:] = 1
    with pytest.raises(FormatError, match="/t is compressed more than once, or filtered after that"):
        nvsdata.read(tmp_path / "b.h5")


def test_a_chunk_of_matlab_and_of_samples(tmp_path):
    columns = {"ts": EV.t, "x": EV.x, "y": EV.y, "pol": EV.p}
    whole = {name: {"data": column, "chunks": (2,), "compression": "gzip"} for name, column in columns.items()}
    path = tmp_path / "a.mat"
    path.write_bytes(hdf5_bytes(whole, MATLAB_73))
    assert nvsdata.read(path, sensor_size=SIZE) == EV
    with h5py.File(path, "r+") as file:
        file["x"].id.write_direct_chunk((0,), zlib.compress(bytes(1 << 20)))
    with pytest.raises(FormatError, match="a chunk of /x at 0 expands to more than its 4 bytes"):
        nvsdata.read(path, sensor_size=SIZE)
    path = tmp_path / "a.h5"
    nvsdata.write(EV, path)
    with h5py.File(path, "r+") as file:
        for name, shape in {"t": (2,), "acceleration": (2, 3), "rotation": (2, 3), "temperature": (2,)}.items():
            kind = "i8" if name == "t" else "f4"
            file.create_dataset(f"inertial/{name}", shape, kind, np.ones(shape), chunks=shape, compression="gzip")
    assert nvsdata.open(path).inertial().acceleration.tolist() == [[1.0] * 3] * 2
    with h5py.File(path, "r+") as file:
        file["inertial/rotation"].id.write_direct_chunk((0, 0), zlib.compress(bytes(1 << 20)))
    with pytest.raises(FormatError, match="a chunk of /inertial/rotation at 0, 0 expands to more than its 24 bytes"):
        nvsdata.open(path).inertial()


@pytest.mark.parametrize("kind", ["h5", "mat"])
def test_columns_of_hdf5_claim_up_to_the_bound_all_together(tmp_path, kind, small):
    n = 10_000
    names = ("ts", "x", "y", "pol") if kind == "mat" else ("events/t", "events/x", "events/y", "events/p")
    path = tmp_path / f"a.{kind}"

    def write(itemsize):
        column = {"data": np.ones(n, f"u{itemsize}"), "chunks": (n,), "compression": "gzip"}
        path.write_bytes(hdf5_bytes(dict.fromkeys(names, column), MATLAB_73 if kind == "mat" else b""))
        return nvsdata.read(path, sensor_size=SIZE)

    assert len(write(2)) == n
    with pytest.raises(FormatError, match=r"expands too far: a file of .* may expand to 100000 at most"):
        write(4)
