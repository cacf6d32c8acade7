import itertools
import struct
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lookalikes import evt2_bytes, evt3_bytes, evt21_bytes, rows
from strategies import events

import nvsdata
from nvsdata import Events, FormatError
from nvsdata.data.views import FlippedY, Scaled, Slice
from nvsdata.formats import FORMATS

WRITERS = {"evt2": evt2_bytes, "evt2.1": evt21_bytes, "evt3": evt3_bytes}
STATED = {"evt2": b"% evt 2.0\n", "evt2.1": b"% evt 2.1\n", "evt3": b"% evt 3.0\n"}
every = pytest.mark.parametrize("kind", WRITERS)
WRAP = {"evt2": 2**34, "evt2.1": 2**34, "evt3": 2**24}


@every
@given(ev=events(max_size=300, width=1280, height=720), first=st.integers(0, 2**34))
def test_words_decode_as_the_description_says(tmp_path, kind, ev, first):
    # EVT3 doesn't say how often its 24 bits wrapped before the file begins
    ev = Events(ev.t - ev.start + first % 2**24, ev.x, ev.y, ev.p, (1280, 720))
    (tmp_path / "a.raw").write_bytes(WRITERS[kind](ev))
    assert nvsdata.read(tmp_path / "a.raw", sensor_size=(1280, 720)) == ev


@every
@given(
    ev=events(max_size=6_000, width=640, height=480, gap=90),
    start=st.integers(-10, 200_000),
    length=st.integers(0, 90_000),
)
def test_window_equals_slice_of_whole(tmp_path, kind, ev, start, length):
    (tmp_path / "a.raw").write_bytes(WRITERS[kind](ev))
    recording = nvsdata.open(tmp_path / "a.raw", sensor_size=ev.sensor_size)
    recording.block = 256
    assert recording.read(start, start + length) == ev.window(start, start + length)
    assert recording._whole is None
    assert recording.span == ((int(ev.t[0]), int(ev.t[-1])) if len(ev) else (0, 0))


def test_evt3_wraps_every_16_seconds(tmp_path):
    t = np.arange(0, 60_000_000, 7_000)
    ev = Events(t, t % 1280, t % 720, t % 2, (1280, 720))
    (tmp_path / "a.raw").write_bytes(evt3_bytes(ev))
    assert nvsdata.read(tmp_path / "a.raw", sensor_size=(1280, 720)) == ev
    assert nvsdata.read(tmp_path / "a.raw", 40_000_000, 41_000_000, sensor_size=(1280, 720)) == ev.window(
        40_000_000, 41_000_000
    )


def test_evt2_wraps_after_2_to_the_34(tmp_path):
    ev = Events(2**34 - 1_000 + np.arange(0, 3_000, 10), np.arange(300), np.arange(300), np.arange(300) % 2, (640, 480))
    (tmp_path / "a.raw").write_bytes(evt2_bytes(ev))
    assert nvsdata.read(tmp_path / "a.raw", sensor_size=(640, 480)) == ev


@every
@pytest.mark.parametrize(
    "header",
    [b"% geometry 640x480\n", b"% Width 640\n% Height 480\n", b"% Date 2020-01-01 10:00:00\n% width=640;height=480\n"],
)
def test_the_header_states_the_sensor(tmp_path, kind, header):
    ev = Events([5, 6], [1, 2], [3, 4], [1, 0], (640, 480))
    (tmp_path / "a.raw").write_bytes(WRITERS[kind](ev, STATED[kind] + header + b"% end\n"))
    assert nvsdata.read(tmp_path / "a.raw") == ev


@every
def test_the_whole_is_read_without_an_index(tmp_path, kind):
    t = np.arange(30_000) * 40
    ev = Events(t, t % 1279, t % 719, t % 2, (1280, 720))
    (tmp_path / "a.raw").write_bytes(WRITERS[kind](ev))
    recording = nvsdata.open(tmp_path / "a.raw", sensor_size=(1280, 720))
    assert recording.read() == ev
    assert recording._blocks is None
    assert recording.read(40_000, 80_000) == ev.window(40_000, 80_000)


def test_events_before_any_time_are_left_out(tmp_path):
    ev = Events([70, 80], [1, 2], [3, 4], [1, 0])
    raw = evt2_bytes(ev, b"")
    (tmp_path / "a.raw").write_bytes(b"% evt 2.0\n% end\n" + raw[4:8] + raw)
    assert nvsdata.read(tmp_path / "a.raw").t.tolist() == [70, 80]


@every
def test_a_torn_word_is_named(tmp_path, kind):
    (tmp_path / "a.raw").write_bytes(WRITERS[kind](Events([5], [1], [2], [1])) + b"\x01")
    with pytest.raises(FormatError, match="truncated: 1 bytes"):
        nvsdata.open(tmp_path / "a.raw")


def test_evt2_agrees_with_expelliarmus(shared_samples):
    expelliarmus = pytest.importorskip("expelliarmus")
    path = shared_samples / "evt2_sample.raw"
    theirs = expelliarmus.Wizard("evt2", fpath=str(path)).read()
    ours = nvsdata.read(path)
    for name in ("t", "x", "y", "p"):
        assert np.array_equal(getattr(ours, name), theirs[name])


def test_evt3_agrees_with_faery(shared_samples):
    faery = pytest.importorskip("faery")
    path = shared_samples / "evt3_sample.raw"
    theirs = np.concatenate(list(faery.events_stream_from_file(path)))
    ours = nvsdata.read(path)
    assert len(ours) == len(theirs) == 219_596
    # faery holds times back around a tick of the high part; rows and columns don't depend on it
    assert abs(ours.t - theirs["t"].astype(np.int64)).max() <= 11
    assert sorted(zip(ours.x.tolist(), ours.y.tolist(), ours.p.tolist(), strict=True)) == sorted(
        zip(theirs["x"].tolist(), theirs["y"].tolist(), theirs["p"].astype(int).tolist(), strict=True)
    )


def test_first_and_last_of_the_real_files(shared_samples):
    two = list(rows(nvsdata.read(shared_samples / "evt2_sample.raw")))
    three = list(rows(nvsdata.read(shared_samples / "evt3_sample.raw")))
    assert (len(two), two[0]) == (539_481, (1317888, 237, 121, 1))
    assert (three[0], three[-1]) == ((11718656, 874, 200, 0), (11727457, 1218, 572, 1))


def test_a_header_may_hold_names_in_any_script(tmp_path):
    ev = Events([5, 6], [1, 2], [3, 4], [1, 0], (640, 480))
    header = b"% evt 2.0\n% integrator M\xc3\xbcller\n% geometry 640x480\n% end\n"
    (tmp_path / "a.raw").write_bytes(evt2_bytes(ev, header))
    assert nvsdata.read(tmp_path / "a.raw") == ev


@every
@given(
    ev=events(max_size=200, width=2048, height=2048),
    first=st.integers(0, 2**30),
    gaps=st.lists(st.tuples(st.integers(0, 200), st.integers(0, 2**35)), max_size=2),
)
def test_what_is_written_is_read_back(tmp_path, kind, ev, first, gaps):
    t = ev.t - ev.start + first
    for place, gap in gaps:
        t[place:] += gap  # several wraps without an event
    ev = Events(t, ev.x, ev.y, ev.p, (2048, 2048))
    nvsdata.write(ev, tmp_path / "a.raw", format=kind)
    recording = nvsdata.open(tmp_path / "a.raw")
    assert (recording.format, recording.sensor_size) == (kind, (2048, 2048))
    assert recording.read() == ev
    assert (recording.start, recording.end) == (ev.start, ev.end)


@every
@given(ev=events(max_size=300, width=64, height=2, gap=2), cuts=st.lists(st.integers(0, 300), max_size=3))
def test_pieces_are_written_as_one(tmp_path, kind, ev, cuts):
    edges = [0, *sorted(cuts), 300]
    pieces = [ev.of(ev.columns.take(slice(a, b))) for a, b in itertools.pairwise(edges)]
    nvsdata.write(iter(pieces), tmp_path / "a.raw", format=kind)
    assert nvsdata.read(tmp_path / "a.raw") == nvsdata.Events(*ev.columns, ev.sensor_size)


def test_neighbors_take_less_room():
    def size(kind, x):
        ev = Events(np.full(len(x), 5), x, np.full(len(x), 3), np.ones(len(x), int), (2048, 4))
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "a.raw"
            nvsdata.write(ev, path, format=kind)
            return (len(path.read_bytes()) - nvsdata.open(path).header_size) // FORMATS[kind].open.record_size

    # a word each for the high and the low part of the time and for the row
    assert size("evt3", [7]) == size("evt3", [7, 18]) - 1 == 4
    assert size("evt3", [7, 10, 18]) == 3 + 2
    assert size("evt3", range(7, 7 + 32)) == 3 + 4
    assert size("evt3", range(7, 7 + 64)) == 3 + 8
    assert size("evt3", [7, 8, 9, 100, 200]) == 3 + 2 + 2
    assert size("evt2.1", range(32, 64)) == 1 + 1
    assert size("evt2.1", range(31, 65)) == 1 + 3
    assert size("evt2", range(32, 64)) == 1 + 32


@every
def test_what_files_cannot_hold_is_refused(tmp_path, kind):
    bits = 40 if kind == "evt3" else 51
    for times in ([-1, 5], [0, 2**bits], [2**bits, 2**bits]):
        with pytest.raises(ValueError, match=rf"supports those from 0 to 2\^{bits} only; T.RelativeTime"):
            nvsdata.write(Events(times, [0, 0], [0, 0], [0, 1], (4, 4)), tmp_path / "a.raw", format=kind)
    with pytest.raises(ValueError, match="supports coordinates up to 2047 only"):
        nvsdata.write(Events([0], [0], [0], [0], (4, 2049)), tmp_path / "a.raw", format=kind)
    assert not list(tmp_path.iterdir())


def test_the_name_of_a_format_chooses_among_those_of_an_extension(tmp_path):
    ev = Events([5], [1], [2], [1], (4, 4))
    nvsdata.write(ev, tmp_path / "a.raw")
    assert nvsdata.open(tmp_path / "a.raw").format == "evt3"
    with pytest.raises(ValueError, match=r"can't write a file with '.raw' as 'evt4'; known are .*evt2 \(.raw\)"):
        nvsdata.write(ev, tmp_path / "a.raw", format="evt4")
    with pytest.raises(ValueError, match=r"can't write a file with '.dat' as 'evt2'"):
        nvsdata.write(ev, tmp_path / "a.dat", format="evt2")


@pytest.mark.parametrize(
    "line", [b"", b"% endianness little\n", b"% format EVT21;height=720;width=1280;endianness=little\n"]
)
@given(ev=events(max_size=100, width=1280, height=720))
def test_halves_of_evt21_come_in_either_order(tmp_path, line, ev):
    (tmp_path / "a.raw").write_bytes(evt21_bytes(ev, b"% evt 2.1\n" + line + b"% end\n", little=True))
    assert nvsdata.read(tmp_path / "a.raw", sensor_size=(1280, 720)) == Events(*ev.columns, (1280, 720))


def test_the_stated_order_of_halves_counts(tmp_path):
    # a mask that looks like a word of time
    ev = Events([5, 6], [31, 63], [3, 4], [1, 0], (64, 64))
    (tmp_path / "a.raw").write_bytes(evt21_bytes(ev, b"% evt 2.1\n% endianness legacy\n% geometry 64x64\n% end\n"))
    assert nvsdata.read(tmp_path / "a.raw") == ev


def trigger(kind, t, channel, level):
    """Words of a trigger after its own time words."""
    if kind == "evt3":
        return struct.pack("<HHH", 0x8 << 12 | t >> 12 & 0xFFF, 0x6 << 12 | t & 0xFFF, 0xA << 12 | channel << 8 | level)
    words = [0x8 << 28 | t >> 6 & 0xFFFFFFF, 0xA << 28 | (t & 63) << 22 | channel << 8 | level]
    return struct.pack("<II", *words) if kind == "evt2" else struct.pack("<IIII", words[0], 0, words[1], 0)


@every
@given(
    triggers=st.lists(st.tuples(st.integers(0, 2**22), st.integers(0, 15), st.integers(0, 1)), max_size=8),
    late=st.booleans(),
)
def test_external_triggers(tmp_path, kind, triggers, late):
    # across a wrap of the clock
    first = WRAP[kind] - 2**21 if late else 0
    triggers = [(first + t, *rest) for t, *rest in sorted(triggers)]
    body = b"".join(trigger(kind, *one) for one in triggers)
    (tmp_path / "a.raw").write_bytes(STATED[kind] + b"% geometry 8x8\n% end\n" + body)
    recording = nvsdata.open(tmp_path / "a.raw")
    assert list(zip(*(column.tolist() for column in recording.triggers()), strict=True)) == triggers
    start, stop = first + 2**20, first + 2**21
    inside = [one for one in triggers if start <= one[0] < stop]
    assert list(zip(*(column.tolist() for column in recording.triggers(start, stop)), strict=True)) == inside
    assert len(recording.read()) == 0


def test_triggers_have_their_types_and_other_formats_have_none(tmp_path):
    ev = Events([5], [1], [2], [1], (4, 4))
    nvsdata.write(ev, tmp_path / "a.raw")
    none = nvsdata.open(tmp_path / "a.raw").triggers()
    assert [(column.dtype, column.size) for column in none] == [(np.int64, 0), (np.uint8, 0), (np.uint8, 0)]
    nvsdata.write(ev, tmp_path / "a.dat")
    with pytest.raises(FormatError, match="external triggers aren't read from prophesee-dat files"):
        nvsdata.open(tmp_path / "a.dat").triggers()


@pytest.mark.parametrize("kind", ["evt2", "evt3"])
def test_faery_reads_what_is_written(tmp_path, kind):
    faery = pytest.importorskip("faery")
    rng = np.random.default_rng(3)
    t = np.concatenate([rng.integers(0, 3_000, 2_000), rng.integers(40_000_000, 90_000_000, 200)])
    t.sort()
    x, y, p = rng.integers(0, 60, t.size), rng.integers(0, 2, t.size), rng.integers(0, 2, t.size)
    order = np.lexsort((x, p, y, t))
    ev = Events(t[order], x[order], y[order], p[order], (1280, 720))
    nvsdata.write(ev, tmp_path / "a.raw", format=kind)
    theirs = np.concatenate(list(faery.events_stream_from_file(tmp_path / "a.raw")))
    for ours, name in zip(ev.columns, theirs.dtype.names, strict=True):
        assert np.array_equal(ours, theirs[name])


@pytest.mark.parametrize("kind", ["evt2", "evt2.1"])
def test_times_of_today_fit(tmp_path, kind):
    ev = Events([1_763_856_000_000_000, 1_763_856_000_000_007], [1, 2], [3, 0], [1, 0], (4, 4))
    nvsdata.write(ev, tmp_path / "a.raw", format=kind)
    assert nvsdata.read(tmp_path / "a.raw") == ev
    assert (tmp_path / "a.raw").stat().st_size < 4_000_000


@every
def test_threads_share_a_recording(tmp_path, kind):
    t = np.arange(60_000) * 13
    ev = Events(t, t % 1279, t % 719, t % 2, (1280, 720))
    nvsdata.write(ev, tmp_path / "a.raw", format=kind)
    for _ in range(5):
        recording = nvsdata.open(tmp_path / "a.raw")
        with ThreadPoolExecutor(8) as pool:
            windows = list(pool.map(lambda n: recording.read(n * 50_000, n * 50_000 + 9_000), range(15)))  # noqa: B023
        assert windows == [ev.window(n * 50_000, n * 50_000 + 9_000) for n in range(15)]


def test_damage_is_an_error_for_each_of_several_threads(tmp_path):
    ev = Events(np.arange(20_000) * 10, np.arange(20_000) % 60, np.arange(20_000) % 40, np.arange(20_000) % 2, (64, 64))
    raw = bytearray(evt2_bytes(ev))
    raw[40_000:40_004] = struct.pack("<I", 0x8 << 28 | 0xFF00000)
    (tmp_path / "a.raw").write_bytes(raw)
    recording = nvsdata.open(tmp_path / "a.raw", sensor_size=(64, 64))

    def damaged(_):
        try:
            return recording.read()
        except FormatError:
            return None

    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(damaged, range(24))) == [None] * 24


def test_vectors_that_leave_every_sensor(tmp_path):
    """A base at the end, and vectors that go on and on."""
    words = [0x8000, 0x6005, 0x0003, 0x3FFF, *[0x4FFF] * 3_000, 0x4001]
    path = tmp_path / "a.raw"
    path.write_bytes(b"% evt 3.0\n% end\n" + struct.pack(f"<{len(words)}H", *words))
    with pytest.raises(FormatError, match="coordinates outside the sensor of 32767x32767"):
        nvsdata.read(path)
    recording = nvsdata.open(path, strict=False)
    found = recording.read()
    # those within what a sensor can have, each once, and in their places
    assert found.x.tolist() == list(range(2047, 32_767))
    assert recording.repairs["events outside the sensor, dropped"] == 3_001 * 12 - 11 - len(found)


def test_windows_of_triggers_that_end_before_they_begin(tmp_path):
    nvsdata.write(Events([5], [1], [2], [1], (4, 4)), tmp_path / "a.raw")
    with pytest.raises(ValueError, match="ends before it begins"):
        nvsdata.open(tmp_path / "a.raw").triggers(10, 5)


def test_views_pass_triggers_on(tmp_path):
    body = b"".join(trigger("evt3", t, 1, 1) for t in (10, 50, 90))
    (tmp_path / "a.raw").write_bytes(b"% evt 3.0\n% geometry 8x8\n% end\n" + body)
    recording = nvsdata.open(tmp_path / "a.raw")
    part = Slice(recording, 20, 60)
    assert part.holds_triggers
    assert part.triggers().t.tolist() == [50]
    assert part.triggers(55, None).t.tolist() == []
    assert FlippedY(recording).triggers(None, 60).t.tolist() == [10, 50]
    assert not Scaled(recording, 10).holds_triggers
    with pytest.raises(FormatError, match="external triggers aren't read from scaled files"):
        Scaled(recording, 10).triggers()


@every
def test_padding_words_mean_nothing(tmp_path, kind):
    t = np.arange(300) * 40
    ev = Events(t, t % 1279, t % 719, t % 2, (1280, 720))
    nvsdata.write(ev, tmp_path / "a.raw", format=kind)
    recording = nvsdata.open(tmp_path / "a.raw")
    raw, begin, size = (tmp_path / "a.raw").read_bytes(), recording.header_size, recording.record_size
    words = [raw[i : i + size] for i in range(begin, len(raw), size)]
    padded = b"".join(word + b"\x99" * size * (n % 3 == 0) for n, word in enumerate(words))
    (tmp_path / "a.raw").write_bytes(raw[:begin] + b"\x99" * size * 5 + padded)
    assert nvsdata.read(tmp_path / "a.raw") == ev
    assert nvsdata.read(tmp_path / "a.raw", 2_000, 7_000) == ev.window(2_000, 7_000)
