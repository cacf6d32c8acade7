"""A camera that isn't there: a backend for pyusb that speaks a DAVIS's protocol, and what its pixels see."""

from __future__ import annotations

import errno
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from threading import Lock
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np
import usb.backend
import usb.core

from nvsdata.events import Events
from nvsdata.kernels.wire import encode
from nvsdata.recording.davis import ENDPOINT, READ, REGISTER, SEVERAL, VENDOR, WRITE
from nvsdata.recording.registers import APS, CHIP, DVS, EXTERNAL, IMU, MUX, SYSTEM, USB

RESET_WORD = 0x0001
FIFO = 1 << 22  # bytes that wait to be read; beyond that the camera drops events

# what a DAVIS240C answers, by register
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
# registers that may be written, beside the chip's: module, first, last
WRITABLE = ((MUX, 0, 5), (DVS, 3, 63), (APS, 4, 13), (IMU, 2, 10), (EXTERNAL, 0, 16), (CHIP, 0, 144), (USB, 0, 1))


class Scene(Protocol):
    """What the pixels see."""

    def events(self, start: int, stop: int) -> Events:
        """Events from `start` to `stop` (excluded), in µs since the camera's time was reset."""


@dataclass
class Outlines:
    """`rate` events/s of the outline of a square that circles over the sensor, and `noise` events/s anywhere."""

    rate: float = 200_000
    noise: float = 20_000
    seed: int = 0

    def events(self, start: int, stop: int) -> Events:
        rng = np.random.default_rng((self.seed, start))
        count, stray = (rng.poisson(rate * (stop - start) / 1e6) for rate in (self.rate, self.noise))
        t = np.sort(rng.integers(start, max(stop, start + 1), count + stray))
        along, edge, angle = rng.uniform(0, 60, t.size), rng.integers(0, 4, t.size), t * (2 * np.pi / 2e6)
        x = 90 + 60 * np.cos(angle) + np.where(edge % 2, along, 60 * (edge // 2))
        y = 60 + 45 * np.sin(angle) + np.where(edge % 2, 60 * (edge // 2), along)
        noisy = rng.permutation(t.size) < stray
        x = np.where(noisy, rng.uniform(0, 240, t.size), x)
        y = np.where(noisy, rng.uniform(0, 180, t.size), y)
        return Events(t, x.astype(int) % 240, y.astype(int) % 180, edge > 1, (240, 180))


@dataclass
class Camera:
    """A simulated camera.

    `speed` is how fast its time passes: 1 as ours, 0 not before it is `advance`d. `log` holds all control transfers,
    (type, request, value, index, data). `unplugged` makes it go away, `refusal` (an errno) refuse whatever is asked;
    `firmware` is the device's version, `registers` what it answers.
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
    refusal: int | None = None  # errno of any first use

    def __post_init__(self) -> None:
        self._lock = Lock()
        self._fifo = bytearray()
        self._began: float | None = None
        self._time = 0  # µs up to which the scene was seen
        self._state = np.array([0, 0, -1], np.int64)
        self._extra = 0.0

    def control(self, kind: int, request: int, value: int, index: int, data: Any) -> int:
        """A control transfer; how many bytes were taken or given. USBError for what the camera doesn't know."""
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
        with self._lock:
            for module, parameter, number in writes:
                self._write(module, parameter, number)
        return len(sent)

    def _write(self, module: int, parameter: int, number: int) -> None:
        self._see()
        self.registers[module, parameter] = number
        if (module, parameter) == (MUX, 2) and number:
            self._fifo += RESET_WORD.to_bytes(2, "little")
            self._began, self._time, self._extra = time.perf_counter(), 0, 0.0
            self._state[:] = 0, 0, -1
        running = self._streams()
        if running and self._began is None:
            self._began, self._time = time.perf_counter(), 0
            self._state[:] = 0, 0, -1
        elif not running:
            self._began = None

    def _streams(self) -> bool:
        return all(self.registers.get(place) for place in ((MUX, 3), (USB, 0), (MUX, 1), (MUX, 0)))

    def advance(self, microseconds: float) -> None:
        """Let the camera's time pass."""
        self._extra += microseconds

    def _see(self) -> None:
        """Put what the pixels saw since the last time into the FIFO."""
        if self._began is None:
            return
        now = int((time.perf_counter() - self._began) * 1e6 * self.speed + self._extra)
        if now <= self._time:
            return
        start, self._time = self._time, now
        if not self.registers.get((DVS, 3)):
            return
        seen = self.scene.events(start, now)
        words = np.empty(4 * len(seen) + (now >> 15) + 8, "<u2")
        count = encode(seen.t, seen.x, seen.y, seen.p, self._state, words)
        while (now - self._state[0]) >> 15:
            # the clock's wraps come whether or not there is an event
            words[count] = 0x7001
            self._state[0] += 1 << 15
            count += 1
        room = (FIFO - len(self._fifo)) // 2
        if count > room:
            dropped = self.registers.get((MUX, 84), 0) + len(seen)
            self.registers[MUX, 84] = dropped & 0xFFFFFFFF
            return
        self._fifo += words[:count].tobytes()

    def bulk(self, buffer: Any) -> int:
        """Fill `buffer` with what there is."""
        with self._lock:
            self._see()
            count = min(len(buffer), len(self._fifo)) // 2 * 2
            if count:
                memoryview(buffer)[:count] = bytes(self._fifo[:count])
                del self._fifo[:count]
                return count
        time.sleep(0.001)
        raise usb.core.USBTimeoutError("Operation timed out", -7, errno.ETIMEDOUT)


class Backend(usb.backend.IBackend):  # type: ignore[misc]
    """pyusb's backend for simulated cameras."""

    def __init__(self, *cameras: Camera, before: Callable[[Camera, str], None] = lambda camera, call: None) -> None:
        self.cameras, self.before = cameras, before

    def _use(self, camera: Camera, call: str) -> Camera:
        self.before(camera, call)
        if camera.unplugged:
            raise usb.core.USBError("No such device", -4, errno.ENODEV)
        if camera.refusal is not None:
            raise usb.core.USBError("refused", None, camera.refusal)
        return camera

    def enumerate_devices(self) -> Any:
        return [camera for camera in self.cameras if not camera.unplugged]

    def get_device_descriptor(self, dev: Camera) -> Any:
        return SimpleNamespace(
            bLength=18,
            bDescriptorType=1,
            bcdUSB=0x0200,
            bDeviceClass=0,
            bDeviceSubClass=0,
            bDeviceProtocol=0,
            bMaxPacketSize0=64,
            idVendor=VENDOR,
            idProduct=dev.product,
            bcdDevice=dev.firmware,
            iManufacturer=1,
            iProduct=2,
            iSerialNumber=3 if dev.serial else 0,
            bNumConfigurations=1,
            address=self.cameras.index(dev) + 1,
            bus=1,
            port_number=1,
            port_numbers=(1,),
            speed=3,
        )

    def get_configuration_descriptor(self, dev: Camera, config: int) -> Any:
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=2,
            wTotalLength=25,
            bNumInterfaces=1,
            bConfigurationValue=1,
            iConfiguration=0,
            bmAttributes=0x80,
            bMaxPower=200,
            extra_descriptors=b"",
        )

    def get_interface_descriptor(self, dev: Camera, intf: int, alt: int, config: int) -> Any:
        if intf or alt:
            raise IndexError("no such interface")
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=4,
            bInterfaceNumber=0,
            bAlternateSetting=0,
            bNumEndpoints=1,
            bInterfaceClass=0xFF,
            bInterfaceSubClass=0,
            bInterfaceProtocol=0,
            iInterface=0,
            extra_descriptors=b"",
        )

    def get_endpoint_descriptor(self, dev: Camera, ep: int, intf: int, alt: int, config: int) -> Any:
        if ep:
            raise IndexError("no such endpoint")
        return SimpleNamespace(
            bLength=7,
            bDescriptorType=5,
            bEndpointAddress=ENDPOINT,
            bmAttributes=2,
            wMaxPacketSize=dev.packet,
            bInterval=0,
            bRefresh=0,
            bSynchAddress=0,
            extra_descriptors=b"",
        )

    def open_device(self, dev: Camera) -> Camera:
        return self._use(dev, "open")

    def close_device(self, dev_handle: Camera) -> None:
        self.before(dev_handle, "close")

    def get_configuration(self, dev_handle: Camera) -> int:
        self._use(dev_handle, "configuration")
        return 1

    def set_configuration(self, dev_handle: Camera, config_value: int) -> None:
        self._use(dev_handle, "configuration")

    def claim_interface(self, dev_handle: Camera, intf: int) -> None:
        self._use(dev_handle, "claim")

    def release_interface(self, dev_handle: Camera, intf: int) -> None:
        self.before(dev_handle, "release")

    def clear_halt(self, dev_handle: Camera, ep: int) -> None:
        self._use(dev_handle, "clear_halt")

    def ctrl_transfer(
        self, dev_handle: Camera, bmRequestType: int, bRequest: int, wValue: int, wIndex: int, data: Any, timeout: int
    ) -> int:
        camera = self._use(dev_handle, "control")
        if (bmRequestType, bRequest) == (0x80, 6) and wValue >> 8 == 3:
            text = camera.serial.encode("utf-16-le")
            answer = bytes([4, 3, 9, 4]) if wValue == 0x0300 else bytes([len(text) + 2, 3]) + text
            data[: len(answer)] = type(data)("B", answer)
            return len(answer)
        return camera.control(bmRequestType, bRequest, wValue, wIndex, data)

    def bulk_read(self, dev_handle: Camera, ep: int, intf: int, buff: Any, timeout: int) -> int:
        return self._use(dev_handle, "read").bulk(buff)


def _writable(module: int, parameter: int) -> bool:
    return any(module == kind and first <= parameter <= last for kind, first, last in WRITABLE)
