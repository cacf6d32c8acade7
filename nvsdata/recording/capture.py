"""From a camera to a file: a thread that does nothing but read, one that decodes, and the writer."""

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
from pathlib import Path
from threading import Condition, Event, Thread
from typing import Any

import numpy as np

from nvsdata import formats
from nvsdata.events import Events
from nvsdata.kernels.order import never_falls
from nvsdata.recording.davis import CameraError, Davis
from nvsdata.recording.registers import Settings
from nvsdata.recording.sync import host_time
from nvsdata.threads import ahead

ROOM = 64 << 20  # bytes that may wait to be decoded
PIECE = 1 << 20  # bytes decoded at once, if so many wait
GATHER = 0.03  # s to wait for more, if little waits
SILENCE = 5.0  # s without a byte after which a camera counts as stalled: it sends wraps of its clock 30 times a second
RESERVE = 64 << 20  # bytes of disk that are left free: what the writer still holds must find room
TAIL = 0.3  # s to wait for what is on its way when the camera was stopped
# how long a thread may keep Python's lock while another waits: at 5 ms, the default, the camera's buffer runs over
SWITCH = 2e-4
TIME_UP, STOPPED, DISK_FULL = "the time was up", "it was stopped", "the disk is full"
RESET, RISING, PULSE = 1, 2, 4  # special events
WRAP = 1 << 15  # µs that the camera's clock counts between wraps


@dataclass
class Report:
    """How a recording went.

    `dropped` are events that the camera dropped (None if it doesn't count), `lost` bytes that came and found no room,
    `ended` why it ended, `complaints` the decoder's, `temperature` of the inertial unit (°C), None without one,
    `triggers` the times (µs) of pulses and rising edges at the external input, `zero` the host's time (µs) at which the
    camera's time began.
    """

    path: Path | None
    events: int = 0
    seconds: float = 0.0
    received: int = 0
    lost: int = 0
    dropped: int | None = None
    ended: str = TIME_UP
    complaints: dict[str, int] = field(default_factory=dict)
    temperature: float | None = None
    triggers: list[int] = field(default_factory=list)
    zero: float = 0.0

    @property
    def failure(self) -> OSError | None:
        """What ended the recording, unless the time was up or it was stopped: CameraError, or a disk that is full."""
        if self.ended in (TIME_UP, STOPPED):
            return None
        if self.ended == DISK_FULL:
            return OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path))
        return CameraError(self.ended)

    @property
    def whole(self) -> bool:
        """Whether nothing was lost on the way."""
        return not self.lost and not self.dropped and self.failure is None


def record(
    camera: Davis,
    path: str | Path | None,
    settings: Settings | None = None,
    *,
    seconds: float | None = None,
    stop: Event | None = None,
    watch: Callable[[Report, Events], None] = lambda report, events: None,
) -> Report:
    """Record events to a file, in the format of its extension, until `seconds` are over or `stop` is set.

    With None for the file, they are only given to `watch`.

    Times count from the reset of the camera's clock at the start. A camera that is unplugged, or sends nothing
    for 5 s, and a disk with less than 64 MB left end the recording; what came until then is in the file, and
    `Report.ended` says so. `watch` is called with the events of each block, from another thread. CameraError if the
    camera can't be configured or started, OSError if the file can't be written.
    """
    report = Report(None if path is None else Path(path))
    if path is not None:
        formats.writer_of(path)
    camera.configure(settings or Settings())
    before = camera.dropped()
    with switching_fast():
        camera.start()
        line = _Line(camera, seconds, stop or Event())
        line.start()
        try:
            camera.reset_time()
            report.zero = host_time()
            pieces = _pieces(camera, line, seconds, report, watch)
            if path is None:
                deque(pieces, maxlen=0)
            else:
                formats.write(ahead(pieces), path)
        finally:
            line.finish()
    report.received, report.lost, report.ended = line.received, line.lost, line.ended
    if not line.gone:
        with suppress(CameraError):
            after = camera.dropped()
            report.dropped = None if after is None or before is None else after - before
    return report


@contextmanager
def stopped_by_interrupt() -> Iterator[Event]:
    """An event that Ctrl-C sets, in place of raising KeyboardInterrupt; a second Ctrl-C raises it."""
    stop = Event()

    def asked(number: int, frame: Any) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    before = signal.signal(signal.SIGINT, asked)
    try:
        yield stop
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def switching_fast() -> Iterator[None]:
    """While the block runs, threads hand Python's lock over quickly."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH)
    try:
        yield
    finally:
        sys.setswitchinterval(before)


class _Line(Thread):
    """Reads, and keeps what it read until it is taken; `ROOM` bytes at most, what comes beyond is counted."""

    def __init__(self, camera: Davis, seconds: float | None, stop: Event) -> None:
        super().__init__(name="nvsdata-reader", daemon=True)
        self.camera, self.seconds, self.stop = camera, seconds, stop
        self.received = self.lost = 0
        self.ended = TIME_UP
        self.gone = False
        self._blocks: deque[bytes] = deque()
        self._waiting = 0
        self._change = Condition()
        self._over = False

    def run(self) -> None:
        try:
            self._read()
            self.camera.stop()
            self._read_tail()
        except CameraError as error:
            self.ended, self.gone = str(error), True
        finally:
            self.camera.end_reading()
            with self._change:
                self._over = True
                self._change.notify()

    def _read(self) -> None:
        began = heard = time.monotonic()
        while True:
            block = self.camera.read()
            now = time.monotonic()
            if block:
                heard = now
                self._keep(block)
            elif now - heard > SILENCE:
                self.ended = f"the camera sent nothing for {SILENCE:.0f} s"
                return
            if self.stop.is_set():
                self.ended = STOPPED
                return
            if self.seconds is not None and now - began > self.seconds + TAIL:
                return

    def _read_tail(self) -> None:
        until, silent = time.monotonic() + TAIL, 0
        while silent < 2 and time.monotonic() < until:
            block = self.camera.read(20)
            silent = 0 if block else silent + 1
            if block:
                self._keep(block)

    def _keep(self, block: bytes) -> None:
        with self._change:
            self.received += len(block)
            if self._waiting + len(block) > ROOM:
                self.lost += len(block)
                return
            self._blocks.append(block)
            self._waiting += len(block)
            self._change.notify()

    def take(self) -> bytes:
        """What waits, `PIECE` at most; empty at the end."""
        if self._waiting < PIECE // 4 and not self._over:
            # many small blocks at once cost less than one by one
            time.sleep(GATHER)
        with self._change:
            while not self._blocks and not self._over:
                self._change.wait(0.5)
            taken: list[bytes] = []
            size = 0
            while self._blocks and size < PIECE:
                taken.append(self._blocks.popleft())
                size += len(taken[-1])
            self._waiting -= size
        return taken[0] if len(taken) == 1 else b"".join(taken)

    def end(self, why: str) -> None:
        """Stop reading, and say why."""
        self.finish()
        self.ended = why

    def finish(self) -> None:
        """End reading, whatever for, and wait until the camera has been stopped."""
        self.stop.set()
        self.join()


def _pieces(
    camera: Davis,
    line: _Line,
    seconds: float | None,
    report: Report,
    watch: Callable[[Report, Events], None],
) -> Iterator[Events]:
    """Events as they come, from the reset of the clock on, until `seconds` of the camera's time."""
    decoder = camera.decoder()
    size = (camera.facts.width, camera.facts.height)
    last = None if seconds is None else round(seconds * 1e6)
    begun = False
    clock = _Clock()
    yield Events.empty(size)
    while block := line.take():
        if report.path is not None and shutil.disk_usage(report.path.parent).free < RESERVE:
            line.end(DISK_FULL)
            return
        events = decoder.feed(block)
        specials = decoder.specials
        resets = np.flatnonzero(specials.kind == RESET)
        first, after = (int(specials.before[resets[-1]]), resets[-1] + 1) if resets.size else (0, 0)
        begun = begun or bool(resets.size)
        if decoder.samples.t.size:
            report.temperature = float(decoder.samples.temperature[-1])
        if not begun:
            continue
        clock.mend(events.t[first:], anew=bool(resets.size))
        stop = len(events) if last is None else first + int(np.searchsorted(events.t[first:], last))
        report.events += stop - first
        if stop > first:
            report.seconds = max(report.seconds, int(events.t[stop - 1]) / 1e6)
        report.complaints = decoder.complaints | {"lost_wraps": clock.lost}
        report.received, report.lost = line.received, line.lost
        kinds, times = specials.kind[after:], specials.t[after:]
        wanted = ((kinds == RISING) | (kinds == PULSE)) & (times < (np.inf if last is None else last))
        report.triggers += times[wanted].tolist()
        piece = Events.trusted(events.columns.at(slice(first, stop)), size, 0)
        watch(report, piece)
        yield piece


class _Clock:
    """Keeps times from falling where words of the stream were lost: a time that falls is of a wrap that didn't come."""

    def __init__(self) -> None:
        self.lost = 0
        self._shift = self._last = 0

    def mend(self, t: np.ndarray, *, anew: bool) -> None:
        """Put the next times right, in place; `anew` if the camera's time was reset before them."""
        if anew:
            self._shift = self._last = 0
        if t.size == 0:
            return
        if self._shift:
            t += self._shift
        if t[0] >= self._last and never_falls(t):
            self._last = int(t[-1])
            return
        for at in np.flatnonzero(np.diff(t, prepend=self._last) < 0):
            before = t[at - 1] if at else self._last
            wraps = -((t[at] - before) // WRAP)
            self.lost += int(wraps)
            self._shift += int(wraps) * WRAP
            t[at:] += wraps * WRAP
        self._last = int(t[-1])
