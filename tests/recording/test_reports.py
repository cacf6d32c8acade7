"""Reports of recordings, without a USB camera."""

import errno
import signal
import sys
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest

from nvsdata import Events
from nvsdata.common.signals import Ended
from nvsdata.data.samples import Inertial, Piece
from nvsdata.recording import capture
from nvsdata.recording.camera import CameraError, check_camera
from nvsdata.recording.capture import (
    RESERVE,
    RecordingReport,
    _pieces,
    check_format,
    record,
    stopped_by_interrupt,
    switching_fast,
)
from nvsdata.recording.recorder import Recorder
from nvsdata.recording.session import summary


@pytest.mark.parametrize(
    ("given", "result"),
    [
        ({}, "not kept: 0 events in 0.00 s; the time was up"),
        (
            {"path": "a.h5", "events": 1_234_567, "seconds": 1.005, "frames": 1_000, "ended": "it was stopped"},
            "a.h5: 1,234,567 events in 1.00 s; it was stopped\n1,000 frames",
        ),
        (
            {"lost": 1_000, "dropped": 2_000},
            "not kept: 0 events in 0.00 s; the time was up\n"
            "1,000 bytes came faster than they could be decoded and written, and are lost\n"
            "the camera dropped 2,000 events: reduce the event rate, or use a faster computer",
        ),
        (
            {"error_counts": {"a": 0, "b": 1, "c": 12}, "temperature": 0.0, "dropped": 0},
            "not kept: 0 events in 0.00 s; the time was up\n"
            "faults in the stream: b 1, c 12\nthe camera's temperature is 0.0 °C",
        ),
    ],
)
def test_a_report_in_a_few_lines(given, result):
    assert summary(RecordingReport(**{"path": None} | given)) == result


@pytest.mark.parametrize(
    ("given", "whole", "failure"),
    [
        ({}, True, None),
        ({"ended": "it was stopped", "dropped": 0}, True, None),
        ({"lost": 1}, False, None),
        ({"error_counts": {"usb_errors": 1}}, False, None),
        ({"error_counts": {"usb_errors": 0, "odd_bytes": 3}}, True, None),
        ({"dropped": 1}, False, None),
        ({"ended": "gone"}, False, "gone"),
        ({"ended": "the disk is full"}, False, "No space left on device"),
        ({"ended": "the disk is full (File too large)"}, False, "No space left on device"),
    ],
)
def test_what_a_whole_recording_is(given, whole, failure):
    report = RecordingReport("a.h5", **given)
    assert report.whole is whole
    error = report.failure
    assert (error and (error.strerror or str(error))) == failure
    if failure == "gone":
        assert isinstance(error, CameraError)
    elif failure:
        assert (error.errno, error.filename) == (errno.ENOSPC, "a.h5")


def test_formats_and_places(tmp_path):
    frames = SimpleNamespace(frames=True)
    assert check_format(tmp_path / "a.h5", frames) is True
    assert check_format(tmp_path / "a.txt", None) is False
    with pytest.raises(ValueError, match=r"^\.txt files can't store frames"):
        check_format(tmp_path / "a.txt", frames)


def events_at(*t):
    n = len(t)
    return Events(t, [0] * n, [0] * n, [1] * n, (4, 3))


def piece(*t, frames=(), samples=0, **about):
    inertial = (
        Inertial.empty() if not samples else Inertial(np.arange(samples), *np.zeros((2, samples, 3)), np.zeros(samples))
    )
    return Piece.of_camera(events_at(*t), list(frames), inertial, about)


class Decoding:
    """A decoder of what a test says."""

    width, height = 4, 3

    def __init__(self, *found):
        self.found, self.error_counts, self.last = found, {"x": 0}, "not asked"

    def decoded(self, blocks, last):
        self.last = last
        for n, (one, triggers) in enumerate(self.found, 1):
            self.error_counts = {"x": n}
            yield one, np.array(triggers, np.int64)
        assert list(blocks) == []


class Blocks(SimpleNamespace):
    """A reader from which nothing comes."""

    def __init__(self):
        super().__init__(odd_bytes=3, received=10, lost=2, ended=None)

    def take(self):
        return b""

    def end(self, why):
        self.ended = why


def test_what_a_recording_counts(tmp_path):
    seen, reader = [], Blocks()
    report = RecordingReport(None, about={"camera": "x"})
    decoder = Decoding(
        (piece(5, 2_500_000, frames="ab", temperature=30.0), [7, 9]),
        (piece(), []),
        (piece(samples=3), [11]),
        (piece(8, frames="c", samples=1, temperature=31.0), []),
    )
    first, *found = list(
        _pieces(SimpleNamespace(faults=2), decoder, reader, 99, report, lambda *given: seen.append(len(given[1])))
    )
    assert (len(first), first.sensor_size, first.about) == (0, (4, 3), {"camera": "x"})
    assert [len(one) for one in found] == seen == [2, 0, 0, 1]
    assert (report.events, report.seconds, report.frames, report.samples) == (3, 2.5, 3, 4)
    assert (report.received, report.lost, report.triggers, report.temperature) == (10, 2, [7, 9, 11], 31.0)
    assert report.error_counts == {"x": 4, "odd_bytes": 3, "usb_errors": 2}
    assert (decoder.last, reader.ended) == (99, None)


@pytest.mark.parametrize(("free", "ended"), [(RESERVE, None), (RESERVE - 1, "the disk is full")])
def test_64_mb_of_the_disk_stay_free(tmp_path, monkeypatch, free, ended):
    monkeypatch.setattr(capture.shutil, "disk_usage", lambda place: SimpleNamespace(free=free))
    for path, result in ((tmp_path / "a.h5", ended), (None, None)):
        reader = Blocks()
        list(_pieces(None, Decoding((piece(1), [])), reader, None, RecordingReport(path), lambda *_: None))
        assert reader.ended == result
    assert RESERVE == 67_108_864


class Simple:
    """A camera from which nothing comes, and that counts what it drops."""

    unit, silence = 2, None
    facts = SimpleNamespace(name="x", serial="1", width=4, height=3)

    def __init__(self, *dropped, found=()):
        self.drops, self.found, self.calls = list(dropped), found, []

    def __getattr__(self, name):
        if name not in ("configure", "start", "reset_time", "stop", "end_reading", "close"):
            raise AttributeError(name)
        return lambda *given: self.calls.append((name, *given))

    def read(self, timeout=100):
        return b""

    def dropped(self):
        found = self.drops.pop(0)
        if isinstance(found, Exception):
            raise found
        return found

    def decoder(self):
        self.decoding = Decoding(*self.found)
        return self.decoding

    def about(self):
        return {"camera": "x"}

    def journal_head(self, decoder, last, about):
        self.head = (last, about["camera"])
        return b"head"


@pytest.mark.parametrize(
    ("dropped", "result"),
    [((5, 9), 4), ((5, 5), 0), ((None, None), None), ((5, None), None), ((5, CameraError("")), None)],
)
def test_what_the_camera_dropped_meanwhile(dropped, result):
    camera, stop = Simple(*dropped), Event()
    stop.set()
    report = record(camera, None, "settings", stop=stop)
    assert report.dropped == result
    assert report.ended == "it was stopped"
    assert camera.calls[:2] == [("configure", "settings"), ("start",)]
    assert sorted(name for name, *_ in camera.calls[2:]) == ["end_reading", "reset_time", "stop"]
    assert camera.decoding.last is None
    assert not hasattr(camera, "head")


def test_a_recording_to_a_file_has_a_journal_and_an_end(tmp_path):
    kept = []

    def watch(report, events):
        kept.extend(path.name for path in tmp_path.iterdir() if path.suffix == ".davis")

    for journaled, names in ((True, ["a.h5.davis"]), (False, [])):
        kept.clear()
        stop = Event()
        stop.set()
        camera = Simple(0, 0, found=[(piece(5), [])])
        report = record(camera, tmp_path / "a.h5", seconds=0.2500004, stop=stop, watch=watch, journaled=journaled)
        assert (kept, report.events) == (names, 1)
        assert camera.decoding.last == 250_000
        assert getattr(camera, "head", None) == ((250_000, "x") if journaled else None)
        assert [path.name for path in tmp_path.iterdir()] == ["a.h5"]


def test_what_is_no_camera():
    camera = Simple(0)
    check_camera(camera)
    with pytest.raises(TypeError, match=r"^object is not a camera: it misses unit, silence, facts, configure, start, "):
        check_camera(object())
    with pytest.raises(TypeError, match=r"^SimpleNamespace is not a camera: it misses [a-z_, ]+, close \(see nvsdata"):
        check_camera(SimpleNamespace(unit=2, silence=None))


@pytest.mark.parametrize(("number", "second"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, Ended)])
def test_the_first_signal_asks_and_the_second_interrupts(number, second):
    before = [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
    with stopped_by_interrupt() as stop:
        assert not stop.is_set()
        signal.raise_signal(number)
        assert stop.is_set()
        with pytest.raises(second):
            signal.raise_signal(number)
    assert [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)] == before


def test_signals_that_are_ignored_stay_so():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stopped_by_interrupt() as stop:
            signal.raise_signal(signal.SIGHUP)
            assert not stop.is_set()
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_threads_are_as_they_were_afterwards():
    before = sys.getswitchinterval()
    with switching_fast():
        assert sys.getswitchinterval() == pytest.approx(2e-4)
    assert sys.getswitchinterval() == before


@pytest.mark.parametrize("found", [RecordingReport(None), RecordingReport(None, ended="gone"), ValueError("no")])
def test_a_recorder_tells_how_it_ended(monkeypatch, found):
    how = {}

    def recorded(camera, path, settings, **given):
        how.update(given, path=path)
        given["watch"](RecordingReport(None), events_at())
        assert recorder.begun.is_set()
        assert not recorder.ended.is_set()
        recorder.check()
        if isinstance(found, Exception):
            raise found
        return found

    monkeypatch.setattr("nvsdata.recording.recorder.record", recorded)
    watched = []
    recorder = Recorder("camera", "a.h5", None, seconds=3, watch=lambda *given: watched.append(given), journaled=False)
    assert not recorder.begun.is_set()
    assert recorder.daemon is True
    recorder.run()
    assert (how["seconds"], how["journaled"], how["path"], len(watched)) == (3, False, "a.h5", 1)
    assert recorder.ended.is_set()
    assert not how["stop"].is_set()
    if getattr(found, "whole", False):
        recorder.check()
    else:
        with pytest.raises((ValueError, CameraError), match=r"^(no|gone)$"):
            recorder.check()
