import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lookalikes import evt2_bytes, evt3_bytes, rows
from strategies import events

import nvsdata
from nvsdata import Events, FormatError

WRITERS = {"evt2": evt2_bytes, "evt3": evt3_bytes}
both = pytest.mark.parametrize("kind", WRITERS)


@both
@given(ev=events(max_size=300, width=1280, height=720), first=st.integers(0, 2**34))
def test_words_decode_as_the_description_says(tmp_path, kind, ev, first):
    # EVT3 doesn't say how often its 24 bits wrapped before the file begins
    ev = Events(ev.t - ev.start + first % 2**24, ev.x, ev.y, ev.p, (1280, 720))
    (tmp_path / "a.raw").write_bytes(WRITERS[kind](ev))
    assert nvsdata.read(tmp_path / "a.raw", sensor_size=(1280, 720)) == ev


@both
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


@both
@pytest.mark.parametrize(
    "header",
    [b"% geometry 640x480\n", b"% Width 640\n% Height 480\n", b"% Date 2020-01-01 10:00:00\n% width=640;height=480\n"],
)
def test_the_header_states_the_sensor(tmp_path, kind, header):
    ev = Events([5, 6], [1, 2], [3, 4], [1, 0], (640, 480))
    (tmp_path / "a.raw").write_bytes(WRITERS[kind](ev, b"% evt " + kind[-1:].encode() + b".0\n" + header + b"% end\n"))
    assert nvsdata.read(tmp_path / "a.raw") == ev


@both
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


@both
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
