"""Simulated camera: its answers to control transfers, and the words that it sends for a scene."""

from __future__ import annotations

import errno
import time
from dataclasses import dataclass, field
from threading import Lock
from typing import Any

import numpy as np
import usb.core

from nvsdata.data.events import Events
from nvsdata.kernels.recording.davis_stream import encode
from nvsdata.recording.camera import host_time
from nvsdata.recording.davis.driver import READ, REGISTER, SEVERAL, WRITE
from nvsdata.recording.davis.registers import APS, CHIP, DVS, EXTERNAL, IMU, MUX, SYSTEM, USB
from nvsdata.recording.simulated.scenes import Outlines, Scene

RESET_WORD, PULSE_WORD = 0x0001, 0x0004
GLANCE = 4_000  # µs; shortest part of the scene that is simulated at once
SAMPLE_EVERY = 100_000  # µs between inertial samples
# a sample at rest and 25 °C: start, scales and contents, acceleration, temperature, rotation, end
SAMPLE_WORDS = [
    0x0005,
    0x53E0,
    *(0x5000 | byte for value in (0, -16384, 0, (25 - 35) * 340, 0, 0, 0) for byte in divmod(value & 0xFFFF, 256)),
    0x0007,
]
FRAME_START, COLUMN_OF_RESET, COLUMN_OF_SIGNAL, COLUMN_END = 0x0008, 0x000B, 0x000C, 0x000D
EXPOSURE_START, EXPOSURE_END, FRAME_END = 0x000E, 0x000F, 0x000A
DARK_SAMPLE = 500  # the converter's value of a pixel without light; a DAVIS240's converter has one bit less
SLICE = 20_000  # µs of the scene that are simulated at once after a long pause of the reader
MOST_BEHIND = 30_000_000  # µs that the simulation may be late: earlier events are dropped

# answers of a DAVIS240C, by register
DAVIS240C: dict[tuple[int, int], int] = {
    (SYSTEM, 0): 18,
    (SYSTEM, 1): 2,
    (SYSTEM, 2): 1,
    (SYSTEM, 3): 90,
    (SYSTEM, 4): 30,
    (SYSTEM, 5): 30,
    (SYSTEM, 6): 1000,
    (SYSTEM, 7): 1,
    (DVS, 0): 240,
    (DVS, 1): 180,
    (DVS, 2): 0,
    (DVS, 10): 1,
    (DVS, 30): 1,
    (DVS, 40): 1,
    (DVS, 50): 1,
    (DVS, 60): 1,
    (DVS, 80): 1,
    (APS, 0): 240,
    (APS, 1): 180,
    (APS, 2): 0,
    (APS, 3): 0,
    (APS, 6): 1,
    (IMU, 0): 1,
    (IMU, 1): 0,
    (EXTERNAL, 10): 0,
    (MUX, 80): 1,
    (MUX, 83): 0,
    (MUX, 84): 0,
}
# registers that may be written: module, first, last
WRITABLE = ((MUX, 0, 5), (DVS, 3, 63), (APS, 4, 13), (IMU, 2, 10), (EXTERNAL, 0, 16), (CHIP, 0, 144), (USB, 0, 1))


@dataclass
class SimulatedDavis:
    """Simulated DAVIS camera.

    Args:
        scene: Scene in front of the camera (default: `Outlines()`).
        serial: Serial number in the USB descriptor.
        product: USB product ID.
        firmware: Version of the firmware.
        registers: Values of the registers, by (module, parameter) (default: those of a DAVIS240C).
        speed: Speed of the camera's clock relative to the host's (default 1). 1.0001 is 100 ppm too fast; with 0, time
            passes only by `advance`.
        packet: Bytes per USB packet (default 512).
        log: All control transfers so far, (type, request, value, index, data).
        unplugged: True while the camera is disconnected.
        refusal: Errno with which the camera refuses every request, None if it doesn't.
        stalled: True while the camera sends nothing.
        lossy: Probability that the events of a simulated time slice are dropped, and counted as dropped (default 0).
        room: Bytes that may wait to be read; events beyond that are dropped, as by a real camera. With None, the
            default, all events are sent as fast as they are read, so that a busy computer loses nothing.
    """

    scene: Scene = field(default_factory=Outlines)
    serial: str = "SIM00001"
    product: int = 0x841B
    firmware: int = 4
    registers: dict[tuple[int, int], int] = field(default_factory=lambda: dict(DAVIS240C))
    speed: float = 1.0
    packet: int = 512
    log: list[tuple[int, int, int, int, bytes]] = field(default_factory=list)
    unplugged: bool = False
    refusal: int | None = None
    stalled: bool = False
    lossy: float = 0.0
    room: int | None = None

    def __post_init__(self) -> None:
        self._lock = Lock()
        self._asked = False
        self._random = np.random.default_rng(0)
        self._fifo = bytearray()
        self._began: int | None = None  # host time at which the camera's clock was reset
        self._time = 0  # µs up to which the scene has been simulated
        self._state = np.array([0, 0, -1], np.int64)
        self._sampled = self._framed = 0
        self._extra = 0.0

    def control(self, kind: int, request: int, value: int, index: int, data: Any) -> int:
        """Do a control transfer and return the number of bytes; raise USBError for unknown requests."""
        if kind == READ and request == REGISTER:
            known = self.registers.get((value, index), 0 if _writable(value, index) else None)
            if known is None or len(data) != 4:
                raise usb.core.USBError("Pipe error", -9, errno.EPIPE)
            data[:] = type(data)("B", known.to_bytes(4, "big"))
            self.log.append((kind, request, value, index, bytes(data)))
            return 4
        sent = bytes(data)
        if kind == WRITE and request == REGISTER and len(sent) == 4:
            writes = [(value, index, int.from_bytes(sent, "big"))]
        elif kind == WRITE and request == SEVERAL and len(sent) == 6 * value:
            pieces = [sent[n : n + 6] for n in range(0, len(sent), 6)]
            writes = [(piece[0], piece[1], int.from_bytes(piece[2:], "big")) for piece in pieces]
        else:
            raise usb.core.USBError("Pipe error", -9, errno.EPIPE)
        if not all(_writable(module, parameter) for module, parameter, _ in writes):
            raise usb.core.USBError("Pipe error", -9, errno.EPIPE)
        self.log.append((kind, request, value, index, sent))
        self._asked = True
        with self._lock:
            for module, parameter, number in writes:
                self._write(module, parameter, number)
            self._asked = False
        return len(sent)

    def _write(self, module: int, parameter: int, number: int) -> None:
        now = self._now()
        while self._see(now):
            # events up to `now` are sent with the previous registers, but no later ones, even if the simulation is slow
            pass
        self.registers[module, parameter] = number
        if (module, parameter) == (MUX, 2) and number:
            # a real camera's memory contains hardly any words from before a reset
            self._fifo.clear()
            self._fifo += RESET_WORD.to_bytes(2, "little")
            self._begin()
        if not self._streams():
            self._began = None
        elif self._began is None:
            self._begin()

    def _begin(self) -> None:
        """Restart the camera's time."""
        self._began, self._time, self._extra = int(host_time()), 0, 0.0
        self._sampled = self._framed = 0
        self._state[:] = 0, 0, -1

    def _streams(self) -> bool:
        return all(self.registers.get(place) for place in ((MUX, 3), (USB, 0), (MUX, 1), (MUX, 0)))

    def advance(self, microseconds: float) -> None:
        """Advance the camera's time."""
        self._extra += microseconds

    def _now(self) -> int:
        """Return the camera's time (µs) up to which the scene's events are known; 0 if the camera doesn't stream."""
        if self._began is None:
            return 0
        return int((host_time() - self._began - self.scene.lag) * self.speed + self._extra)

    def _see(self, now: int, least: int = 1) -> bool:
        """Put the events since the last call, up to `now` (µs), into the FIFO, if that time is at least `least` µs.

        Without a limit (`room`), a call adds at most `SLICE` µs. Return True if events are left for the next call.
        """
        if self._began is None or self.stalled or now < self._time + least:
            return False
        rate = self.speed or 1.0
        behind = False
        if self.room is None:
            self._skip(now - MOST_BEHIND - self._time)
            behind = now > self._time + SLICE
            now = min(now, self._time + SLICE)
        start, stop = (int(self._began + time / rate) for time in (self._time, now))
        start_own, self._time = self._time, now
        if not self.registers.get((DVS, 3)):
            return behind
        seen = self.scene.events(start, stop)
        t = np.clip(((seen.t - self._began) * rate).astype(np.int64), start_own, now)
        pulses = [int((time - self._began) * rate) for time in self.scene.pulses(start, stop)]
        pulses = pulses if self.registers.get((EXTERNAL, 0)) else []
        full = self.room is not None and 8 * len(seen) > self.room - len(self._fifo)
        if full or self._random.random() < self.lossy:
            # events are dropped, but the words of the clock aren't
            self._drop(len(seen))
            t, seen = t[:0], seen[:0]
        first, last = self._frame(now)
        self._fifo += first + self._words(t, seen, pulses, now).tobytes() + last
        return behind

    def _skip(self, span: int) -> None:
        """Skip the next `span` µs, if that is positive, because the process was suspended for long."""
        if span > 0 and self._began is not None:
            start = int(self._began + self._time / (self.speed or 1.0))
            # the number of events is estimated, because simulating them would take as long as sending them
            self._drop(len(self.scene.events(start, start + SLICE)) * -(-span // SLICE))
            self._time += span

    def _drop(self, count: int) -> None:
        """Count events as dropped."""
        self.registers[MUX, 84] = (self.registers.get((MUX, 84), 0) + count) & 0xFFFFFFFF

    def _frame(self, now: int) -> tuple[bytes, bytes]:
        """Return the two readings of a frame, if one is due; the exposure lasts from the first to the second."""
        interval = self.registers.get((APS, 13), 0) / self.registers.get((SYSTEM, 4), 30)
        if not self.registers.get((APS, 4)) or now - self._framed < interval:
            return b"", b""
        self._framed = now
        region = [self.registers.get((APS, parameter), 0) for parameter in (8, 9, 10, 11)]
        return readings(picture(region), region)

    def _words(self, t: np.ndarray, seen: Events, pulses: list[int], now: int) -> np.ndarray:
        """Encode the events `seen` at times `t`, the pulses, and the wraps of the clock up to `now` as words."""
        words = np.empty(4 * len(seen) + (now >> 15) + 8 * len(pulses) + 32, "<u2")
        count = at = 0
        for pulse in (*sorted(pulses), now):
            until = int(np.searchsorted(t, pulse)) if pulse < now else t.size
            part = slice(at, until)
            count += encode(t[part], seen.x[part], seen.y[part], seen.p[part], self._state, words[count:])
            at = until
            while (pulse - self._state[0]) >> 15:
                # the clock wraps without events, too
                words[count] = 0x7001
                self._state[0] += 1 << 15
                count += 1
            if pulse < now:
                if self._state[0] < pulse != self._state[1]:
                    words[count] = 0x8000 | (pulse - self._state[0])
                    count += 1
                words[count] = PULSE_WORD
                count += 1
                self._state[1:] = pulse, -1
        if now - self._sampled > SAMPLE_EVERY and self.registers.get((IMU, 4)):
            words[count : count + len(SAMPLE_WORDS)] = SAMPLE_WORDS
            count += len(SAMPLE_WORDS)
            self._sampled = now
        return words[:count]

    def bulk(self, buffer: Any) -> int:
        """Copy waiting bytes into `buffer` and return their number; raise USBTimeoutError if there are none."""
        while self._asked:
            # a reader that never pauses would never release the lock to others
            time.sleep(1e-4)
        with self._lock:
            if not self._fifo:
                self._see(self._now(), GLANCE)
            count = min(len(buffer), len(self._fifo)) // 2 * 2
            if count:
                memoryview(buffer)[:count] = bytes(self._fifo[:count])
                del self._fifo[:count]
                return count
        time.sleep(0.001)
        raise usb.core.USBTimeoutError("Operation timed out", -7, errno.ETIMEDOUT)


def picture(region: list[int]) -> np.ndarray:
    """Return the image 2 * (x + y) of a region (first column and row, last column and row), int64 [H, W]."""
    x, y = np.arange(region[0], region[2] + 1), np.arange(region[1], region[3] + 1)
    return 2 * (x[None, :] + y[:, None])


def readings(light: np.ndarray, region: list[int]) -> tuple[bytes, bytes]:
    """Return the words of a frame, column by column: the reading of dark pixels, and the reading after exposure."""
    announced = [word for edge in region for word in (0x5100 | edge >> 8, 0x5200 | edge & 0xFF)]

    def columns(kind: int, samples: np.ndarray) -> np.ndarray:
        words = np.full((samples.shape[1], samples.shape[0] + 2), kind, "<u2")
        words[:, 1:-1] = 0x4000 | samples.T
        words[:, -1] = COLUMN_END
        return words.ravel()

    def sent(*parts: Any) -> bytes:
        return np.concatenate(parts).astype("<u2").tobytes()

    dark, lit = np.full_like(light, DARK_SAMPLE), DARK_SAMPLE - light // 2
    first = sent([FRAME_START, *announced], columns(COLUMN_OF_RESET, dark), [EXPOSURE_START])
    return first, sent([EXPOSURE_END], columns(COLUMN_OF_SIGNAL, lit), [FRAME_END])


def _writable(module: int, parameter: int) -> bool:
    return any(module == kind and first <= parameter <= last for kind, first, last in WRITABLE)
