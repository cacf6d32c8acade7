"""Frames and inertial samples in files."""

import os
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import nvsdata
from nvsdata import Events, FormatError
from nvsdata.data.pieces import cut_pieces
from nvsdata.data.samples import Frame, Inertial, Piece
from nvsdata.formats.aedat.aedat2_samples import merged_records
from nvsdata.formats.hdf5.samples import SampleWriter
from nvsdata.kernels.decode.aedat2 import DAVIS

SIZE = (240, 180)
ABOUT = {
    "camera": "DAVIS240C",
    "serial": "SIM00001",
    "started": "2026-01-02T03:04:05.000006+00:00",
    "biases": {"OnBn": [5, 255]},
}


def picture(rng, width, height):
    return rng.integers(0, 1024, (height, width), dtype=np.uint16) << 6


@st.composite
def pieces(draw):
    """What a camera might send: frames, one after the other, and samples and events meanwhile."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    found, now = [], draw(st.sampled_from([0, 5_000, 2**32 - 60_000]))
    for _ in range(draw(st.integers(1, 5))):
        start, now = now, now + draw(st.integers(2_000, 90_000))
        t = np.sort(rng.integers(start, now, draw(st.integers(0, 40))))
        place = rng.integers(0, SIZE[0], t.size), rng.integers(0, SIZE[1], t.size)
        events = Events(t, *place, rng.integers(0, 2, t.size), SIZE, start=0, end=now)
        count = draw(st.integers(0, 3))
        inertial = Inertial(
            np.sort(rng.integers(start, now, count)),
            (rng.integers(-(2**15), 2**15, (count, 3)) / 2**13).astype(np.float32),
            (rng.integers(-(2**15), 2**15, (count, 3)) * 500 / 2**15).astype(np.float32),
            (rng.integers(-9_000, 9_000, count) / 340 + 35).astype(np.float32),
        )
        frames = []
        if draw(st.booleans()):
            times = np.sort(rng.integers(max(start - 100, 0), now, 4)).tolist()
            if not found or not any(piece.frames for piece in found) or times[0] >= start:
                frames.append(Frame(*times, 7, 3, picture(rng, 9, 4)))
        found.append(Piece.of_camera(events, frames, inertial, {"temperature": 25.0}))
    return found


def same(a, b):
    """Whether two frames are."""
    times = [[f.start, f.exposure_start, f.exposure_end, f.end, f.x, f.y] for f in (a, b)]
    return times[0] == times[1] and np.array_equal(a.pixels, b.pixels)


@pytest.mark.parametrize("suffix", ["h5", "aedat", "aedat4"])
@settings(max_examples=12)
@given(given_pieces=pieces())
def test_files_hold_what_came_beside_events(tmp_path, suffix, given_pieces):
    path = tmp_path / f"a.{suffix}"
    nvsdata.write(iter([Piece.of_camera(Events.empty(SIZE), about=ABOUT), *given_pieces]), path)
    recording = nvsdata.open(path)
    frames = [frame for piece in given_pieces for frame in piece.frames]
    assert len(list(recording.frames())) == len(frames)
    assert all(same(a, b) for a, b in zip(recording.frames(), frames, strict=True))
    ours, theirs = Inertial.joined([piece.inertial for piece in given_pieces]), recording.inertial()
    assert all(np.allclose(a, b, atol=1e-3) and a.dtype == b.dtype for a, b in zip(ours, theirs, strict=True))
    assert np.array_equal(ours.t, theirs.t)
    t = np.concatenate([piece.t for piece in given_pieces])
    assert np.array_equal(recording.read().t, t)
    if suffix == "h5":
        assert dict(recording.about) == ABOUT | {"temperature": 25.0}

    # windows
    middle = int(np.median(ours.t)) if ours.t.size else 0
    assert np.array_equal(recording.inertial(middle).t, ours.t[ours.t >= middle])
    early = [frame for frame in frames if frame.exposure_start < middle]
    assert all(same(a, b) for a, b in zip(recording.frames(None, middle), early, strict=True))

    # from file to file
    for other in ("h5", "aedat", "aedat4"):
        nvsdata.write(recording, tmp_path / f"b.{other}")
        copy = nvsdata.open(tmp_path / f"b.{other}")
        assert copy.read() == recording.read()
        assert np.array_equal(copy.inertial().t, ours.t)
        assert all(same(a, b) for a, b in zip(copy.frames(), frames, strict=True))


def test_other_programs_read_frames_and_samples_of_aedat_4(tmp_path):
    aedat = pytest.importorskip("aedat")
    given_pieces = list(sampled(3, 10_000, framed=True))
    for deep, piece in enumerate(given_pieces):
        for frame in piece.frames:
            frame.pixels[3, 4] = 200 << 8 * (deep % 2)
    nvsdata.write(iter(given_pieces), tmp_path / "a.aedat4")
    decoder = aedat.Decoder(str(tmp_path / "a.aedat4"))
    assert {stream["type"] for stream in decoder.id_to_stream().values()} == {"events", "frame", "imus"}
    packets = list(decoder)
    frames = [packet["frame"] for packet in packets if "frame" in packet]
    assert [frame["exposure_begin_t"] for frame in frames] == [1, 10_001, 20_001]
    assert [frame["pixels"].dtype for frame in frames] == [np.uint8, np.uint16, np.uint8]
    wanted = [frame.pixels for piece in given_pieces for frame in piece.frames]
    assert all(np.array_equal(frame["pixels"], pixels) for frame, pixels in zip(frames, wanted, strict=True))
    t = np.concatenate([packet["imus"]["t"] for packet in packets if "imus" in packet])
    assert t.tolist() == [time for piece in given_pieces for time in piece.inertial.t.tolist()]


def test_frames_of_aedat_4_at_time_0_and_none_that_it_cannot_hold(tmp_path):
    pixels = np.ones((3, 4), np.uint16)
    frames = [Frame(0, 0, 0, 9, 0, 0, pixels), Frame(0, 10, 20, 30, 0, 0, pixels), Frame(-5, 0, 7, 8, 0, 0, pixels)]
    nvsdata.write(Piece.of_camera(Events.empty(SIZE), frames), tmp_path / "a.aedat4")
    assert all(same(a, b) for a, b in zip(nvsdata.open(tmp_path / "a.aedat4").frames(), frames, strict=True))
    for x, shape in ((0, (1, 40_000)), (40_000, (1, 1)), (0, (0, 0))):
        frame = Frame(0, 1, 2, 3, x, 0, np.zeros(shape, np.uint16))
        with pytest.raises(ValueError, match=r"a frame of .* at .*: AEDAT 4 supports 1 to 32767 pixels along a side"):
            nvsdata.write(Piece.of_camera(Events.empty(SIZE), [frame]), tmp_path / "b.aedat4")
    assert not (tmp_path / "b.aedat4").exists()


def test_a_camera_is_named_in_aedat_4_whatever_its_name(tmp_path):
    for name, found in (("DAVIS346 <&>", "DAVIS346 ???"), ("é" * 99, "?" * 64), ("nvsdata", None)):
        nvsdata.write(Piece.of_camera(Events.empty(SIZE), about={"camera": name}), tmp_path / "a.aedat4")
        assert nvsdata.open(tmp_path / "a.aedat4").about.get("camera") == found
        assert not nvsdata.open(tmp_path / "a.aedat4").holds_samples


def recorded(tmp_path):
    rng = np.random.default_rng(0)
    t = np.arange(0, 3_000_000, 1_000)
    events = Events(t, t % 240, t % 180, t % 2, SIZE, start=0)
    frames = [Frame(b - 10, b, b + 4_000, b + 9_000, 0, 0, picture(rng, 240, 180)) for b in (5, 1_000_000, 2_500_000)]
    zeros = np.zeros((3_000, 3), np.float32)
    inertial = Inertial(t + 3, zeros, zeros, np.full(3_000, 25, np.float32))
    nvsdata.write([Piece.of_camera(events, frames, inertial, ABOUT)], tmp_path / "a.h5")
    return nvsdata.open(tmp_path / "a.h5"), frames


def test_a_cut_has_a_clock_of_its_own(tmp_path):
    recording, frames = recorded(tmp_path)
    nvsdata.write(cut_pieces(recording, 1_000_000, 2_500_001), tmp_path / "b.h5")
    found = nvsdata.open(tmp_path / "b.h5")
    assert [same(a, b.shifted(1_000_000)) for a, b in zip(found.frames(), frames[1:], strict=True)] == [True, True]
    assert [frame.start for frame in found.frames()] == [-10, 1_499_990]
    assert found.inertial().t.tolist() == list(range(3, 1_500_000, 1_000))
    assert found.read().t.tolist() == list(range(0, 1_500_001, 1_000))
    assert found.about == ABOUT | {"started": "2026-01-02T03:04:06.000006+00:00"}


def test_a_recording_is_handed_out_second_by_second(tmp_path, monkeypatch):
    recording, frames = recorded(tmp_path)
    asked, given = [], []

    def watched(*window, real=recording.frames):
        asked.append("frames")
        for frame in real(*window):
            given.append(frame)
            yield frame

    monkeypatch.setattr(recording, "frames", watched)
    inertial = recording.inertial()
    monkeypatch.setattr(recording, "inertial", lambda *window: asked.append("inertial") or inertial)
    for pieces in (recording.pieces(), cut_pieces(recording, 0, 3_000_000)):
        asked.clear()
        given.clear()
        first = next(pieces)
        # one more was looked at
        assert len(given) == 2
        rest = [first, *pieces]
        assert sorted(asked) == ["frames", "inertial"]
        found = [frame for piece in rest for frame in piece.frames]
        assert all(same(a, b) for a, b in zip(found, frames, strict=True))
        assert [len(piece.frames) for piece in rest[:3]] == [1, 1, 1]
        assert [len(piece) for piece in rest[:3]] == [1_000] * 3
        t = np.concatenate([piece.inertial.t for piece in rest])
        assert t.tolist() == inertial.t.tolist()
        assert rest[-1].about or rest[0].about


@pytest.mark.parametrize("suffix", ["h5", "aedat", "aedat4"])
def test_what_lies_before_after_or_far_from_the_events_is_kept(tmp_path, suffix):
    far = 1 << 31
    events = Events([3_000_000, 3_100_000, far - 500_000], [1, 2, 3], [1, 2, 3], [0, 1, 0], SIZE, start=2_900_000)
    rng = np.random.default_rng(0)
    # exposures that begin just before a second is over, and in the next one
    begins = [1_000, 3_999_999, 4_900_000, far + 700_000]
    frames = [Frame(b - 900, b, b + 400, b + 9_000, 0, 0, picture(rng, 9, 4)) for b in begins]
    t = np.array([7, 3_000_000, 3_999_999, 4_000_000, far + 5_000_000])
    zeros = np.zeros((5, 3), np.float32)
    inertial = Inertial(t, zeros, zeros, np.zeros(5, np.float32))
    nvsdata.write(Piece.of_camera(events, frames, inertial, ABOUT), tmp_path / "a.h5")
    recording = nvsdata.open(tmp_path / "a.h5")
    assert len(list(recording.pieces())) < 10
    nvsdata.write(recording, tmp_path / f"b.{suffix}")
    copy = nvsdata.open(tmp_path / f"b.{suffix}")
    assert copy.read() == events
    assert (copy.start, copy.end) == (recording.start, recording.end) == (2_900_000, far - 500_000)
    assert copy.inertial().t.tolist() == t.tolist()
    assert all(same(a, b) for a, b in zip(copy.frames(), frames, strict=True))


def test_frames_in_disorder_are_kept_with_all_events_once(tmp_path):
    recording, frames = recorded(tmp_path)
    nvsdata.write(Piece.of_camera(recording.read(), frames[::-1], recording.inertial()), tmp_path / "b.h5")
    other = nvsdata.open(tmp_path / "b.h5")
    nvsdata.write(other, tmp_path / "c.h5")
    copy = nvsdata.open(tmp_path / "c.h5")
    assert copy.read() == recording.read()
    assert copy.inertial().t.tolist() == recording.inertial().t.tolist()
    assert all(same(a, b) for a, b in zip(copy.frames(), frames[::-1], strict=True))


def sampled(count, step, framed=False):
    """Pieces of `step` µs with a few events and samples, as a camera's come, and a frame each if there are to be."""
    zeros = np.zeros((2, 3), np.float32)
    for begin in range(0, count * step, step):
        t = begin + np.arange(0, step, step // 5)
        inertial = Inertial(t[:2], zeros, zeros, np.zeros(2, np.float32))
        pixels = np.zeros((SIZE[1], SIZE[0]), np.uint16)
        frames = [Frame(begin, begin + 1, begin + 2, begin + 3, 0, 0, pixels)] if framed else []
        events = Events.trusted(Events(t, t % 200, t % 100, t % 2).columns, SIZE, 0, begin + step)
        yield Piece.of_camera(events, frames, inertial)


def test_aedat_2_puts_records_in_order_twice_a_second():
    found = list(merged_records(sampled(300, 10_000), DAVIS, SIZE))
    assert len(found) <= 8
    t = np.concatenate([records.t for records in found])
    assert t.size == 300 * (5 + 2 * 7)
    assert (np.diff(t) >= 0).all()


def test_hdf5_writes_samples_and_frames_of_many_pieces_at_once(tmp_path, monkeypatch):
    real, times = SampleWriter._append, []
    monkeypatch.setattr(SampleWriter, "_append", lambda *arguments: (times.append(arguments[1]), real(*arguments)))
    nvsdata.write(sampled(150, 10_000, framed=True), tmp_path / "a.h5")
    assert times.count("inertial/t") == times.count("frames/pixels") == 3
    recording = nvsdata.open(tmp_path / "a.h5")
    assert recording.inertial().t.size == 300
    assert [frame.start for frame in recording.frames()] == list(range(0, 1_500_000, 10_000))


@pytest.mark.skipif(sys.platform == "win32", reason="of POSIX")
def test_frames_on_a_full_disk_are_told_at_once(tmp_path):
    import resource

    passed = []
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (6_000_000, limits[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            nvsdata.write(
                (passed.append(0) or piece for piece in sampled(1_000, 10_000, framed=True)), tmp_path / "a.h5"
            )
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    # 70 frames of 86,400 bytes fill it
    assert 60 < len(passed) < 200
    assert os.listdir(tmp_path) == []


def test_other_formats_hold_events_alone(tmp_path):
    recording, _ = recorded(tmp_path)
    nvsdata.write(recording, tmp_path / "b.txt")
    other = nvsdata.open(tmp_path / "b.txt")
    assert other.read() == recording.read()
    assert other.about == {}
    for asked in (other.frames, other.inertial):
        with pytest.raises(FormatError, match=r"b\.txt: .* aren't read from text files"):
            asked()
    nvsdata.write(recording.read(), tmp_path / "c.h5")
    assert list(nvsdata.open(tmp_path / "c.h5").frames()) == []
    assert nvsdata.open(tmp_path / "c.h5").inertial().t.size == 0
    # a DVS128 has neither
    small = Events([1], [1], [1], [1], (128, 128))
    with pytest.raises(ValueError, match="which has no inertial samples"):
        nvsdata.write(Piece.of_camera(small, (), recording.inertial()), tmp_path / "d.aedat")


@pytest.mark.parametrize(
    ("name", "values", "reason"),
    [
        ("frames/x", np.zeros(2, np.int16), "columns of"),
        ("frames/width", np.zeros(3, np.int16), "pixels"),
        ("frames/height", np.full(3, 181, np.int16), "pixels"),
        ("frames/start", np.zeros(3), "columns of"),
        ("frames/pixels", np.zeros(5, np.uint16), "pixels"),
        ("frames/pixels", np.zeros(1_000_000, np.uint16), "pixels"),
        ("inertial/t", np.zeros(5, np.int64), "columns of"),
        ("inertial/rotation", np.zeros((3_000, 2), np.float32), "columns of"),
        ("inertial/temperature", None, "there is no /inertial/temperature"),
    ],
)
def test_damaged_groups_are_told(tmp_path, name, values, reason):
    recording, _ = recorded(tmp_path)
    with h5py.File(recording.path, "r+") as file:
        del file[name]
        if values is not None:
            file[name] = values
    with pytest.raises(FormatError, match=rf"a\.h5: .*{reason}"):
        list(recording.frames()) if name.startswith("frames") else recording.inertial()


def test_samples_of_jaer(shared_samples):
    recording = nvsdata.open(shared_samples / "davis240c_IMU_translBoxes.aedat")
    inertial = recording.inertial()
    assert inertial.t.size == 33_837 // 7 - 0
    assert (np.diff(inertial.t) > 0).all()
    first, last = recording.span
    assert first - 5_000 < inertial.t[0] < inertial.t[-1] < last + 5_000
    # at rest but for a motion along the boxes: gravity, in the scale that the header tells
    assert np.linalg.norm(inertial.acceleration, axis=1).mean() == pytest.approx(1.0, abs=0.02)
    assert 25 < inertial.temperature.mean() < 35
    assert list(recording.frames()) == []


def rolling(width, height, light, first=0):
    """Words of a frame as a rolling shutter gives it: a column read before, while one of an earlier column is after."""
    rows = []
    for column in range(width + 2):
        for kind, x in ((0, column), (1, column - 2)):
            if 0 <= x < width:
                for y in range(height):
                    reading = 900 - (int(light[y, x]) if kind else 0)
                    rows.append((1 << 31 | (179 - y) << 22 | x << 12 | kind << 10 | reading, first + len(rows)))
    return rows


def test_frames_of_a_rolling_shutter_and_broken_ones(tmp_path):
    light = np.arange(12, dtype=np.uint16).reshape(3, 4)
    whole = rolling(4, 3, light)
    # one that lacks a word, one that begins before the file
    rows = whole[9:] + rolling(4, 3, light + 5, 100)[:-1] + rolling(4, 3, light + 7, 200) + rolling(4, 3, light, 300)
    head = b"#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.DAVIS240C\r\n#End Of ASCII Header\r\n"
    (tmp_path / "a.aedat").write_bytes(head + np.array(rows, ">u4").tobytes())
    recording = nvsdata.open(tmp_path / "a.aedat")
    frames = list(recording.frames())
    assert [frame.pixels.tolist() for frame in frames] == [((light + 7) << 6).tolist(), (light << 6).tolist()]
    assert [(f.start, f.exposure_start, f.exposure_end, f.end) for f in frames] == [
        (200, 200, 209, 223),
        (300, 300, 309, 323),
    ]
    assert len(recording.read()) == 0


def test_inertial_samples_that_lack_words_are_left_out(tmp_path, monkeypatch):
    monkeypatch.setattr("nvsdata.formats.aedat.aedat2.Aedat2Recording.block", 5)
    monkeypatch.setattr("nvsdata.formats.records.PIECE", 40)
    words = [(1 << 31 | code << 28 | 8192 << 12 | 3 << 10, n) for n in range(6) for code in range(7)]
    del words[16], words[1]
    head = b"#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.DAVIS240C\r\n#End Of ASCII Header\r\n"
    (tmp_path / "a.aedat").write_bytes(head + np.array(words[:-1], ">u4").tobytes())
    inertial = nvsdata.open(tmp_path / "a.aedat").inertial()
    assert inertial.t.tolist() == [1, 3, 4]
    assert inertial.acceleration.tolist() == [[2.0] * 3] * 3
    assert inertial.rotation == pytest.approx(np.full((3, 3), 250.0))


LOST = b"\xff\xff\xff\xff"


@pytest.fixture
def beside(tmp_path):
    """An AEDAT 2 file of 10,000 events over a second, 20 frames and 1,000 inertial samples."""
    rng = np.random.default_rng(0)
    t = 5_000_000 + 100 * np.arange(10_000)
    frames = [Frame(b, b + 10, b + 4_000, b + 9_000, 7, 3, picture(rng, 9, 4)) for b in range(t[0], t[-1], 50_000)]
    zeros = np.zeros((1_000, 3), np.float32)
    inertial = Inertial(t[::10] + 3, zeros, zeros, np.full(1_000, 25, np.float32))
    nvsdata.write(Piece.of_camera(Events(t, t % 240, t % 180, t % 2, SIZE), frames, inertial), tmp_path / "a.aedat")
    return nvsdata.open(tmp_path / "a.aedat")


def damaged_at(recording, kind, place, word):
    """Put a word of time in place of that of one record: of an event (0), of a frame (1) or of a sample (2)."""
    path = Path(recording.path)
    raw = bytearray(path.read_bytes())
    addresses = np.frombuffer(raw[recording.header_size :], ">u4")[::2]
    kinds = np.where(addresses < 1 << 31, 0, np.where(addresses >> 10 & 3 == 3, 2, 1))
    at = recording.header_size + 8 * int(np.flatnonzero(kinds == kind)[place])
    raw[at + 4 : at + 8] = word
    path.write_bytes(raw)


@pytest.mark.parametrize(
    ("kind", "place", "word"),
    [
        (0, 0, LOST),
        *((kind, 500, word) for kind in range(3) for word in (LOST, bytes(4), b"\x7f\xff\xff\xff", b"\x90\0\0\0")),
    ],
)
def test_a_damaged_word_of_time_moves_no_other_sample_or_frame(beside, kind, place, word):
    frames, samples = list(beside.frames()), beside.inertial().t
    assert (len(frames), samples.size) == (20, 1_000)
    damaged_at(beside, kind, place, word)
    for asked in (lambda recording: recording.inertial(), lambda recording: list(recording.frames())):
        with pytest.raises(FormatError, match=r"a\.aedat: byte \d+: a time that no camera writes: 1 of"):
            asked(nvsdata.open(beside.path))
    mended = nvsdata.open(beside.path, strict=False)
    assert mended.inertial().t.tolist() == (np.delete(samples, place // 7) if kind == 2 else samples).tolist()
    found = list(nvsdata.open(beside.path, strict=False).frames())
    # that which lacks a pixel is left out
    kept = np.delete(np.arange(20), place // 72) if kind == 1 else np.arange(20)
    assert all(same(a, frames[n]) for a, n in zip(found, kept, strict=True))
    assert mended.repairs == {"records of times that no camera writes, dropped": 1}


def test_a_file_that_is_cut_or_torn_is_told_by_samples_and_frames(beside):
    samples, size = beside.inertial().t, os.path.getsize(beside.path)
    os.truncate(beside.path, size - 3)
    torn = nvsdata.open(beside.path, strict=False)
    assert torn.inertial().t.tolist() == samples.tolist()
    assert len(list(torn.frames())) == 20
    for left, reason in ((70_001, "truncated"), (size, "was changed")):
        os.truncate(beside.path, left)
        for recording in (beside, torn):
            with pytest.raises(FormatError, match=reason):
                recording.inertial()
            with pytest.raises(FormatError, match=reason):
                list(recording.frames())


def test_aedat_1_is_not_read_for_frames(tmp_path):
    nvsdata.write(Events([1], [1], [1], [1], (128, 128)), tmp_path / "a.aedat1")
    recording = nvsdata.open(tmp_path / "a.aedat1")
    for asked in (recording.frames, recording.inertial):
        with pytest.raises(FormatError, match=r"a\.aedat1: .* aren't read from aedat1 files"):
            asked()
