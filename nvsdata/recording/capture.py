"""Recording from a camera to a file: one thread decodes the stream, another one writes the events."""

from __future__ import annotations

import errno
import os
import shutil
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from threading import Event
from typing import Any

from nvsdata import formats
from nvsdata.common.locks import check_place
from nvsdata.common.prefetch import prefetch
from nvsdata.common.signals import ENDING, Ended
from nvsdata.data.events import Events
from nvsdata.data.samples import Piece
from nvsdata.recording.camera import Camera, CameraError, StreamDecoder, check_camera, host_time
from nvsdata.recording.journal import StreamJournal, check_finished, left_over_message
from nvsdata.recording.pipeline import DISK_FULL, STOPPED, TIME_UP, CameraReader

# s within which the reset of the clock must be in the stream, and the number of times that it is requested
RESET_WAIT, RESETS = 1.0, 2
NO_RESET = "the camera doesn't mark the reset of its clock: plug it in again"
RESERVE = 64 << 20  # bytes of the disk that stay free, for events that are still to be written
# s for which a thread may keep Python's lock while another waits: at 5 ms, the default, the camera's buffer overflows
SWITCH = 2e-4


@dataclass
class RecordingReport:
    """Result of a recording.

    Args:
        path: The file, None if nothing was written.
        events: Number of events.
        seconds: Time of the last event in s.
        received: Number of bytes from the camera.
        lost: Number of bytes that were dropped because they came faster than they were written.
        dropped: Number of events that the camera dropped, None if the camera doesn't count them.
        ended: Reason for the end of the recording.
        error_counts: Number of faults of the stream, by name.
        temperature: Temperature of the inertial unit (°C), None without one.
        triggers: Times (µs) of pulses and rising edges at the external input.
        zero: The host's time (µs) at which the camera's time began.
        frames: Number of frames.
        samples: Number of inertial samples.
        about: Metadata of the camera, as in `Recording.about`.
    """

    path: Path | None
    events: int = 0
    seconds: float = 0.0
    received: int = 0
    lost: int = 0
    dropped: int | None = None
    ended: str = TIME_UP
    error_counts: dict[str, int] = field(default_factory=dict)
    temperature: float | None = None
    triggers: list[int] = field(default_factory=list)
    zero: float = 0.0
    frames: int = 0
    samples: int = 0
    about: dict[str, Any] = field(default_factory=dict)

    @property
    def failure(self) -> OSError | None:
        """The error that ended the recording, a CameraError or a full disk; None if it ended as requested."""
        if self.ended in (TIME_UP, STOPPED):
            return None
        if self.ended.startswith(DISK_FULL):
            return OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path))
        return CameraError(self.ended)

    @property
    def whole(self) -> bool:
        """True if no data were lost, and the recording ended as requested (by `seconds` or `stop`)."""
        faulty = self.lost or self.dropped or self.error_counts.get("usb_errors")
        return not faulty and self.failure is None


class Unfinished(OSError):
    """The file of a recording couldn't be written; the message names the journal with its data."""


def record(
    camera: Camera,
    path: str | Path | None,
    settings: Any = None,
    *,
    seconds: float | None = None,
    stop: Event | None = None,
    watch: Callable[[RecordingReport, Events], None] = lambda report, events: None,
    journaled: bool = True,
) -> RecordingReport:
    """Record to a file, in the format of its extension, until `seconds` are over or `stop` is set.

    Times are relative to the reset of the camera's clock at the start. The recording also ends when the camera is
    unplugged or sends nothing for 5 s, and when the disk has less than 64 MB left. The file then has all events up to
    that moment, and `RecordingReport.ended` is the reason. The file appears only when it is complete.

    Args:
        camera: Any object that has the members of `camera.Camera`.
        path: The file; with None, events are only passed to `watch`.
        settings: Settings that the camera's `configure` takes (default: the camera's defaults).
        seconds: Duration of the recording in s (default: until stopped).
        stop: `threading.Event` that ends the recording when it is set (default: none).
        watch: Function that is called with the report so far and the events of each block, in another thread.
        journaled: Copy the stream to FILE.davis, which `nvsdata.open` reads, until the file is complete. The copy
            stays if the file can't be written (default True).

    Returns:
        The report of the recording.

    Raises:
        CameraError: The camera can't be configured or started, or doesn't mark the reset of its clock.
        TypeError: The object isn't a camera.
        ValueError: The settings request frames, and the format can't store them.
        OSError: The disk has less than 64 MB left.
        FileExistsError: There is a journal of that file already.
        Unfinished: The file can't be written.
    """
    check_camera(camera)
    report = RecordingReport(None if path is None else Path(path))
    if report.path is not None:
        check_format(report.path, settings)
        check_place(report.path)
        check_room(report.path)
        check_finished(report.path)
    camera.configure(settings)
    before = camera.dropped()
    decoder, last = camera.decoder(), None if seconds is None else round(seconds * 1e6)
    journal: StreamJournal | None = None
    with switching_fast():
        camera.start()
        reader = CameraReader(camera, seconds, stop or Event())
        reader.start()
        try:
            reader.begin()
            camera.reset_time()
            report.zero = host_time()
            report.about = camera.about() | {"started": datetime.now(UTC).isoformat(timespec="microseconds")}
            head = camera.journal_head(decoder, last, report.about) if report.path is not None and journaled else None
            if report.path is not None and head is not None:
                journal = StreamJournal(report.path, head)
            reader.keep(journal)
            pieces = _pieces(camera, decoder, reader, last, report, watch)
            if path is None:
                deque(pieces, maxlen=0)
            else:
                formats.write(prefetch(pieces), path)
        except Exception as error:
            reader.finish()
            if journal is not None and journal.size:
                raise Unfinished(f"{path} couldn't be written ({error}); {left_over_message(journal.path)}") from error
            raise
        else:
            reader.finish()
            if journal is not None:
                journal.remove()
        finally:
            reader.finish()
            if journal is not None:
                journal.close()
    report.error_counts["usb_errors"] = getattr(camera, "faults", 0)
    report.received, report.lost, report.ended = reader.received, reader.lost, reader.ended
    if not reader.gone:
        with suppress(CameraError):
            after = camera.dropped()
            report.dropped = None if after is None or before is None else after - before
    return report


def check_room(path: Path) -> None:
    """Raise OSError if the disk of a file that is to be recorded has less than `RESERVE` bytes free."""
    if (free := shutil.disk_usage(path.parent).free) < RESERVE:
        reason = f"the disk has {free / 1e6:,.1f} MB left, and a recording needs at least {RESERVE / 1e6:.0f} MB"
        raise OSError(errno.ENOSPC, reason, str(path))


def check_format(path: Path, settings: Any) -> bool:
    """Return True if a file with this extension can store inertial samples.

    Raises:
        ValueError: nvsdata doesn't write such files, or the settings request frames and the format can't store them.
    """
    holds = formats.writer_of(path).holds_samples
    if getattr(settings, "frames", False) and not holds:
        raise ValueError(f"{path.suffix} files can't store frames: record to .h5, .aedat or .aedat4, or without frames")
    return holds


@contextmanager
def stopped_by_interrupt() -> Iterator[Event]:
    """Yield a `threading.Event` that Ctrl-C, SIGTERM and SIGHUP set.

    A second signal raises KeyboardInterrupt or `Ended`.
    """
    stop = Event()

    def on_signal(number: int, frame: Any) -> None:
        if stop.is_set():
            raise KeyboardInterrupt if number == signal.SIGINT else Ended(number)
        stop.set()

    # a signal that is ignored (nohup) stays ignored
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, *ENDING)}
    mine = [number for number, handler in before.items() if handler is not signal.SIG_IGN]
    for number in mine:
        signal.signal(number, on_signal)
    try:
        yield stop
    finally:
        for number in mine:
            signal.signal(number, before[number])


@contextmanager
def switching_fast() -> Iterator[None]:
    """Reduce the time for which a thread may keep Python's lock, while the block runs."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH)
    try:
        yield
    finally:
        sys.setswitchinterval(before)


def _blocks(camera: Camera, decoder: StreamDecoder, reader: CameraReader, report: RecordingReport) -> Iterator[bytes]:
    """Yield the blocks that were read; if the reset of the clock isn't among them, request it again.

    Raises:
        CameraError: The reset is still missing after that.
    """
    requested, times = time.monotonic(), 1
    while block := reader.take():
        yield block
        if getattr(decoder, "begun", True) or time.monotonic() - requested < RESET_WAIT:
            continue
        if times == RESETS:
            raise CameraError(NO_RESET)
        camera.reset_time()
        reader.delay(time.monotonic() - requested)
        report.zero, requested, times = host_time(), time.monotonic(), times + 1
    if reader.received and not getattr(decoder, "begun", True):
        raise CameraError(NO_RESET)


def _pieces(
    camera: Camera,
    decoder: StreamDecoder,
    reader: CameraReader,
    last: int | None,
    report: RecordingReport,
    watch: Callable[[RecordingReport, Events], None],
) -> Iterator[Events]:
    """Yield the camera's events, from the reset of its clock until `last` µs of its time."""
    yield Piece.of_camera(Events.empty((decoder.width, decoder.height)), about=report.about)
    for piece, triggers in decoder.decoded(_blocks(camera, decoder, reader, report), last):
        report.events += len(piece)
        if len(piece):
            report.seconds = max(report.seconds, int(piece.t[-1]) / 1e6)
        report.frames += len(piece.frames)
        report.samples += piece.inertial.t.size
        report.temperature = piece.about.get("temperature", report.temperature)
        usb = getattr(camera, "faults", 0)
        report.error_counts = decoder.error_counts | {"odd_bytes": reader.odd_bytes, "usb_errors": usb}
        report.received, report.lost = reader.received, reader.lost
        report.triggers += triggers.tolist()
        watch(report, piece)
        yield piece
        if report.path is not None and shutil.disk_usage(report.path.parent).free < RESERVE:
            # the reserve has room for the events that were read
            reader.end(DISK_FULL)
