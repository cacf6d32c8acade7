"""Files that another process writes to while they are read: valid events or an error, never the end of the process."""

import os
from contextlib import suppress

import numpy as np
import pytest
from lookalikes import aedat4_bytes, evt2_bytes, evt3_bytes, evt21_bytes
from storefiles import block_places, put_block

import nvsdata
from nvsdata import Events, FormatError
from nvsdata.datasets import EventFolder
from nvsdata.datasets.store import file as store_file
from nvsdata.datasets.store.writer import pack
from nvsdata.formats import contents, ondisk
from nvsdata.formats.evt.evt2 import Evt21Recording
from nvsdata.formats.evt.evt3 import Evt3Recording
from nvsdata.formats.hdf5.chunks import Chunks
from nvsdata.kernels.decode.evt2 import evt21_count
from nvsdata.kernels.decode.evt3 import evt3_count
from nvsdata.recording.davis import file
from nvsdata.recording.davis.stream import DavisDecoder

SIZE = (128, 128)
RAW = {".evt2.raw": (evt2_bytes, "2.0"), ".evt21.raw": (evt21_bytes, "2.1"), ".evt3.raw": (evt3_bytes, "3.0")}
# bytes of a record, or of what moves together
RECORDS = {".dat": 8, ".aedat": 8, ".aedat1": 6, ".aedat3": 8, ".aedat4": 8, ".bin": 5, ".npy": 13, ".txt": 1, ".h5": 4}
RECORDS |= {".evt2.raw": 4, ".evt21.raw": 8, ".evt3.raw": 2}
every_kind = pytest.mark.parametrize("kind", RECORDS)


def long_file(folder, kind, n=40_000):
    """A file beyond what is read to recognize its format, and the events in it."""
    t = np.arange(n) * 100
    ev = Events(t, t // 100 % 128, t // 700 % 120, t // 100 % 2, SIZE)
    path = folder / f"a{kind}"
    if kind == ".aedat4":
        path.write_bytes(aedat4_bytes(ev, 0, SIZE))
    elif kind in RAW:
        make, version = RAW[kind]
        path.write_bytes(make(ev, f"% evt {version}\n% geometry 128x128\n% end\n".encode()))
    else:
        nvsdata.write(ev, path)
    assert path.stat().st_size > contents.HEAD
    return path, ev


def check(ev, sensor_size=SIZE):
    """Fail for events that no decoder may return."""
    assert ev.t.shape == ev.x.shape == ev.y.shape == ev.p.shape
    assert (np.diff(ev.t) >= 0).all()
    if len(ev):
        assert 0 <= ev.x.min() <= ev.x.max() < sensor_size[0]
        assert 0 <= ev.y.min() <= ev.y.max() < sensor_size[1]
        assert ev.p.max() <= 1


def changes(monkeypatch, change, after):
    """Let `change` alter what reads fill, in place and for the given place in the file, from read number `after` on."""
    fill, count = ondisk.OpenFile.fill, [0]

    def changed(self, at, target):
        fill(self, at, target)
        count[0] += 1
        if count[0] > after:
            change(target.reshape(-1).view(np.uint8), at)

    monkeypatch.setattr(ondisk.OpenFile, "fill", changed)


DENSE = {
    # vectors of twelve events, and events in 32 columns
    "3.0": (2, b"\xff\x4f", Evt3Recording, evt3_count),
    "2.1": (8, b"\x00\x00\x00\x10\xff\xff\xff\xff", Evt21Recording, evt21_count),
}


@pytest.mark.parametrize("version", DENSE)
@pytest.mark.parametrize("after", [0, 1, 2, 3])
def test_words_that_come_to_hold_more_events_have_room(tmp_path, version, after, monkeypatch):
    size, word, kind, counted = DENSE[version]
    monkeypatch.setattr("nvsdata.formats.records.PIECE", 1 << 15)
    path = tmp_path / "a.raw"
    time = (0x8000 if size == 2 else 0x80000000).to_bytes(size, "little")
    body = time * (100_000 // size)
    path.write_bytes(f"% evt {version}\n% geometry 1280x720\n% end\n".encode() + body)
    changes(monkeypatch, lambda raw, at: raw[size:].reshape(-1, size).__setitem__(..., list(word)), after)
    decode = kind.decode_words
    rooms = []

    def watched(raw, width, height, state, seen, kept, t, *rest):
        # the room is right, and not only checked by the decoder
        assert kept + counted(raw) <= t.size
        rooms.append(t.size)
        return decode(raw, width, height, state, seen, kept, t, *rest)

    monkeypatch.setattr(kind, "decode_words", staticmethod(watched))
    # pieces are decoded as far as they are read; columns beyond the sensor are damage, which these words are
    ev = nvsdata.read(path, sensor_size=(32_767, 720), strict=False)
    check(ev, (32_767, 720))
    assert len(rooms) == 4
    assert len(ev) > 0


@every_kind
@pytest.mark.parametrize("what", ["whole", "window"])
def test_a_file_written_to_within_a_read_is_an_error(tmp_path, kind, what, monkeypatch):
    path, _ = long_file(tmp_path, kind)
    recording = nvsdata.open(path, sensor_size=SIZE)
    if what == "window":
        recording.read(1_000_000, 1_500_000)
        recording._whole = None

    def write_last(raw, at):
        with path.open("r+b") as other:
            other.seek(-1, os.SEEK_END)
            other.write(b"\1")
        # a time of its own, however coarse the file system's clock is
        os.utime(path, ns=(0, 10**18))

    changes(monkeypatch, write_last, 0)
    with pytest.raises(FormatError, match="was changed after it was opened") as caught:
        recording.read(*((2_000_000, 2_500_000) if what == "window" else ()))
    assert str(path) in str(caught.value)


@every_kind
@pytest.mark.parametrize("stated", [True, False])
def test_other_bytes_in_a_later_read_give_valid_events_or_an_error(tmp_path, kind, stated, monkeypatch):
    """The change comes within the resolution of the file's times, so that nothing else shows it."""
    path, _ = long_file(tmp_path, kind)
    rng = np.random.default_rng(0)

    def reverse(raw, at):
        # records in the other order: fine values, in the wrong places
        rows = raw[: raw.size // RECORDS[kind] * RECORDS[kind]].reshape(-1, RECORDS[kind])
        rows[:] = rows[::-1].copy()

    def scatter(raw, at):
        raw[rng.integers(0, raw.size, 1 + raw.size // 50)] = rng.integers(0, 256, 1 + raw.size // 50)

    for change in (reverse, scatter):
        for after in (0, 1, 2):
            with monkeypatch.context() as patch:
                recording = nvsdata.open(path, sensor_size=SIZE if stated else None)
                recording.read(1_000_000, 1_100_000)
                recording._whole = None
                changes(patch, change, after)
                for window in ((2_000_000, 2_300_000), (0, 3_999_000), ()):
                    with suppress(FormatError):
                        check(recording.read(*window), recording.sensor_size)


def test_a_journal_that_is_reset_in_a_later_pass_is_an_error(tmp_path, monkeypatch):
    """One without a reset is read twice; a reset in the second pass would let times fall."""
    path = tmp_path / "a.davis"
    words = [0x8000 | 500, 0x2001, 0x8000 | 600, 0x2002]
    path.write_bytes(file.header(DavisDecoder(240, 180, steady=True), None, {}) + np.array(words, "<u2").tobytes())
    assert nvsdata.read(path).t.tolist() == [500, 600]
    blocks = file.StreamRecording._blocks
    passes = []

    def reset_later(self):
        passes.append(1)
        for block in blocks(self):
            yield block if len(passes) == 1 else block[:4] + np.array([1, 0x8003, 0x2002], "<u2").tobytes()

    monkeypatch.setattr(file.StreamRecording, "_blocks", reset_later)
    with pytest.raises(FormatError, match=r"a\.davis: was changed while it was read"):
        nvsdata.read(path)


def stored(folder, n, compress):
    """A store of one recording of `n` events, the recording, opened, and its events."""
    t = np.arange(n) * 10
    ev = Events(t, t % 101, t % 90, t // 30 % 2, SIZE)
    (folder / "data/a").mkdir(parents=True)
    nvsdata.write(ev, folder / "data/a/0.h5")
    pack(EventFolder(folder / "data"), folder / "a.h5", compress=compress)
    return folder / "a.h5", EventFolder(folder / "a.h5").recording(0), ev


@pytest.mark.parametrize("compress", [False, True])
def test_a_store_that_is_changed_meanwhile(tmp_path, compress):
    """Blocks with their own checksums, but not those that were read with the head; and a file that is cut."""
    path, recording, ev = stored(tmp_path, 200_000, compress)
    sound = path.read_bytes()
    assert recording.read(1_000, 20_000) == ev.window(1_000, 20_000)

    def reverse(raw):
        return raw[::-1]

    put_block(path, 0, 1, reverse)
    with pytest.raises(FormatError, match=r"a/0\.h5.* its events fail their checksum: the store is damaged"):
        recording.read()
    # other blocks are fine
    assert recording.read(1_000, 20_000) == ev.window(1_000, 20_000)
    path.write_bytes(sound)
    assert recording.read() == ev
    begin, end = block_places(path, 0)[1:3]
    os.truncate(path, (begin + end) // 2)
    with pytest.raises(FormatError, match="truncated while it was read"):
        recording.read()
    assert recording.read(1_000, 20_000) == ev.window(1_000, 20_000)
    os.truncate(path, 0)
    with pytest.raises(FormatError, match="truncated while it was read"):
        recording.read(1_000_000, 1_000_010)


@pytest.mark.parametrize("compress", [False, True])
def test_a_store_that_is_replaced_meanwhile_is_read_as_it_was(tmp_path, compress):
    path, recording, ev = stored(tmp_path, 200_000, compress)
    other = Events([5], [1], [1], [1], SIZE)
    nvsdata.write(other, tmp_path / "data/a/0.h5")
    pack(EventFolder(tmp_path / "data"), path, compress=compress, overwrite=True)
    assert recording.read() == ev
    assert EventFolder(path).recording(0).read() == other


@pytest.mark.parametrize("compress", [False, True])
def test_other_bytes_in_a_later_read_of_a_store_are_an_error(tmp_path, compress, monkeypatch):
    _, recording, ev = stored(tmp_path, 200_000, compress)
    rng = np.random.default_rng(0)

    def flipped(descriptor, path, at, target):
        read(descriptor, path, at, target)
        raw = target.reshape(-1).view(np.uint8)
        raw[rng.integers(0, raw.size)] ^= 1 << rng.integers(0, 8)

    read = store_file.read_into
    monkeypatch.setattr(store_file, "read_into", flipped)
    for window in ((1_999_000, 1_999_990), (0, 1_000_000), ()) * 20:
        with pytest.raises(FormatError, match="its events fail their checksum"):
            recording.read(*window)
    monkeypatch.undo()
    assert recording.read() == ev


@pytest.mark.parametrize("what", ["whole", "window"])
def test_a_compressed_column_that_becomes_shorter_is_an_error(tmp_path, what, monkeypatch):
    t = np.arange(3_000) * 10
    path = tmp_path / "a.h5"
    nvsdata.write(Events(t, t % 100, t % 90, t % 2, SIZE), path, format="hdf5-gzip")
    recording = nvsdata.open(path)
    read = Chunks.read

    def shorter(self, lo, hi):
        return read(self, lo, hi if self.dataset.name != "/events/x" else min(hi, 1_000))

    monkeypatch.setattr(Chunks, "read", shorter)
    with pytest.raises(FormatError, match="/events/x was changed while it was read"):
        recording.read(*((15_000, 20_000) if what == "window" else ()))
