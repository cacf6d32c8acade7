"""Words of time that no camera wrote are told, or dropped, and no window says otherwise than the whole."""

import re

import numpy as np
import pytest
from damage import DVS128, KINDS, damage, disagreement, file_of
from hypothesis import given, settings
from hypothesis import strategies as st
from lookalikes import aedat2_bytes, evt2_bytes, evt3_bytes

import nvsdata
from nvsdata import Events, FormatError
from nvsdata.datasets.verification import problems
from nvsdata.formats import atis, contents, reading, records
from nvsdata.kernels.decode.clock import BACK_US, SILENT_US, is_jump, kept_words, nearest_time

WRITERS = {"evt2": evt2_bytes, "evt3": evt3_bytes}
every_kind = pytest.mark.parametrize("kind", KINDS)


@pytest.fixture
def small_pieces(monkeypatch):
    """Files are read from the disk in many pieces, however short they are."""
    monkeypatch.setattr(reading, "HEAD", 512)
    monkeypatch.setattr(contents, "HEAD", 512)
    monkeypatch.setattr(records, "PIECE", 1_024)


@every_kind
@pytest.mark.filterwarnings("ignore:.*not marked valid")
@settings(max_examples=25)
@given(seed=st.integers(0, 2**32))
def test_windows_and_span_of_damaged_files_are_those_of_the_whole(tmp_path, small_pieces, kind, seed):
    rng = np.random.default_rng(seed)
    header, raw = file_of(kind, int(rng.integers(2, 900)), rng)
    path = tmp_path / f"a{KINDS[kind][0]}"
    path.write_bytes(header + damage(kind, raw, rng))
    assert disagreement(path, rng, int(rng.choice((16, 64)))) == ""
    if kind != "aedat4":  # its words are those of packets, too
        nvsdata.read(path, strict=False)


def sound(kind):
    """A file of 3,000 events over 0.6 s that begin after 5 s, its header's size, and how it places a word of time."""
    t = 5_000_000 + 200 * np.arange(3_000)
    ev = Events(t, t % 128, t % 120, t % 2, (128, 128))
    if kind in ("evt2", "evt3"):
        header = b"% evt " + kind[3:].encode() + b".0\n% geometry 128x128\n% end\n"
        return ev, bytearray(WRITERS[kind](ev, header)), len(header)
    header, _ = file_of(kind, 0, np.random.default_rng(0))
    x, y, p = ev.x.astype(int), ev.y.astype(int), ev.p.astype(int)
    if kind == "dat":
        body = np.stack([t, x | y << 14 | p << 28], 1).astype("<u4").tobytes()
    else:
        body = aedat2_bytes((127 - y) << 8 | (127 - x) << 1 | (1 - p), t, b"")
        if kind == "aedat1":
            body = np.frombuffer(body, np.uint8).reshape(-1, 8)[:, 2:].tobytes()
    return ev, bytearray(header + body), len(header)


@pytest.mark.parametrize("word", [b"\xff\xff\xff\xff", b"\0\0\0\0", b"\x7f\xff\xff\xff", b"\x80\0\0\0", b"\x01\0\0\0"])
@pytest.mark.parametrize("kind", ["dat", "aedat1", "aedat2"])
@pytest.mark.parametrize("place", [0, 1, 1_500, 2_998, 2_999])
def test_one_damaged_word_of_time_is_told_and_moves_no_other_event(tmp_path, kind, place, word):
    ev, raw, begin = sound(kind)
    suffix, size, where = KINDS[kind]
    at = begin + place * size + where.start
    raw[at : at + 4] = word[::-1] if kind == "dat" else word
    path = tmp_path / f"a{suffix}"
    path.write_bytes(raw)
    forward = int.from_bytes(word, "big") - 5_000_000
    others = np.delete(np.arange(3_000), place)
    repaired = nvsdata.open(path, strict=False)
    if place == 2_999 and 0 < forward < 2**31:
        # a last event after a long silence
        assert repaired.read()[:2_999] == ev[:2_999]
    elif place == 0 and -(2**31) < forward < 0:
        # a first event before one
        assert repaired.read()[1:] == ev[1:]
    else:
        assert repaired.read() == ev[others]
        assert repaired.repairs == {"records of times that no camera writes, dropped": 1}
        assert repaired.span == (ev.t[others[0]], ev.t[others[-1]])
        with pytest.raises(FormatError, match=r"a time that no camera writes: 1 of 3000 records") as caught:
            nvsdata.read(path)
        assert caught.value.offset == begin + place * size


@pytest.mark.parametrize(("kind", "ones"), [("evt2", b"\xff\xff\xff\x8f"), ("evt3", b"\xff\x8f")])
def test_one_damaged_word_of_high_time_moves_no_other_event(tmp_path, kind, ones):
    ev, raw, begin = sound(kind)
    size = KINDS[kind][1]
    words = np.frombuffer(bytes(raw[begin:]), np.uint8).reshape(-1, size)
    place = int(np.flatnonzero(words[:, -1] >> 4 == 8)[70])
    raw[begin + size * place : begin + size * (place + 1)] = ones
    path = tmp_path / "a.raw"
    path.write_bytes(raw)
    with pytest.raises(FormatError, match="a time that no camera writes") as caught:
        nvsdata.read(path)
    assert caught.value.offset in (begin + size * place, begin + size * (place + 1))
    repaired = nvsdata.open(path, strict=False)
    events = repaired.read()
    assert repaired.repairs["words of times that no camera writes, dropped"] == 1
    assert len(events) == 3_000
    # those that the word dated have the time before it
    wrong = events.t != ev.t
    assert 0 < np.count_nonzero(wrong) < 60
    assert np.abs(events.t - ev.t).max() <= 2 * 4_096


@pytest.mark.parametrize("kind", ["dat", "aedat2"])
def test_a_clock_set_back_is_told_and_the_longer_part_kept(tmp_path, kind):
    ev, raw, begin = sound(kind)
    suffix, size, _ = KINDS[kind]
    cut = begin + 1_000 * size
    path = tmp_path / f"a{suffix}"
    path.write_bytes(raw[:begin] + raw[cut:] + raw[begin:cut])
    with pytest.raises(FormatError, match="1000 of 3000 records are damaged, or the clock was set back") as caught:
        nvsdata.read(path)
    assert caught.value.offset == begin + 2_000 * size
    assert nvsdata.read(path, strict=False) == ev[1_000:]


@pytest.mark.parametrize("first", [0, 90, 2**32 - 400])
@pytest.mark.parametrize("suffix", [".dat", ".aedat"])
def test_jitter_is_sorted_within_a_wrap_and_over_it(tmp_path, suffix, first):
    t = first + np.array([0, 300, 250, 500, 480, 700, 690, 4_000])
    p = np.zeros(8, int)
    body = np.stack([t % 2**32, p], 1).astype("<u4").tobytes() if suffix == ".dat" else aedat2_bytes(p, t, b"")
    (tmp_path / f"a{suffix}").write_bytes((b"% Version 2\n\0\x08" if suffix == ".dat" else DVS128) + body)
    for strict in (True, False):
        recording = nvsdata.open(tmp_path / f"a{suffix}", strict=strict)
        assert recording.read().t.tolist() == sorted(t.tolist())
        assert recording.read(first + 260, first + 600).t.tolist() == [first + 300, first + 480, first + 500]


def test_an_event_that_strayed_beyond_the_sight_of_windows_is_told(tmp_path):
    t = np.arange(40_000)
    # within what a camera's buffers may hold back, but over several blocks
    t[30_000] = 5_000
    path = tmp_path / "a.dat"
    path.write_bytes(b"% Version 2\n\0\x08" + np.stack([t, 0 * t], 1).astype("<u4").tobytes())
    with pytest.raises(FormatError, match="displaced by more than 4096 records") as caught:
        nvsdata.read(path)
    assert caught.value.offset == 14 + 8 * 28_672
    repaired = nvsdata.open(path, strict=False)
    assert repaired.read().t.tolist() == np.sort(t).tolist()
    assert repaired.read(5_000, 5_001).t.tolist() == [5_000, 5_000]


@pytest.mark.parametrize("suffix", [".dat", ".aedat", ".aedat1"])
@pytest.mark.parametrize("gap", [2**20, 2**20 + 3, 2**28, SILENT_US])
def test_windows_of_recordings_with_few_events_a_second(tmp_path, suffix, gap):
    t = 7 + gap * np.arange(20_000)
    ev = Events(t, t % 7, t % 5, t % 2, (128, 128))
    path = tmp_path / f"a{suffix}"
    nvsdata.write(ev, path)
    assert nvsdata.read(path) == ev
    assert nvsdata.open(path).span == (t[0], t[-1])
    for k in (3, 4_096, 19_000):
        window = nvsdata.read(path, int(t[k]), int(t[k + 5]))
        assert window == ev.window(int(t[k]), int(t[k + 5]))


def test_verify_tells_of_damaged_words(tmp_path):
    for kind in ("dat", "aedat1", "aedat2"):
        _, raw, begin = sound(kind)
        suffix, size, where = KINDS[kind]
        (tmp_path / f"sound{suffix}").write_bytes(raw)
        at = begin + 2_000 * size + where.start
        raw[at : at + 4] = b"\xff\xff\xff\xff"
        (tmp_path / f"damaged{suffix}").write_bytes(raw)
    fault = "1 records of times that no camera writes, dropped"
    assert sorted(problems(tmp_path)) == [(f"damaged{suffix}", fault) for suffix in (".aedat", ".aedat1", ".dat")]


@pytest.mark.parametrize("suffix", [".dat", ".aedat", ".aedat1"])
@pytest.mark.parametrize("word", [b"\x7f\xff\xff\xff", b"\0\0\0\0"])
@pytest.mark.parametrize("place", [0, -1])
def test_a_first_or_last_word_is_told_by_the_time_that_our_files_state(tmp_path, suffix, word, place):
    ev, _, _ = sound("dat")
    path = tmp_path / f"a{suffix}"
    nvsdata.write(ev, path)
    size, where = next((size, where) for known, size, where in KINDS.values() if known == suffix)
    raw = bytearray(path.read_bytes())
    at = (len(raw) - size if place else len(raw) - len(ev) * size) + where.start
    raw[at : at + 4] = word[::-1] if suffix == ".dat" else word
    path.write_bytes(raw)
    with pytest.raises(FormatError, match=r"outside the time that it states|a time that no camera writes"):
        nvsdata.read(path)


def no_longer_stated(raw):
    """Our file without the line that states its time, as a camera's has none."""
    return re.sub(rb"[#%] nvsdata time .*?\r?\n", b"", bytes(raw), count=1)


FIRST = [0x80000001, 0x90000000, 0xC0000000, 0xE1234567, 0xEE000000]


@pytest.mark.parametrize("suffix", [".dat", ".aedat", ".aedat1"])
@pytest.mark.parametrize("word", FIRST)
@pytest.mark.parametrize("stated", [True, False])
def test_a_first_word_far_ahead_moves_no_other_event(tmp_path, suffix, word, stated):
    t = 200 * np.arange(9_000)  # windows have an index of several blocks
    ev = Events(t, t % 128, t % 120, t % 2, (128, 128))
    path = tmp_path / f"a{suffix}"
    nvsdata.write(ev, path)
    size, where = next((size, where) for known, size, where in KINDS.values() if known == suffix)
    raw = bytearray(path.read_bytes() if stated else no_longer_stated(path.read_bytes()))
    first = len(raw) - len(ev) * size
    raw[first + where.start : first + where.stop] = word.to_bytes(4, "little" if suffix == ".dat" else "big")
    path.write_bytes(raw)
    for read in (
        lambda recording: recording.read(),
        lambda recording: recording.span,
        lambda recording: recording.read(0, 10**6),
        lambda recording: recording.read(1_700_000, 1_710_000),
    ):
        with pytest.raises(FormatError, match="a time that no camera writes: 1 of 9000 records are damaged") as caught:
            read(nvsdata.open(path))
        assert caught.value.offset == first
    repaired = nvsdata.open(path, strict=False)
    assert repaired.read() == ev[1:]
    assert repaired.repairs == {"records of times that no camera writes, dropped": 1}
    assert [fault for _, fault in problems(tmp_path)] == ["1 records of times that no camera writes, dropped"]


@pytest.mark.parametrize("word", [0x9000000, 0xE000000, 0xFFFFFFE, 0xFFFFFFF])
def test_a_first_word_of_high_time_far_ahead_moves_no_event(tmp_path, word):
    ev, raw, begin = sound("evt2")
    # as from a camera that has run for ten minutes
    words = np.frombuffer(bytes(raw[begin:]), "<u4").copy()
    highs = np.flatnonzero(words >> 28 == 8)
    words[highs] += 600_000_000 >> 6
    words[highs[0]] = 8 << 28 | word
    path = tmp_path / "a.raw"
    path.write_bytes(bytes(raw[:begin]) + words.tobytes())
    for window in ((), (0, 10**9)):
        with pytest.raises(FormatError, match="a time that no camera writes") as caught:
            nvsdata.read(path, *window)
        assert caught.value.offset == begin
    repaired = nvsdata.open(path, strict=False)
    # nothing dates those before the second word of time
    undated = highs[1] - 1
    assert np.array_equal(repaired.read().t, ev.t[undated:] + 600_000_000)
    assert repaired.repairs == {"words of times that no camera writes, dropped": 1}


@pytest.mark.parametrize("kind", ["dat", "aedat1", "aedat2"])
@pytest.mark.parametrize("leaps", [(0x60000000, 0xC0000000), (0x40000000, 0x80000000, 0xC0000000), (0x7FFFFFFF,) * 2])
@given(place=st.integers(0, 2_990))
def test_a_cascade_of_damaged_words_moves_no_other_event(tmp_path, kind, leaps, place):
    ev, raw, begin = sound(kind)
    suffix, size, where = KINDS[kind]
    for k, word in enumerate(leaps):
        at = begin + (place + k) * size + where.start
        raw[at : at + 4] = word.to_bytes(4, "little" if kind == "dat" else "big")
    path = tmp_path / f"a{suffix}"
    path.write_bytes(raw)
    message = f"a time that no camera writes: {len(leaps)} of 3000 records are damaged"
    with pytest.raises(FormatError, match=message) as caught:
        nvsdata.read(path)
    assert caught.value.offset == begin + place * size
    repaired = nvsdata.open(path, strict=False)
    assert repaired.read() == ev[np.delete(np.arange(3_000), np.arange(place, place + len(leaps)))]
    assert repaired.repairs == {"records of times that no camera writes, dropped": len(leaps)}


def most_without_jumps(words, bits, back, silent):
    """How many words can be kept so that times never jump, each choice tried from the shortest chains on."""
    best = []
    for k, word in enumerate(words):
        chains = [(1, word)] if word != 2**bits - 1 else []
        for j in range(k):
            for count, time in best[j]:
                now = int(nearest_time(word, time, bits))
                if not is_jump(time, now, bits, back, silent):
                    chains.append((count + 1, now))
        best.append(chains)
    return max((count for chains in best for count, _ in chains), default=0)


@given(
    st.lists(st.sampled_from([0, 3, 9, 2_000, 4_000, 5_000, 7_000, 8_000, 8_180, 8_191]) | st.integers(0, 8_191)).map(
        lambda words: words[:9]
    )
)
def test_the_most_words_are_kept_and_between_them_no_time_jumps(words):
    bits, back, silent = 13, 2, 300  # of which half is far more than a silence
    kept = np.array(words, np.int64)[kept_words(np.array(words, np.int64), bits, back, silent)].tolist()
    assert len(kept) == most_without_jumps(words, bits, back, silent)
    time = None
    for word in kept:
        now = word if time is None else int(nearest_time(word, time, bits))
        assert now >= 0
        assert time is None or not is_jump(time, now, bits, back, silent)
        time = now


@pytest.mark.parametrize("suffix", [".dat", ".aedat"])
def test_a_block_that_begins_after_a_wrap_and_steps_back_over_it_is_sound(tmp_path, suffix):
    # a silence of more than a minute makes the index walk the block
    t = 2**32 - 80_000 + 20 * np.arange(12_288)
    t[4_097] = t[4_096] - 3_000
    t[8_000:] += 100_000_000
    body = np.stack([t % 2**32, 0 * t], 1).astype("<u4").tobytes() if suffix == ".dat" else aedat2_bytes(0 * t, t, b"")
    path = tmp_path / f"a{suffix}"
    path.write_bytes((b"% Version 2\n\0\x08" if suffix == ".dat" else DVS128) + body)
    whole = nvsdata.read(path)
    assert whole.t.tolist() == np.sort(t).tolist()
    for recording in (nvsdata.open(path), nvsdata.open(path, strict=False)):
        assert recording.span == (t[0], t[-1])
        assert recording.read(2**32 - 100, 2**32 + 5_000) == whole.window(2**32 - 100, 2**32 + 5_000)


@given(st.lists(st.integers(0, 2**32 - 1), min_size=1, max_size=30))
def test_what_was_repaired_is_sound(tmp_path, words):
    header, _ = file_of("dat", 0, np.random.default_rng(0))
    words = np.array(words, np.int64)
    kept = words[kept_words(words, 32, BACK_US, SILENT_US)]
    for name, some in (("damaged", words), ("mended", kept)):
        body = np.stack([some, np.zeros_like(some)], 1).astype("<u4").tobytes()
        (tmp_path / f"{name}.dat").write_bytes(header + body)
    assert nvsdata.read(tmp_path / "damaged.dat", strict=False) == nvsdata.read(tmp_path / "mended.dat")


@pytest.mark.parametrize("short", [0, 32])
@pytest.mark.parametrize("size", [None, (128, 128), (256, 256)])
@given(places=st.lists(st.tuples(st.integers(0, 2_999), st.integers(241, 255)), min_size=1, max_size=4))
def test_rows_that_atis_files_cannot_hold_are_told_or_dropped(tmp_path, monkeypatch, short, size, places):
    ev, _, _ = sound("dat")
    path = tmp_path / "a.bin"
    nvsdata.write(ev, path)
    raw = np.frombuffer(path.read_bytes(), np.uint8).reshape(-1, 5).copy()
    for place, y in places:
        raw[place, 1] = y
    path.write_bytes(raw.tobytes())
    at = sorted({place for place, _ in places})
    others = np.delete(np.arange(3_000), at)
    with monkeypatch.context() as patch:
        patch.setattr(atis, "SHORT", short)
        reads = [lambda recording: recording.read(), lambda recording: recording.span]
        reads += [
            lambda recording: recording.read(0, 5_000_400),
            lambda recording: recording.read(5_300_000, 5_310_000),
        ]
        for read in reads:
            with pytest.raises(FormatError, match="is damage, because events have y below 240") as caught:
                read(nvsdata.open(path, sensor_size=size))
            assert caught.value.offset == 5 * at[0]
        repaired = nvsdata.open(path, sensor_size=size, strict=False)
        assert repaired.read() == Events(*(c[others] for c in ev.columns), size)
        assert repaired.repairs == {"records of y above 240, dropped": len(at)}
        assert repaired.read(5_300_000, 5_310_000) == repaired.read().window(5_300_000, 5_310_000)
        assert repaired.span == (ev.t[others[0]], ev.t[others[-1]])
