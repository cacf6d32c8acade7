"""Threads between a camera and its decoder: one only reads the stream, the other writes it to a journal."""

from __future__ import annotations

import time
from queue import SimpleQueue
from threading import Event, Thread

from nvsdata.recording.camera import Camera, CameraError
from nvsdata.recording.journal import StreamJournal

ROOM = 64 << 20  # bytes that may wait to be written and decoded
PIECE = 1 << 20  # bytes from which waiting blocks are passed on as one
GATHER = 0.03  # s to wait for more, if few bytes wait
SILENT_END = 1.0  # s without a byte at the end, after which a camera that sends words of its clock counts as stalled
TAIL = 0.3  # s to wait for bytes in transit when the time is up
MOST_TAIL = 5.0  # s for which reading continues after the camera was stopped: a busy computer reads slowly
TIME_UP, STOPPED, DISK_FULL = "the time was up", "it was stopped", "the disk is full"


class Waiting:
    """Queue of blocks of bytes between two threads; `b""` is the last block."""

    def __init__(self) -> None:
        self._blocks: SimpleQueue[bytes] = SimpleQueue()
        # each counter is written by one thread only, so neither needs a lock
        self._put = self._taken = 0
        self._ended = False

    @property
    def size(self) -> int:
        """Number of waiting bytes."""
        return self._put - self._taken

    def put(self, block: bytes) -> None:
        """Add a block."""
        self._put += len(block)
        self._blocks.put(block)

    def end(self) -> None:
        """Note that no block follows."""
        self._ended = True
        self._blocks.put(b"")

    def take(self) -> bytes:
        """Return waiting blocks, joined until they have `PIECE` bytes or more; empty bytes at the end."""
        if self.size < PIECE // 4 and not self._ended:
            # many small blocks cost less together than one by one
            time.sleep(GATHER)
        taken = [self._blocks.get()]
        size = len(taken[0])
        while taken[-1] and size < PIECE and not self._blocks.empty():
            taken.append(self._blocks.get())
            size += len(taken[-1])
        self._taken += size
        if not taken[-1]:
            # the last block stays in the queue for the next call
            self._blocks.put(b"")
        return taken[0] if len(taken) == 1 else b"".join(taken)


class CameraReader(Thread):
    """Thread that reads a camera's stream.

    From `begin` on, the thread keeps up to `ROOM` bytes (64 MiB) until the decoder takes them. Bytes beyond that are
    dropped and counted as `lost`. If `keep` is called with a journal, blocks are written to it before they can be
    taken; reading ends if the disk is full.
    """

    def __init__(self, camera: Camera, seconds: float | None, stop: Event) -> None:
        super().__init__(name="nvsdata-reader", daemon=True)
        self.camera, self.seconds, self.stop = camera, seconds, stop
        self.received = self.lost = self.odd_bytes = 0
        self.ended = TIME_UP
        self.gone = False
        self._begun = False
        self._read_out, self._kept = Waiting(), Waiting()
        self._keeper: Thread | None = None

    def begin(self) -> None:
        """Start to keep the bytes that are read."""
        self._begun = True

    def delay(self, seconds: float) -> None:
        """Read `seconds` longer, because the recording began that much later."""
        if self.seconds is not None:
            self.seconds += seconds

    def keep(self, journal: StreamJournal | None) -> None:
        """Start to pass on the bytes that are read; if there is a journal, they are written to it first."""
        if journal is None:
            self._kept = self._read_out
        else:
            self._keeper = Thread(target=self._hand_on, args=(journal,), name="nvsdata-journal", daemon=True)
            self._keeper.start()

    def _hand_on(self, journal: StreamJournal) -> None:
        failed = False
        try:
            while block := self._read_out.take():
                if not failed:
                    try:
                        journal.write(block)
                    except Exception as error:
                        why = DISK_FULL if isinstance(error, OSError) else "the journal failed"
                        failed, self.ended = True, f"{why} ({getattr(error, 'strerror', None) or error})"
                        self.stop.set()
                self._kept.put(block)
        finally:
            # the thread that takes blocks waits for this
            self._kept.end()

    def run(self) -> None:
        try:
            self._read()
            self.camera.stop()
            self._read_tail()
        except CameraError as error:
            self.ended, self.gone = str(error), True
        except Exception as error:  # a camera class of a user may raise any exception
            self.ended, self.gone = f"the camera failed ({type(error).__name__}: {error})", True
        finally:
            # the thread that takes blocks waits for this, whatever the camera does
            self._read_out.end()
            self.camera.end_reading()

    def _read(self) -> None:
        began = heard = time.monotonic()
        while True:
            block = self.camera.read()
            now = time.monotonic()
            if block:
                heard = now
                self._add(block)
            elif self.camera.silence is not None and now - heard > self.camera.silence:
                self.ended = f"the camera sent nothing for {self.camera.silence:.0f} s"
                return
            if self.stop.is_set():
                if self.ended == TIME_UP:
                    self.ended = STOPPED
                break
            if self.seconds is not None and now - began > self.seconds + TAIL:
                break
        if self.camera.silence is not None and now - heard > SILENT_END and self.ended in (TIME_UP, STOPPED):
            self.ended = f"the camera sent nothing for the last {now - heard:.1f} s"

    def _read_tail(self) -> None:
        until, silent = time.monotonic() + MOST_TAIL, 0
        while silent < 2 and time.monotonic() < until:
            block = self.camera.read(20)
            silent = 0 if block else silent + 1
            if block:
                self._add(block)

    def _add(self, block: bytes) -> None:
        if not self._begun:
            return
        self.received += len(block)
        if left_over := len(block) % self.camera.unit:
            # an incomplete word would shift all words after it
            self.odd_bytes += 1
            block = block[:-left_over]
        waiting = self._read_out.size + (self._kept.size if self._kept is not self._read_out else 0)
        if waiting + len(block) > ROOM:
            self.lost += len(block)
        elif block:
            self._read_out.put(block)

    def take(self) -> bytes:
        """Return the next bytes that were read; empty at the end."""
        return self._kept.take()

    def end(self, why: str) -> None:
        """Stop reading, and note the reason."""
        self.finish()
        self.ended = why

    def finish(self) -> None:
        """Stop reading, and wait until the camera has been stopped and all bytes are in the journal."""
        self.stop.set()
        self.join()
        if self._keeper is not None:
            self._keeper.join()
