"""Columns that others wrote, how they are searched, and pieces on their way into a file."""

from types import SimpleNamespace

import h5py
import numpy as np
import pytest

import nvsdata
from nvsdata import Events, FormatError
from nvsdata.formats import index_cache
from nvsdata.formats.contents import most_bytes
from nvsdata.formats.file_recording import as_integers, as_polarity
from nvsdata.formats.hdf5 import columns as hdf5_columns
from nvsdata.formats.writing import Pieces, stated_time, time_comment

LAST = 2**62 - 1


@pytest.mark.parametrize("kind", [bool, np.uint8, np.int8, np.int64, np.uint64, np.float32, np.float64])
def test_whole_numbers_of_any_type(kind):
    found = as_integers("a", "t", np.array([0, 1, 1], kind))
    assert found.tolist() == [0, 1, 1]
    assert found.dtype == {"b": np.uint8, "f": np.int64}.get(np.dtype(kind).kind, kind)
    assert as_integers("a", "t", np.empty(0, kind)).size == 0


@pytest.mark.parametrize("value", [LAST, -LAST, LAST + 1, -LAST - 1, 2**63 - 1, -(2**63)])
def test_integers_up_to_2_to_the_62(value):
    column = np.array([3, value, 4])
    if abs(value) <= LAST:
        assert as_integers("a", "t", column).tolist() == [3, value, 4]
    else:
        with pytest.raises(FormatError, match=r"^a: variable has numbers beyond 2\^62$"):
            as_integers("a", "variable", column)


@pytest.mark.parametrize("value", [0.5, -1e-9 - 1, np.nan, np.inf, -np.inf, 2.0**62, -(2.0**62)])
def test_numbers_that_are_not_whole_or_too_far(value):
    with pytest.raises(FormatError, match=r"^a: t has numbers that aren't whole, or beyond 2\^62$"):
        as_integers("a", "t", np.array([1.0, value]))
    below = np.nextafter(2.0**62, 0)
    assert as_integers("a", "t", np.array([-below, below])).tolist() == [-int(below), int(below)]


def test_polarities_of_either_sign():
    assert as_polarity(np.array([-1, 0, 1, 2, -2], np.int8)).tolist() == [0, 0, 1, 2, -2]
    assert as_polarity(np.array([0, 1, 255], np.uint8)).tolist() == [0, 1, 255]


def test_how_far_files_may_inflate():
    assert [most_bytes(size) for size in (0, 1, 671_088)] == [2**26] * 3
    assert [most_bytes(size) for size in (671_089, 10**9)] == [67_108_900, 10**11]


class Listed:
    """A column of given values that counts what is read of it."""

    def __init__(self, values):
        self.values, self.size, self.asked = np.asarray(values), len(values), []

    def value(self, source, i):
        assert 0 <= i < self.size
        self.asked.append(i)
        return int(self.values[i])

    def read(self, source, lo, hi, kind=None):
        assert 0 <= lo <= hi <= self.size
        self.asked.append(hi - lo)
        return self.values[lo:hi]


@pytest.mark.parametrize("size", [0, 1, 512, 513, 514, 1_024, 1_026, 30_000])
def test_bisection_ends_around_the_first_value_that_is_not_smaller(size):
    values = np.sort(np.random.default_rng(size).integers(0, size // 3 + 2, size))
    for value in (-1, 0, 1, size // 6, size // 3, size // 3 + 5):
        column = Listed(values)
        lo, hi = hdf5_columns.bisected(column, None, value)
        assert 0 <= lo <= np.searchsorted(values, value) <= hi <= size
        assert hi - lo <= 512
        assert len(column.asked) <= max(size // 512, 1).bit_length()
        assert len(column.asked) > 0 or size <= 512


@pytest.mark.parametrize("size", [0, 1, 9, 10, 11, 20, 35])
def test_a_fall_anywhere_is_seen(monkeypatch, size):
    monkeypatch.setattr(hdf5_columns, "SCANNED", 10)
    values = np.arange(size) // 2
    column = Listed(values)
    assert hdf5_columns.rises(column, None)
    assert all(count <= 11 for count in column.asked)
    assert len(column.asked) == -(-size // 10)
    for at in range(1, size):
        fallen = values.copy()
        fallen[at:] -= 1 + at % 2
        assert hdf5_columns.rises(Listed(fallen), None) == bool((fallen[1:] >= fallen[:-1]).all())
    assert not hdf5_columns.rises(Listed(np.array([5, 2**64 - 1], np.uint64)), None)


@pytest.mark.parametrize("suffix", [".h5", ".npy"])
def test_an_event_outside_is_counted_from_the_beginning_of_the_file(tmp_path, suffix):
    count = 20_000
    x = np.zeros(count, int)
    x[[15_000, 15_003]] = 7
    nvsdata.write(Events(np.arange(count), x, x, x * 0, (8, 8)), tmp_path / f"a{suffix}")
    recording = nvsdata.open(tmp_path / f"a{suffix}", sensor_size=(7, 8))
    assert len(recording.read(0, 500)) == 500
    for window in ((None, None), (14_990, 15_100), (15_000, 15_001)):
        with pytest.raises(FormatError, match="event 15000: outside the sensor of 7x8, or a polarity other"):
            recording.read(*window)
    if suffix == ".h5":  # which decodes no neighbors
        with pytest.raises(FormatError, match="event 15003: outside the sensor"):
            recording.read(15_003, 15_004)


@pytest.mark.parametrize(("place", "times"), [(1, 5), (500, 499), (999, 997)])
def test_a_time_that_falls_is_numbered(tmp_path, place, times):
    nvsdata.write(Events(np.arange(1_000) * 2, [0] * 1_000, [0] * 1_000, [0] * 1_000, (5, 5)), tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        t = file["events/t"][:]
        t[place - 1] = 2 * place + times
        del file["events/t"]
        file["events/t"] = t
    with pytest.raises(FormatError, match=f"event {place} is earlier than the one before it"):
        nvsdata.read(tmp_path / "a.h5")


def test_pieces_tell_what_has_passed():
    size = (5, 5)
    one, two = (
        Events([3, 4], [1, 1], [1, 1], [1, 1], size, start=1),
        Events([4, 9], [1, 1], [1, 1], [1, 1], size, end=11),
    )
    pieces = Pieces([Events.empty(size, 2, 2), one, Events.empty(size, 5, 6), two, Events.empty(size, 12, 20)])
    assert (pieces.sensor_size, pieces.start, pieces.end, pieces.count, pieces.last) == (size, 2, 2, 0, None)
    passed = [(len(piece), pieces.start, pieces.end, pieces.count) for piece in pieces]
    assert passed == [(2, 2, 4, 2), (2, 2, 11, 4)]
    assert (pieces.start, pieces.end, pieces.count, pieces.last) == (2, 20, 4, two)


def test_comments_that_state_times():
    for start, end in ((0, 0), (-5, 7), (1 - 2**62, LAST)):
        line = time_comment(SimpleNamespace(start=start, end=end))
        assert len(line) == len("# nvsdata time " + " to " + " us") + 40
        assert stated_time(["# what", line + " \r\n", "# nvsdata time 8 to 9 us"]) == (start, end)
        assert stated_time([time_comment(SimpleNamespace(start=start, end=end), "%")]) == (start, end)
    assert stated_time(["# nvsdata time 8 to 9 us or so", " # nvsdata time 8 to 9 us"]) is None


@pytest.mark.parametrize(("ago", "kept"), [(2 * 10**9, True), (2 * 10**9 - 1, False), (-5, False)])
def test_an_index_is_kept_once_two_seconds_have_passed(tmp_path, monkeypatch, ago, kept):
    now = 10**18
    monkeypatch.setattr(index_cache.time, "time_ns", lambda: now)
    monkeypatch.chdir(tmp_path)
    for path in ("a.raw", str(tmp_path / "b.raw")):
        index_cache.save_index(path, {"size": 1}, now - ago, {"times": np.arange(3)})
        found = index_cache.load_index(path, {"size": 1})
        assert (found is not None and found["times"].tolist()) == (kept and [0, 1, 2])
        assert index_cache.load_index(path, {"size": 2}) is None
    assert {path.name for path in tmp_path.iterdir()} == (
        {".a.raw.nvsdata-index", ".b.raw.nvsdata-index"} if kept else set()
    )


@pytest.mark.parametrize(
    ("line", "kind"),
    [
        ("evt 3.0", "evt3"),
        ("evt 3", "evt3"),
        ("EVT 2.0", "evt2"),
        ("evt 2", "evt2"),
        ("evt 2.1", "evt2.1"),
        ("format EVT21;height=720;width=1280", "evt2.1"),
        ("format EVT3;height=720;width=1280", "evt3"),
        ("format evt2;height=720;width=1280", "evt2"),
        ("evt 3.1", None),
        ("evt 31", None),
        ("evt 2.2", None),
        ("evt 4.0", None),
        ("evt3", None),
    ],
)
@pytest.mark.parametrize("before", ["", "% date 2020-01-01 10:00:00\n% serial 0\n"])
def test_the_header_names_the_encoding(tmp_path, line, kind, before):
    (tmp_path / "a").write_bytes(f"{before}% {line}\n% geometry 8x8\n% end\n".encode())
    if kind is not None:
        assert nvsdata.open(tmp_path / "a").format == kind
        return
    with pytest.raises(FormatError):
        # Prophesee's other files begin so, too
        nvsdata.open(tmp_path / "a")
