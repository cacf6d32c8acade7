"""Bytes between reading and decoding, with a scripted camera and a stopped clock."""

from threading import Event

import pytest

from nvsdata.recording import pipeline
from nvsdata.recording.camera import CameraError
from nvsdata.recording.pipeline import CameraReader, Waiting


def waiting(*sizes):
    blocks = Waiting()
    for n, size in enumerate(sizes):
        blocks.put(bytes([n + 1]) * size)
    return blocks


@pytest.fixture
def pauses(monkeypatch):
    """How long it was waited each time."""
    found = []
    monkeypatch.setattr(pipeline.time, "sleep", found.append)
    return found


def test_blocks_are_taken_together_until_there_are_enough(pauses, monkeypatch):
    monkeypatch.setattr(pipeline, "PIECE", 100)
    blocks = waiting(10, 40, 49, 1, 5, 120, 7)
    blocks.end()
    assert blocks.size == 232
    taken = [blocks.take() for _ in range(5)]
    assert taken[0] == b"\1" * 10 + b"\2" * 40 + b"\3" * 49 + b"\4"
    assert [len(block) for block in taken] == [100, 125, 7, 0, 0]
    assert blocks.size == 0
    assert pauses == []


@pytest.mark.parametrize(("size", "ended", "waits"), [(24, False, 1), (25, False, 0), (24, True, 0), (26, False, 0)])
def test_more_is_waited_for_where_little_waits(pauses, monkeypatch, size, ended, waits):
    monkeypatch.setattr(pipeline, "PIECE", 100)
    blocks = waiting(size)
    if ended:
        blocks.end()
    assert len(blocks.take()) == size
    assert pauses == [0.03] * waits
    assert blocks.size == 0


class Scripted:
    """A camera that gives blocks one by one, then nothing; each read takes a while by the clock."""

    unit, silence = 2, 5.0

    def __init__(self, blocks=(), takes=0.1, after=None):
        self.blocks, self.takes, self.after = list(blocks), takes, after
        self.now, self.calls, self.timeouts = 50.0, [], []

    def monotonic(self):
        return self.now

    def read(self, timeout=100):
        self.timeouts.append(timeout)
        self.now += self.takes
        if self.blocks:
            return self.blocks.pop(0)
        if self.after is not None:
            raise self.after
        return b""

    def stop(self):
        self.calls.append("stop")
        self.stopped = len(self.timeouts)

    def end_reading(self):
        self.calls.append("end")


def read(camera, monkeypatch, seconds=None, stop=None, begun=True):
    monkeypatch.setattr(pipeline.time, "monotonic", camera.monotonic)
    reader = CameraReader(camera, seconds, stop or Event())
    if begun:
        reader.begin()
    reader.keep(None)
    reader.run()
    assert camera.calls[-1] == "end"
    taken = b"".join(iter(reader.take, b""))
    return reader, taken


@pytest.mark.parametrize(("takes", "reads"), [(0.125, 11), (0.5, 3), (1.3, 2), (1.31, 1)])
def test_a_recording_lasts_as_long_as_asked_and_what_is_on_its_way(monkeypatch, takes, reads):
    """For 1 s and 0.3 s more; then it takes two reads without a byte to know that no more comes."""
    camera = Scripted([b"ab"] * reads, takes)
    reader, taken = read(camera, monkeypatch, seconds=1.0)
    assert (reader.ended, reader.gone) == ("the time was up", False)
    assert camera.stopped == reads
    assert camera.timeouts[:reads] == [100] * reads
    assert taken == b"ab" * reads


@pytest.mark.parametrize(
    ("tail", "reads"),
    [([], 2), ([b"cd"], 3), ([b"", b"cd", b""], 4), ([b"", b"", b"cd"], 2), ([b"cd", b"", b"ef"], 5)],
)
def test_what_comes_after_the_stop_is_read_until_nothing_comes_twice(monkeypatch, tail, reads):
    camera, stop = Scripted([b"ab", *tail], 0.01), Event()
    stop.set()
    reader, taken = read(camera, monkeypatch, stop=stop)
    assert reader.ended == "it was stopped"
    assert camera.timeouts == [100] + [20] * reads
    assert taken == b"ab" + b"".join(tail[:reads])


def test_a_camera_that_goes_on_sending_is_left_after_5_s(monkeypatch):
    camera, stop = Scripted([b"ab"] * 100, 1.0), Event()
    stop.set()
    _, taken = read(camera, monkeypatch, stop=stop)
    assert len(taken) == 2 * (1 + 5)


@pytest.mark.parametrize(("silence", "message"), [(5.0, "the camera sent nothing for 5 s"), (None, "the time was up")])
def test_a_camera_that_falls_silent(monkeypatch, silence, message):
    camera = Scripted([b"ab", b"cd"], 0.5)
    camera.silence = silence
    reader, taken = read(camera, monkeypatch, seconds=30)
    assert (reader.ended, taken) == (message, b"abcd")
    # more than 5 s after it last sent something
    assert camera.stopped == (2 + 11 if silence else 61)


@pytest.mark.parametrize(
    ("blocks", "silence", "result"),
    [
        (8, 5.0, "the time was up"),
        (7, 5.0, "the time was up"),
        (5, 5.0, "the camera sent nothing for the last 1.5 s"),
        (0, 5.0, "the camera sent nothing for the last 4.0 s"),
        (5, None, "the time was up"),
    ],
)
def test_a_camera_that_was_silent_at_the_end(monkeypatch, blocks, silence, result):
    camera = Scripted([b"ab"] * blocks, 0.5)
    camera.silence = silence
    reader, taken = read(camera, monkeypatch, seconds=3.5)
    assert (reader.ended, taken) == (result, b"ab" * blocks)


@pytest.mark.parametrize(
    ("error", "result"),
    [(CameraError("gone"), "gone"), (ValueError("odd"), "the camera failed (ValueError: odd)")],
)
def test_a_camera_that_fails(monkeypatch, error, result):
    reader, taken = read(Scripted([b"ab"], after=error), monkeypatch)
    assert (reader.ended, reader.gone, taken) == (result, True, b"ab")


def test_what_came_before_the_beginning_is_not_kept(monkeypatch):
    reader, taken = read(Scripted([b"ab", b"cd"]), monkeypatch, seconds=1, begun=False)
    assert (reader.received, reader.lost, taken) == (0, 0, b"")


def test_parts_of_words_are_dropped_and_counted(monkeypatch):
    camera = Scripted([b"abcd", b"efgABC", b"h", b"ijklmno"], 0.1)
    camera.unit = 4
    reader, taken = read(camera, monkeypatch, seconds=1)
    assert taken == b"abcdefgAijkl"
    assert (reader.odd_bytes, reader.received, reader.lost) == (3, 18, 0)


@pytest.mark.parametrize("journaled", [False, True])
def test_what_finds_no_room_is_lost(monkeypatch, journaled):
    monkeypatch.setattr(pipeline, "ROOM", 10)
    reader = CameraReader(Scripted(), None, Event())
    reader.begin()
    if not journaled:
        reader.keep(None)
    else:
        reader._kept.put(b"1234")
    for block in (b"abcd", b"ef", b"ghijkl", b"gh"):
        reader._add(block)
    # with a journal, what is in it and isn't taken waits, too
    assert (reader.received, reader.lost) == (14, 6 + 2 if journaled else 6)
    assert reader._read_out.size == (6 if journaled else 8)
    reader._add(b"ij")
    reader._add(b"kl")
    assert reader.lost == (12 if journaled else 8)
