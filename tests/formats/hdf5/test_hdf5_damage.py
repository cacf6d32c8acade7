"""HDF5 files whose times are damaged, and those that change while they are open."""

import os
import subprocess
import sys

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lookalikes import hdf5_bytes

import nvsdata
from nvsdata import Events, FormatError
from nvsdata.formats.hdf5 import columns as hdf5_columns


def put(path, storage, **columns):
    with h5py.File(path, "r+") as file:
        for stated in ("start", "end"):
            file.attrs.pop(stated, None)
        for name, values in columns.items():
            del file[f"events/{name}"]
            file.create_dataset(f"events/{name}", data=values, **storage)


STORAGES = [{}, {"chunks": (100,)}, {"chunks": (100,), "compression": "gzip"}]


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("at", [0, 1, 499, 500, 501, 998, 999])
@pytest.mark.parametrize("value", [0, 700, 2**32 - 1])
def test_a_damaged_time_never_gives_wrong_windows(path, storage, at, value):
    t = np.arange(1_000, dtype=np.uint32) + 10
    t[at] = value
    put(path, storage, t=t)
    windows = [(a, a + 100) for a in range(0, 1_100, 50)]
    repaired = nvsdata.open(path, strict=False)
    found = [repaired.read(*window) for window in windows]
    whole = nvsdata.read(path, strict=False)
    assert found == [whole.window(*window) for window in windows]
    strict = nvsdata.open(path)
    found = [outcome(strict, *window) for window in windows]
    if repaired.repairs:
        assert repaired.repairs == {"steps back in time, sorted": 1}
        with pytest.raises(FormatError, match=r"event .* is earlier than the one before it"):
            nvsdata.read(path)
        # windows that the damage neither lies in nor leads astray are the others' events
        others = np.delete(whole.t, whole.t.searchsorted(value))
        expected = [others[(others >= a) & (others < b)].tolist() for a, b in windows]
        assert all(got is None or got.t.tolist() == right for got, right in zip(found, expected, strict=True))
    else:
        assert found == [nvsdata.read(path).window(*window) for window in windows]


def outcome(recording, a, b):
    try:
        return recording.read(a, b)
    except FormatError:
        return None


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("strict", [True, False])
@given(data=st.data())
def test_plain_columns_in_any_order_give_the_windows_of_the_whole(tmp_path, storage, strict, data):
    t = data.draw(st.lists(st.integers(-50, 50), min_size=1, max_size=300))
    columns = {"t": np.array(t), "x": np.arange(len(t)) % 7, "y": np.zeros(len(t), int), "p": np.ones(len(t), "u1")}
    how = {"maxshape": (None,) if storage else None} | storage  # for chunks that are larger than the whole
    (tmp_path / "a.h5").write_bytes(hdf5_bytes({name: {"data": c} | how for name, c in columns.items()}))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hdf5_columns, "SCANNED", 16)
        patch.setattr(hdf5_columns, "BISECTED", 4)
        a, b = sorted(data.draw(st.tuples(st.integers(-60, 60), st.integers(-60, 60))))
        recording = nvsdata.open(tmp_path / "a.h5", strict=strict)
        window = recording.read(a, b)
        assert window == nvsdata.read(tmp_path / "a.h5", strict=strict).window(a, b)
        assert nvsdata.open(tmp_path / "a.h5", strict=strict).span == (min(t), max(t))


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("value", [2**62, -(2**62), 2**63, 2**64 - 1])
def test_times_from_2_to_the_62_are_refused(path, storage, value):
    t = np.full(1_000, value, np.uint64 if value > 0 else np.int64)
    put(path, storage, t=t)
    t[slice(0, -1) if value > 0 else slice(1, None)] = 5
    for times in (t, np.full_like(t, value)):
        put(path, storage, t=times)
        for window, strict in (((), True), ((), False), ((0, 100), False)):
            with pytest.raises(FormatError, match=r"/events/t has the time .*, at or beyond 2\^62 µs"):
                nvsdata.read(path, *window, strict=strict)


@pytest.mark.parametrize("storage", STORAGES)
def test_events_own_their_memory_and_a_file_that_changes_is_refused(path, tmp_path, storage):
    ev = nvsdata.read(path)
    put(path, storage, t=ev.t.astype(np.uint32), x=ev.x, y=ev.y.astype(np.uint8), p=ev.p)
    whole, kept = nvsdata.open(path), nvsdata.open(path)
    events, window = whole.read(), kept.read(100, 200)
    assert all(np.may_share_memory(c, c) and c.flags.writeable for c in events.columns)
    os.truncate(path, path.stat().st_size - 300)
    for recording in (whole, kept):
        for read in (recording.read, lambda recording=recording: recording.read(300, 400)):
            with pytest.raises(FormatError, match="truncated: it had"):
                read()
    assert (events, window) == (ev, ev.window(100, 200))


def test_a_file_that_was_replaced_is_refused(path, ev):
    recording = nvsdata.open(path)
    nvsdata.write(Events(ev.t, ev.y, ev.y, ev.p, (30, 20)), path)
    with pytest.raises(FormatError, match="changed after it was opened"):
        recording.read()
    assert nvsdata.read(path) != ev


CUT = """
import os, sys, resource
import numpy as np
import nvsdata
resource.setrlimit(resource.RLIMIT_NOFILE, (256, 256))
path = sys.argv[1]
kept = []
for _ in range(1000):
    recording = nvsdata.open(path)
    kept.append((recording, recording.read(5, 50)))
whole = kept[0][0].read()
os.truncate(path, 2000)
for recording, window in kept[:3]:
    for read in (recording.read, lambda: recording.read(5, 50)):
        try:
            read()
        except nvsdata.FormatError as error:
            assert "truncated" in str(error)
        else:
            raise AssertionError("read what is no longer there")
assert len(whole) == 1000 and int(whole.x.sum()) == int((np.arange(1000) % 30).sum())
assert all(len(window) == 45 and int(window.t.sum()) == sum(range(5, 50)) for _, window in kept)
print("alive")
"""


def test_a_thousand_recordings_are_kept_and_their_file_cut(path):
    done = subprocess.run([sys.executable, "-c", CUT, str(path)], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout) == (0, "alive\n"), done.stderr
