"""What holds for every format that is read and written."""

import itertools
import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lookalikes import evt2_bytes, evt3_bytes, matlab_bytes
from strategies import events

import nvsdata
from nvsdata import Events, FormatError

SUFFIXES = (".bin", ".dat", ".txt", ".h5", ".aedat", ".aedat1", ".aedat3", ".npy")
HEADS = {
    ".bin": b"",
    ".dat": b"% Version 2\n\x0c\x08",
    ".txt": b"1 2 3 1\n",
    ".h5": b"\x89HDF\r\n\x1a\n",
    ".aedat": b"#!AER-DAT2.0\r\n",
    ".aedat1": b"#!AER-DAT1.0\r\n",
    ".aedat3": b"#!AER-DAT3.1\r\n#Source 1: DVS128\r\n#!END-HEADER\r\n",
    ".raw": b"% evt 2.0\n% end\n",
    ".evt3": b"% evt 3.0\n% end\n",
    ".npy": b"\x93NUMPY\x01\x00",
    ".mat": b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM",
}
changes = st.lists(st.tuples(st.floats(0, 1), st.integers(0, 255)), min_size=1, max_size=5)
every_format = pytest.mark.parametrize("suffix", SUFFIXES)


@every_format
@given(ev=events())
def test_write_then_read_is_identity(tmp_path, suffix, ev):
    path = tmp_path / f"a{suffix}"
    nvsdata.write(ev, path)
    assert nvsdata.read(path, sensor_size=ev.sensor_size) == ev


@every_format
@given(ev=events(), step=st.integers(1, 50))
def test_pieces_make_the_file_that_the_whole_makes(tmp_path, suffix, ev, step):
    whole, parts = tmp_path / f"whole{suffix}", tmp_path / f"parts{suffix}"
    nvsdata.write(ev, whole)
    nvsdata.write((ev[i : i + step] for i in range(0, max(len(ev), 1), step)), parts)
    assert nvsdata.read(parts, sensor_size=ev.sensor_size) == ev
    if suffix not in (".h5", ".aedat3"):  # one has times of its making, the other a packet a piece
        assert parts.read_bytes() == whole.read_bytes()


def test_pieces_that_do_not_follow_each_other(tmp_path):
    early, late = Events([1], [1], [1], [1], (4, 4)), Events([9], [1], [1], [1], (4, 4))
    for pieces, says in (
        ([late, early], "begins at 1 µs, but the one before it ends at 9"),
        ([early, Events([9], [1], [1], [1], (5, 5))], "different sensors"),
        ([], "no piece"),
    ):
        with pytest.raises(ValueError, match=says):
            nvsdata.write(iter(pieces), tmp_path / "a.h5")
    assert list(tmp_path.iterdir()) == []


@every_format
@given(ev=events(max_size=3_000, gap=50), start=st.integers(-100, 60_000), length=st.integers(0, 30_000))
def test_window_equals_slice_of_whole(tmp_path, suffix, ev, start, length):
    path = tmp_path / f"a{suffix}"
    nvsdata.write(ev, path)
    recording = nvsdata.open(path, sensor_size=ev.sensor_size)
    assert recording.read(start, start + length) == ev.window(start, start + length)
    assert recording.read(start) == ev.window(start)
    assert recording.read(None, start) == ev.window(None, start)


@every_format
@given(ev=events(max_size=3_000, gap=50), cuts=st.lists(st.integers(0, 100_000), max_size=5))
def test_any_split_of_a_recording_joins_back(tmp_path, suffix, ev, cuts):
    path = tmp_path / f"a{suffix}"
    nvsdata.write(ev, path)
    recording = nvsdata.open(path)
    edges = [None, *sorted(cuts), None]
    parts = [recording.read(a, b) for a, b in itertools.pairwise(edges)]
    for name in ("t", "x", "y", "p"):
        assert np.array_equal(np.concatenate([getattr(part, name) for part in parts]), getattr(ev, name))


@every_format
@given(ev=events(max_size=3_000, gap=50))
def test_span_is_that_of_the_events(tmp_path, suffix, ev):
    path = tmp_path / f"a{suffix}"
    nvsdata.write(ev, path)
    assert nvsdata.open(path).span == ((int(ev.t[0]), int(ev.t[-1])) if len(ev) else (0, 0))


@every_format
def test_a_window_outside_the_recording_is_empty(tmp_path, suffix):
    ev = Events([100, 200], [1, 2], [3, 4], [0, 1], (34, 34))
    nvsdata.write(ev, tmp_path / f"a{suffix}")
    recording = nvsdata.open(tmp_path / f"a{suffix}")
    assert len(recording.read(300, 400)) == 0
    assert len(recording.read(0, 100)) == 0
    assert len(recording.read(-50, -10)) == 0
    with pytest.raises(ValueError, match="ends before"):
        recording.read(5, 4)


@every_format
def test_coordinates_outside_the_given_sensor_name_file_and_place(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    nvsdata.write(Events([1, 2], [5, 6], [5, 5], [0, 1]), path)
    with pytest.raises(FormatError, match="outside the sensor of 6x6") as caught:
        nvsdata.read(path, sensor_size=(6, 6))
    assert str(path) in str(caught.value)


@every_format
def test_the_content_tells_the_format_whatever_the_extension(tmp_path, suffix):
    rng = np.random.default_rng(0)
    ev = Events(np.arange(100) * 30, rng.integers(0, 34, 100), rng.integers(0, 34, 100), np.zeros(100, int), (34, 34))
    nvsdata.write(ev, tmp_path / f"a{suffix}")
    os.rename(tmp_path / f"a{suffix}", tmp_path / "b.unknown")
    assert nvsdata.read(tmp_path / "b.unknown", sensor_size=(34, 34)) == ev


@every_format
def test_a_failed_write_leaves_the_old_file_alone(tmp_path, suffix, monkeypatch):
    path = tmp_path / f"a{suffix}"
    nvsdata.write(Events([1], [1], [1], [1]), path)
    before = path.read_bytes()

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        nvsdata.write(Events([1, 2], [1, 2], [1, 2], [1, 0]), path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_a_directory_is_no_recording(tmp_path):
    with pytest.raises(FormatError, match="is a folder"):
        nvsdata.open(tmp_path)


def test_a_missing_file_is_not_found(tmp_path):
    with pytest.raises(FileNotFoundError):
        nvsdata.open(tmp_path / "no.bin")


@pytest.mark.parametrize("name", ["a.xyz", "a.h5", "a.dat"])
@pytest.mark.parametrize("content", [b"", b"\x00\xff" * 300])
def test_unknown_content_is_refused(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FormatError, match="byte 0"):
        nvsdata.open(tmp_path / name)


def test_an_unknown_extension_is_not_written(tmp_path):
    with pytest.raises(ValueError, match="can't write files"):
        nvsdata.write(Events([1], [1], [1], [1]), tmp_path / "a.xyz")
    assert not list(tmp_path.iterdir())


@given(data=st.binary(max_size=400), suffix=st.sampled_from(tuple(HEADS)))
def test_garbage_gives_format_errors_or_valid_events(tmp_path, data, suffix):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(HEADS[suffix] + data)
    for strict in (True, False):
        assert_valid_or_refused(path, strict)


@pytest.mark.filterwarnings("ignore:.*not marked valid")
@given(ev=events(max_size=100), suffix=st.sampled_from((*SUFFIXES, ".mat", ".raw", ".evt3")), changes=changes)
def test_damaged_files_give_format_errors_or_valid_events(tmp_path, ev, suffix, changes):
    raw = bytearray(sample_bytes(tmp_path, ev, suffix))
    for where, value in changes if raw else ():
        raw[int(where * (len(raw) - 1))] = value
    path = tmp_path / f"b{suffix}"
    path.write_bytes(raw[: int(changes[0][0] * len(raw))] if changes[0][1] % 4 == 0 else raw)
    for strict in (True, False):
        assert_valid_or_refused(path, strict)


def sample_bytes(tmp_path, ev, suffix):
    if suffix in SUFFIXES:
        nvsdata.write(ev, tmp_path / f"a{suffix}")
        return (tmp_path / f"a{suffix}").read_bytes()
    return {".mat": matlab_bytes, ".raw": evt2_bytes, ".evt3": evt3_bytes}[suffix](ev)


def assert_valid_or_refused(path, strict):
    try:
        ev = nvsdata.read(path, strict=strict)
    except FormatError:
        return
    assert (np.diff(ev.t) >= 0).all()
    assert ((ev.x >= 0) & (ev.x < ev.sensor_size[0]) & (ev.y >= 0) & (ev.y < ev.sensor_size[1])).all()
    assert np.isin(ev.p, (0, 1)).all()


@pytest.mark.parametrize("suffix", [".csv", ".text", ".hdf5", ".bs2"])
def test_every_extension_of_a_format_that_is_written_can_be_written(tmp_path, suffix):
    ev = Events([100, 200], [1, 2], [3, 4], [0, 1], (34, 34))
    nvsdata.write(ev, tmp_path / f"a{suffix}")
    assert nvsdata.read(tmp_path / f"a{suffix}", sensor_size=(34, 34)) == ev
