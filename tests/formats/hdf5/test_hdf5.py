import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import events

import nvsdata
from nvsdata import Events, FormatError
from nvsdata.formats.hdf5 import writer as hdf5_writer


@given(events(max_size=60), st.integers(1 - 2**62, 2**62 - 200_000))
def test_times_up_to_2_to_the_62_go_round(tmp_path, ev, first):
    late = Events(ev.t + first, ev.x, ev.y, ev.p, ev.sensor_size)
    nvsdata.write(late, tmp_path / "a.h5")
    assert nvsdata.read(tmp_path / "a.h5") == late


@pytest.fixture
def path(tmp_path):
    n = 1_000
    nvsdata.write(
        Events(np.arange(n), np.arange(n) % 30, np.arange(n) % 20, np.arange(n) % 2, (30, 20)), tmp_path / "a.h5"
    )
    return tmp_path / "a.h5"


def test_a_compressed_copy_reads_the_same(path, tmp_path):
    with h5py.File(path) as old, h5py.File(tmp_path / "b.h5", "w") as new:
        new.attrs.update(old.attrs)
        for name in "txyp":
            new.create_dataset(f"events/{name}", data=old[f"events/{name}"][:], chunks=(64,), compression="gzip")
    assert nvsdata.read(tmp_path / "b.h5") == nvsdata.read(path)
    assert nvsdata.read(tmp_path / "b.h5", 100, 300) == nvsdata.read(path, 100, 300)


HUGE = {"shape": (10**12,), "dtype": "u4"}


@pytest.mark.parametrize(
    ("storage", "pieces"),
    [
        (HUGE, "0 of 1 pieces"),
        (HUGE | {"chunks": (1_000,)}, "0 of 1000000000 pieces"),
        (HUGE | {"chunks": (1_000,), "maxshape": (None,)}, "0 of 1000000000 pieces"),
        (HUGE | {"chunks": (1_000,), "compression": "gzip"}, "0 of 1000000000 pieces"),
        ({"shape": (1_000,), "dtype": "u4", "chunks": (300,)}, "1 of 4 pieces"),
    ],
)
@pytest.mark.parametrize("names", ["events/t events/x events/y events/p", "t x y p", "CD/events"])
def test_values_that_are_not_in_the_file_are_not_made_up(tmp_path, names, storage, pieces):
    names = names.split()
    if len(names) == 1:
        storage = storage | {"dtype": [("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")]}
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name in names:
            made = file.create_dataset(name, **storage)
            if pieces.startswith("1"):
                made[:300] = np.ones(300, made.dtype)
    with pytest.raises(FormatError, match=f"{pieces} of /{names[0]} are there"):
        nvsdata.open(tmp_path / "a.h5")


@pytest.mark.parametrize("count", [50, 5])
@pytest.mark.parametrize(("size", "kinds"), [((256, 257), ("u1", "i2")), ((257, 256), ("i2", "u1"))])
def test_coordinates_take_a_byte_where_it_is_enough(tmp_path, monkeypatch, size, kinds, count):
    monkeypatch.setattr(hdf5_writer, "CHUNK", 3)
    where = np.arange(count) + 256 - count
    ev = Events(np.arange(count), where, where, np.arange(count) % 2, size)
    nvsdata.write(ev, tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5") as file:
        assert tuple(file[f"events/{name}"].dtype.str[1:] for name in "xy") == kinds
    assert nvsdata.read(tmp_path / "a.h5") == ev
    assert nvsdata.read(tmp_path / "a.h5", 2, 4) == ev.window(2, 4)


def test_a_truncated_file_is_refused(path):
    path.write_bytes(path.read_bytes()[:-500])
    with pytest.raises(FormatError, match=r"truncated|damaged"):
        nvsdata.read(path)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda f: f.attrs.update(version=99), "newer"),
        (lambda f: f.attrs.update(width=0), "sensor_size"),
        (lambda f: f.pop("events/p"), "without /events"),
        (lambda f: (f.pop("events/p"), f.create_dataset("events/p", data=np.zeros(3, np.uint8))), "different lengths"),
        (lambda f: f["events/x"].write_direct(np.full(1000, 31, np.uint8)), "outside the sensor"),
        (lambda f: f.attrs.update(format=[1, 2], width=h5py.h5r.Reference()), "attribute width is|no NumPy|damaged"),
        (lambda f: f.attrs.pop("version"), "attribute version is None"),
        (lambda f: f.attrs.update(version="newest"), "attribute version is"),
        (lambda f: f.attrs.update(height=h5py.Empty("i4")), "attribute height is None"),
        (lambda f: f.attrs.update(width=[30, 20]), "attribute width is"),
        (lambda f: (f.pop("events/t"), f.create_group("events/t")), "/events/t is not a dataset"),
        (lambda f: (f.pop("events/t"), f.create_dataset("events/t", data=np.zeros((9, 2)))), "not a column of int"),
        (lambda f: (f.pop("events/t"), f.create_dataset("events/t", data=1)), "not a column of integers"),
        (lambda f: (f.pop("events"), f.create_dataset("events", data=np.zeros(9))), "without /events"),
        (lambda f: f.create_group("CD/events"), "CD/events is not a dataset"),
        (lambda f: f.create_dataset("CD/events", data=np.zeros(3, [(n, "f4") for n in "txyp"])), "not rows of"),
    ],
)
def test_damage_is_named(path, change, reason):
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(FormatError, match=reason):
        nvsdata.read(path)


@pytest.mark.parametrize("compression", [None, "gzip"])
@pytest.mark.parametrize("home", ["events/", ""])
def test_columns_as_dsec_has_them(tmp_path, home, compression):
    ev = Events(
        10**12 + np.arange(0, 5_000, 7), np.arange(715) % 640, np.arange(715) % 480, np.arange(715) % 2, (640, 480)
    )
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t_offset"] = 10**12
        for name, kind in (("t", np.uint32), ("x", np.uint16), ("y", np.uint16), ("p", np.uint8)):
            column = ev.t - 10**12 if name == "t" else getattr(ev, name)
            file.create_dataset(home + name, data=column.astype(kind), compression=compression)
    recording = nvsdata.open(tmp_path / "a.h5", sensor_size=(640, 480))
    assert recording.read() == ev
    assert recording.span == (int(ev.t[0]), int(ev.t[-1]))
    assert recording.read(10**12 + 700, 10**12 + 1_400) == ev.window(10**12 + 700, 10**12 + 1_400)
    assert len(recording.read(0, 10**12)) == 0


@pytest.mark.parametrize("offset", [np.arange(3), float("nan"), 2**63, 2**62, b"soon", -(2**63)])
def test_an_offset_that_is_no_time_is_refused(path, offset):
    with h5py.File(path, "r+") as file:
        file["t_offset"] = offset
    with pytest.raises(FormatError, match=r"/t_offset is .*, not a time in µs"):
        nvsdata.open(path)


def test_times_that_an_offset_takes_too_far_are_refused(path):
    with h5py.File(path, "r+") as file:
        file["t_offset"] = 2**62 - 1
        del file["events/t"]
        file["events/t"] = np.arange(1_000) + 2**62
    with pytest.raises(FormatError, match=r"at or beyond 2\^62 µs"):
        nvsdata.read(path)


@pytest.mark.parametrize("storage", [{}, {"chunks": (100,)}, {"chunks": (100,), "compression": "gzip"}])
@pytest.mark.parametrize("kind", ["<u8", ">u8"])
def test_times_that_are_no_int64_are_refused(path, storage, kind):
    def put(times):
        with h5py.File(path, "r+") as file:
            del file["events/t"]
            file.create_dataset("events/t", data=times, **storage)

    times = np.arange(1_000, dtype=kind)
    put(times)
    assert nvsdata.read(path).t.tolist() == times.tolist()
    times[-1] = 2**64 - 1
    put(times)
    with pytest.raises(FormatError, match=r"t has the time 18446744073709551615, at or beyond 2\^62"):
        nvsdata.read(path)
    assert nvsdata.read(path, 100, 200).t.tolist() == times[100:200].tolist()


def test_the_compound_that_metavision_has(tmp_path):
    ev = Events(np.arange(0, 5_000, 7), np.arange(715) % 640, np.arange(715) % 480, np.arange(715) % 2, (640, 480))
    table = np.empty(715, [("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
    for name in ("t", "x", "y"):
        table[name] = getattr(ev, name)
    table["p"] = ev.p.astype(int) * 2 - 1
    with h5py.File(tmp_path / "a.hdf5", "w") as file:
        file.create_dataset("CD/events", data=table, compression="gzip")
    recording = nvsdata.open(tmp_path / "a.hdf5", sensor_size=(640, 480))
    assert recording.read() == ev
    assert recording.read(700, 1_400) == ev.window(700, 1_400)


@pytest.mark.parametrize(
    ("first", "last", "kind", "offset"),
    [
        (5, 2**32 - 1, np.uint32, None),
        (5, 2**32, np.uint32, 5),
        (10**15, 10**15 + 2**32 - 1, np.uint32, 10**15),
        (-3, 4, np.uint32, -3),
        (5, 2**32 + 5, np.int64, None),
        (1 - 2**62, 2**62 - 1, np.int64, None),
    ],
)
@pytest.mark.parametrize("contiguous", [9, 2])
def test_times_take_four_bytes_where_they_fit(tmp_path, monkeypatch, first, last, kind, offset, contiguous):
    monkeypatch.setattr(hdf5_writer, "CHUNK", 7)
    monkeypatch.setattr(hdf5_writer, "CONTIGUOUS", contiguous)
    t = np.array([first] * 20 + [first + 1] * 15 + [last] * 3)
    ev = Events(t, np.arange(38), np.arange(38) % 20, np.arange(38) % 2, (40, 20))
    nvsdata.write(ev, tmp_path / "a.h5")
    assert nvsdata.read(tmp_path / "a.h5") == ev
    assert nvsdata.read(tmp_path / "a.h5", first + 1, last) == ev.window(first + 1, last)
    with h5py.File(tmp_path / "a.h5") as file:
        assert (file["events/t"].chunks is None) == (contiguous == 9)
        long = contiguous == 2 and (first, last) == (5, 2**32)  # seen too late that the first should be taken off
        assert file["events/t"].dtype == (np.int64 if long else kind)
        assert ("t_offset" in file) == (offset is not None and not long)
        assert sorted(file["events"]) == ["p", "t", "x", "y"]


@given(events(max_size=90), st.integers(1, 40), st.data())
def test_a_long_file_in_chunks_reads_as_a_short_one(tmp_path, ev, step, data):
    pieces = [ev[i : i + step] for i in range(0, max(len(ev), 1), step)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hdf5_writer, "CHUNK", 7)
        patch.setattr(hdf5_writer, "CONTIGUOUS", 2)
        nvsdata.write(iter(pieces), tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5") as file:
        assert (file["events/t"].chunks is None) == (len(ev) <= 14)
    assert nvsdata.read(tmp_path / "a.h5") == ev
    start, stop = sorted(data.draw(st.tuples(*[st.integers(-5, int(ev.t.max(initial=0)) + 5)] * 2)))
    assert nvsdata.read(tmp_path / "a.h5", start, stop) == ev.window(start, stop)
    assert nvsdata.open(tmp_path / "a.h5").span == ((int(ev.t[0]), int(ev.t[-1])) if len(ev) else (0, 0))
