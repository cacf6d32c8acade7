"""HDF5 chunks of another size than stated: errors, because the HDF5 library would read the memory behind them."""

import bz2
import zlib

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import nvsdata
from nvsdata import FormatError
from nvsdata.formats.hdf5.chunks import Chunks
from nvsdata.formats.hdf5.filters import BZIP2, EXPANDED, LZF, expanded_size
from nvsdata.kernels.decode.lzf import expand_lzf

SIZE = 100  # values of 2 bytes in a chunk
VALUES = np.random.default_rng(0).integers(0, 9, 350).astype("<i2")
PLUGINS = {
    **{f"blosc {name}": ("Blosc", {"cname": name}) for name in ("blosclz", "lz4", "zlib", "zstd")},
    "blosc, stored": ("Blosc", {"clevel": 0}),
    "blosc, bits": ("Blosc", {"shuffle": 2}),
    "lz4": ("LZ4", {}),
    "lz4, small blocks": ("LZ4", {"nbytes": 64}),
    "bitshuffle lz4": ("Bitshuffle", {}),
    "bitshuffle zstd": ("Bitshuffle", {"cname": "zstd"}),
    "zstd": ("Zstd", {}),
    "bzip2": ("BZip2", {}),
}
BITS = {"compression": 32008, "compression_opts": (0, 0)}  # Bitshuffle without compression
WAYS = {
    "none": {},
    "shuffle": {"shuffle": True},
    "checksum": {"fletcher32": True},
    "gzip": {"compression": "gzip", "shuffle": True},
    "gzip, checksum": {"compression": "gzip", "fletcher32": True},
    "lzf": {"compression": "lzf"},
    "lzf, shuffle": {"compression": "lzf", "shuffle": True},
    "lzf, checksum": {"compression": "lzf", "shuffle": True, "fletcher32": True},
}


def ways(name):
    if name not in PLUGINS:
        return WAYS[name]
    plugins = pytest.importorskip("hdf5plugin")
    kind, options = PLUGINS[name]
    return dict(getattr(plugins, kind)(**options))


def stored(path, values, how, chunk=SIZE):
    with h5py.File(path, "w") as file:
        file.create_dataset("a", data=values, chunks=(chunk,), **how)
    return path


@pytest.mark.parametrize("name", [*WAYS, *PLUGINS])
@pytest.mark.parametrize("kind", ["<i2", ">i4", "f8", [("x", "<i2"), ("p", "u1")]])
def test_sound_chunks_are_those_of_the_library(tmp_path, name, kind):
    values = VALUES.astype(kind)
    with h5py.File(stored(tmp_path / "a.h5", values, ways(name))) as file:
        chunks = Chunks("a.h5", file["a"])
        for lo, hi in ((0, 350), (99, 101), (340, 400), (5, 5)):
            assert np.array_equal(chunks.read(lo, hi), values[lo:hi])


@pytest.mark.parametrize("name", [*WAYS, *PLUGINS])
@pytest.mark.parametrize("count", [1, SIZE - 1, SIZE + 1, 3 * SIZE])
def test_chunks_of_another_size_are_refused(tmp_path, name, count):
    """The second of three chunks is replaced by a sound one of another file, whose chunks have `count` values."""
    how = ways(name)
    other = stored(tmp_path / "other.h5", VALUES[:count], how, chunk=count)
    with h5py.File(other) as file:
        mask, raw = file["a"].id.read_direct_chunk((0,))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        made = file.create_dataset("a", VALUES.shape, VALUES.dtype, chunks=(SIZE,), **how)
        # the first to be written, because the library keeps the size of a chunk that is there
        made.id.write_direct_chunk((SIZE,), raw, mask)
        made[:SIZE], made[2 * SIZE :] = VALUES[:SIZE], VALUES[2 * SIZE :]
    with h5py.File(tmp_path / "a.h5") as file:
        chunks = Chunks("a.h5", file["a"])
        assert np.array_equal(chunks.read(0, SIZE), VALUES[:SIZE])
        found = f"more than its {2 * SIZE}" if count > SIZE else f"{2 * count} of its {2 * SIZE}"
        for lo, hi in ((0, 350), (SIZE, SIZE + 1), (SIZE - 1, SIZE + 1)):
            with pytest.raises(FormatError, match=f"a chunk of /a at {SIZE} expands to {found} bytes"):
                chunks.read(lo, hi)


@pytest.mark.parametrize("mask", [0, 1])
def test_a_chunk_that_skips_its_filter(tmp_path, mask):
    with h5py.File(stored(tmp_path / "a.h5", VALUES, {"compression": "gzip"}), "r+") as file:
        raw = VALUES[:SIZE].tobytes()
        file["a"].id.write_direct_chunk((SIZE,), raw if mask else zlib.compress(raw), mask)
        assert np.array_equal(Chunks("a", file["a"]).read(SIZE, 2 * SIZE), VALUES[:SIZE])
        file["a"].id.write_direct_chunk((SIZE,), raw[:-2], mask)
        with pytest.raises(FormatError, match="198 of its 200 bytes" if mask else "damaged or truncated"):
            Chunks("a", file["a"]).read(SIZE, 2 * SIZE)


def test_a_short_chunk_of_a_recording(tmp_path, ev):
    """As in a file that the sanitizer's fuzzing damaged: the size of a chunk in the file's own list of chunks."""
    path = tmp_path / "a.h5"
    for short in (b"", bytes(8)):
        with h5py.File(path, "w") as file:
            for name, column in ev.columns._asdict().items():
                made = file.create_dataset(name, column.shape, column.dtype, chunks=(50,))
                if name == "x" and short:
                    made.id.write_direct_chunk((50,), short)
                    made[:50], made[100:] = column[:50], column[100:]
                else:
                    made[:] = column
        if not short:
            assert nvsdata.read(path, sensor_size=ev.sensor_size) == ev
    for window in ((), (int(ev.t[50]), int(ev.t[-1]))):
        with pytest.raises(FormatError, match="a chunk of /x at 50 expands to 8 of its 100 bytes"):
            nvsdata.read(path, *window, sensor_size=ev.sensor_size)


@pytest.mark.parametrize("name", ["blosc lz4", "lz4", "lz4, small blocks", "bitshuffle lz4", "zstd"])
def test_damaged_lengths_within_a_chunk_and_cut_chunks(tmp_path, name):
    with h5py.File(stored(tmp_path / "a.h5", VALUES, ways(name))) as file:
        mask, raw = file["a"].id.read_direct_chunk((0,))
    # Blosc has the compressed size at 12, the others have the length of the first block there
    longer = raw[:12] + bytes([raw[12] ^ 64, raw[13] ^ 1]) + raw[14:]
    for damaged in (raw[:-1], raw[: len(raw) // 2], raw[:20], *([longer] if name != "zstd" else [])):
        with h5py.File(tmp_path / "a.h5", "w") as file:
            made = file.create_dataset("a", (SIZE,), VALUES.dtype, chunks=(SIZE,), **ways(name))
            made.id.write_direct_chunk((0,), damaged, mask)
        with h5py.File(tmp_path / "a.h5") as file, pytest.raises(FormatError, match="a chunk of /a at 0 is damaged"):
            Chunks("a.h5", file["a"]).read()


@pytest.mark.parametrize("how", [{}, {"shuffle": True}, {"fletcher32": True}])
def test_bitshuffle_that_does_not_compress(tmp_path, how):
    pytest.importorskip("hdf5plugin")
    with h5py.File(stored(tmp_path / "a.h5", VALUES, BITS | how)) as file:
        assert np.array_equal(Chunks("a.h5", file["a"]).read(90, 210), VALUES[90:210])


def test_partial_chunks_that_are_left_as_they_are(tmp_path):
    """As of H5D_CHUNK_DONT_FILTER_PARTIAL_CHUNKS, which h5py can't set."""
    for name in ("gzip", "lzf"):
        with h5py.File(stored(tmp_path / "a.h5", VALUES, ways(name)), "r+") as file:
            last = np.append(VALUES[300:], np.zeros(50, VALUES.dtype))
            file["a"].id.write_direct_chunk((300,), last.tobytes())
            assert np.array_equal(Chunks("a.h5", file["a"]).read(), VALUES)
            # chunks that are full are filtered
            file["a"].id.write_direct_chunk((200,), VALUES[200:300].tobytes())
            with pytest.raises(FormatError, match="a chunk of /a at 200 is damaged"):
                Chunks("a.h5", file["a"]).read()


def test_many_chunks_are_searched_once(tmp_path, monkeypatch):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        made = file.create_dataset("a", data=VALUES.reshape(70, 5), chunks=(1, 5))
        chunks = Chunks("a.h5", made)
        assert np.array_equal(chunks.read(), VALUES.reshape(70, 5))
        monkeypatch.setattr(Chunks, "_sizes", None)
        assert np.array_equal(chunks.read(3, 9), VALUES.reshape(70, 5)[3:9])


def test_a_filter_that_tells_no_size_is_refused(tmp_path):
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_chunk((SIZE,))
    plist.set_scaleoffset(h5py.h5z.SO_INT, 4)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        space, kind = h5py.h5s.create_simple((SIZE,)), h5py.h5t.py_create(np.dtype("<i2"))
        h5py.Dataset(h5py.h5d.create(file.id, b"a", kind, space, plist))[:] = VALUES[:SIZE]
    with (
        h5py.File(tmp_path / "a.h5") as file,
        pytest.raises(FormatError, match="by filter 6, which doesn't tell how far"),
    ):
        Chunks("a.h5", file["a"])


@given(
    st.lists(st.tuples(st.binary(max_size=300), st.integers(0, 40))).map(
        lambda parts: b"".join(a * n for a, n in parts)
    )
)
def test_lzf_is_what_h5py_wrote(tmp_path, raw):
    if not raw:
        return
    with h5py.File(tmp_path / "lzf.h5", "w") as file:
        data = np.frombuffer(raw, np.uint8)
        made = file.create_dataset("a", data=data, chunks=data.shape, compression="lzf")
        file.flush()
        mask, packed = made.id.read_direct_chunk((0,))
    if mask == 0:
        assert expand_lzf(packed, len(raw) + 9).tobytes() == raw
        assert expand_lzf(packed, len(raw) - 1).size == len(raw) - 1


@given(st.binary(max_size=60))
def test_any_bytes_are_lzf_or_an_error(raw):
    expected = slow_lzf(raw)
    if expected is None:
        with pytest.raises(ValueError, match="damaged LZF data"):
            expand_lzf(raw, 100_000)
    else:
        assert expand_lzf(raw, 100_000).tobytes() == expected


def slow_lzf(raw):
    """The expansion byte by byte; None if the data is damaged."""
    out, rest = bytearray(), list(raw)
    while rest:
        code = rest.pop(0)
        if code < 32:
            if len(rest) < code + 1:
                return None
            out += bytes(rest[: code + 1])
            del rest[: code + 1]
            continue
        length = code // 32 + 2
        if length == 9 and rest:
            length += rest.pop(0)
        if not rest:
            return None
        back = code % 32 * 256 + rest.pop(0) + 1
        if back > len(out):
            return None
        for _ in range(length):
            out.append(out[-back])
    return bytes(out)


def test_sizes_that_the_data_tells():
    raw = bytes(range(250)) * 8
    assert expanded_size(BZIP2, (), bz2.compress(raw), 10_000) == 2_000
    assert expanded_size(BZIP2, (), bz2.compress(raw), 1_500) == 1_500
    for kind in (BZIP2, *EXPANDED):
        with pytest.raises(ValueError):  # noqa: PT011  the libraries' own words
            expanded_size(kind, (), b"\xff\x00 no data", 100)
    assert LZF in EXPANDED
