"""The first times of a compressed file's chunks: a window reads its own chunks; false ones change no window."""

import h5py
import numpy as np
import pytest

import nvsdata
from nvsdata import Events
from nvsdata.formats.hdf5 import writer
from nvsdata.formats.hdf5.chunks import Chunks

N, CHUNK = 1_000, 50
WINDOWS = [(0, 1), (0, 10**6), (300, 420), (299, 301), (500, 500), (1_490, 1_500), (2_900, 10_000), (-5, 0)]


@pytest.fixture
def made(tmp_path, monkeypatch):
    """A file of 20 chunks, and its events: three of each time, so that chunks begin within a time, too."""
    monkeypatch.setattr(writer, "DEFLATED", CHUNK)
    t = np.arange(N) // 3 * 9
    events = Events(t, np.arange(N) % 30, np.arange(N) % 20, np.arange(N) % 2, (30, 20))
    nvsdata.write(events, tmp_path / "a.h5", format="hdf5-gzip")
    return tmp_path / "a.h5", events


def replace_starts(path, starts):
    with h5py.File(path, "r+") as file:
        del file["events/starts"]
        if starts is not None:
            file["events/starts"] = starts


def chunks_read(path, window, monkeypatch):
    read = []
    chunk_of = Chunks._chunk

    def recorded(chunks, place):
        if not (chunks._last and chunks._last[0] == place):
            read.append((chunks.dataset.name, place[0]))
        return chunk_of(chunks, place)

    with monkeypatch.context() as patch:
        patch.setattr(Chunks, "_chunk", recorded)
        nvsdata.open(path).read(*window)
    return read


def test_starts_are_the_first_times_of_chunks(made):
    path, events = made
    with h5py.File(path) as file:
        assert file["events/starts"][:].tolist() == events.t[::CHUNK].tolist()


def test_a_window_reads_only_its_chunks(made, monkeypatch):
    path, events = made
    window = int(events.t[410]), int(events.t[430])
    columns = [f"/events/{name}" for name in "txyp"]
    assert sorted(chunks_read(path, window, monkeypatch)) == sorted((name, 400) for name in columns)
    replace_starts(path, None)
    assert len(chunks_read(path, window, monkeypatch)) > 4


FALSE = {
    "missing": lambda starts: None,
    "one fewer": lambda starts: starts[:-1],
    "one more": lambda starts: np.append(starts, starts[-1]),
    "empty": lambda starts: starts[:0],
    "backward": lambda starts: starts[::-1],
    "shuffled": lambda starts: np.random.default_rng(0).permutation(starts),
    "all early": lambda starts: starts * 0 - 2**62,
    "all late": lambda starts: starts * 0 + 2**62,
    "a chunk earlier": lambda starts: np.append(starts[1:], starts[-1] + 9),
    "a chunk later": lambda starts: np.append(-9, starts[:-1]),
    "beyond int64": lambda starts: starts.astype(np.uint64) + np.uint64(2**63),
    "of 8 bits": lambda starts: starts.astype(np.uint8),
}


@pytest.mark.parametrize("what", FALSE)
def test_false_starts_change_no_window(made, what):
    path, events = made
    replace_starts(path, FALSE[what](events.t[::CHUNK]))
    for window in WINDOWS:
        assert nvsdata.open(path).read(*window) == events.window(*window)


@pytest.mark.parametrize("starts", [np.zeros((20, 1), np.int64), np.zeros(20), 5, "text"])
def test_what_is_no_column_of_integers_is_refused(made, starts):
    path, _ = made
    replace_starts(path, starts)
    with pytest.raises(nvsdata.FormatError, match="starts is not a column of integers"):
        nvsdata.open(path)


def test_starts_are_true_where_times_are_widened_or_have_an_offset(tmp_path, monkeypatch):
    monkeypatch.setattr(writer, "DEFLATED", CHUNK)
    for step in (1, 10**8):
        t = 10**13 + np.arange(N) * step
        events = Events(t, *np.zeros((3, N), int), (3, 2))
        nvsdata.write(events, tmp_path / "b.h5", format="hdf5-gzip")
        with h5py.File(tmp_path / "b.h5") as file:
            assert file["events/starts"][:].tolist() == t[::CHUNK].tolist()
        window = int(t[333]), int(t[444])
        assert nvsdata.open(tmp_path / "b.h5").read(*window) == events.window(*window)
