"""The driver of DAVIS240 and DAVIS346 cameras, by pyusb."""

from __future__ import annotations

import errno
import math
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import usb.core
import usb.util

from nvsdata.recording.registers import (
    APS,
    CHIP,
    CHIPS,
    DVS,
    EXTERNAL,
    IMU,
    MUX,
    RUNNING,
    SYSTEM,
    USB,
    Settings,
    biases_of,
)
from nvsdata.recording.transfers import Gone, Stream, stream
from nvsdata.recording.wire import Decoder

VENDOR = 0x152A
# product, what board it is, the least firmware
BOARDS = {0x841B: ("FX2", 4), 0x841A: ("FX3", 6)}
LOGIC, PATCH = 18, 1
ENDPOINT = 0x82
READ, WRITE = 0xC0, 0x40
REGISTER, SEVERAL = 0xBF, 0xC2
TIMEOUT = 1_000  # ms
MOST = 4_096  # pixels a side, and MHz: more is no answer of a camera
UDEV = 'SUBSYSTEM=="usb", ATTR{idVendor}=="152a", ATTR{idProduct}=="84[0-1]?", MODE="0666", TAG+="uaccess"'


class CameraError(OSError):
    """What keeps a camera from recording, in one line that says what to do."""


class Unplugged(CameraError):
    """The camera is gone."""


@dataclass(frozen=True)
class Facts:
    """What a camera says of itself. `width`, `height` and `frame_size` are as the host sees them; clocks in MHz."""

    serial: str
    board: str
    chip: int
    width: int
    height: int
    swap: bool
    frame_size: tuple[int, int]
    frame_orientation: int
    inertial: int
    inertial_flips: int
    logic_clock: float
    converter_clock: float
    usb_clock: float
    has: frozenset[str]

    @property
    def name(self) -> str:
        """The sensor's name."""
        return CHIPS.get(self.chip, f"chip {self.chip}")


class Davis:
    """An open camera. `find` opens one; use it in a `with` block, or `close` it.

    After `configure`, `start` and `stop` as often as wanted; between them `read` gives the stream, which
    `decoder()` understands. Methods raise `CameraError`, `Unplugged` if the camera is gone.
    """

    def __init__(self, device: Any) -> None:
        self.device = device
        self.settings = Settings()
        self._stream: Stream | None = None
        with _told():
            self._claim()
            self.facts = self._facts()

    @classmethod
    def find(cls, serial: str | None = None, *, backend: Any = None) -> Self:
        """Open the camera of that serial number, or the only one there is."""
        found = []
        refused: list[Exception] = []
        for device in _devices(backend):
            try:
                found.append(cls(device))
            except CameraError as error:
                refused.append(error)
        chosen = [camera for camera in found if serial is None or camera.facts.serial == serial]
        for camera in found:
            if camera not in chosen or len(chosen) > 1:
                camera.close()
        if len(chosen) == 1:
            return chosen[0]
        if chosen:
            serials = ", ".join(sorted(camera.facts.serial for camera in chosen))
            raise CameraError(f"{len(chosen)} cameras are connected: choose one by its serial number ({serials})")
        if refused:
            raise refused[0]
        there = ", ".join(camera.facts.serial for camera in found)
        raise CameraError(
            f"no camera of serial number {serial}; there is {there}" if found else "no DAVIS camera is connected"
        )

    def _claim(self) -> None:
        # before the serial number, whose failures pyusb doesn't tell apart
        if self.device.get_active_configuration().bConfigurationValue != 1:
            self.device.set_configuration(1)
        usb.util.claim_interface(self.device, 0)
        self._serial = (self.device.serial_number or "")[:8]

    def _facts(self) -> Facts:
        board, least = BOARDS[self.device.idProduct]
        firmware = self.device.bcdDevice & 0xFF
        if firmware < least:
            raise self._refused(f"has firmware {firmware}, at least {least} is needed")
        logic = self.get(SYSTEM, 0)
        if logic != LOGIC:
            raise self._refused(f"has logic {logic}, {LOGIC} is needed")
        patch = self.get(SYSTEM, 7)
        if patch < PATCH:
            raise self._refused(f"has patch level {patch} of its logic, at least {PATCH} is needed")
        chip = self.get(SYSTEM, 1)
        self.get(SYSTEM, 2)
        asked = (
            ("pixel filter", DVS, 10),
            ("activity filter", DVS, 30),
            ("region filter", DVS, 40),
            ("skip filter", DVS, 50),
            ("polarity filter", DVS, 60),
            ("event statistics", DVS, 80),
            ("colour", APS, 3),
            ("global shutter", APS, 6),
            ("generator", EXTERNAL, 10),
            ("statistics", MUX, 80),
        )
        has = frozenset(name for name, module, parameter in asked if self.get(module, parameter))
        inertial = self.get(IMU, 0)
        clocks = [self.get(SYSTEM, parameter) for parameter in (3, 4, 5)]
        deviation = self.get(SYSTEM, 6)
        logic_clock, converter_clock, usb_clock = (float(np.float32(clock * deviation / 1000)) for clock in clocks)
        (columns, rows, turned), (wide, high, orientation) = self._geometry()
        flips = self.get(IMU, 1)
        swap, frame_swap = bool(turned & 4), bool(orientation & 4)
        if not all(0 < side <= MOST for side in (columns, rows, wide, high)):
            raise self._nonsense(f"{columns}x{rows} pixels, frames of {wide}x{high}")
        if not all(0 < clock <= MOST for clock in (logic_clock, converter_clock, usb_clock)):
            raise self._nonsense(f"clocks of {logic_clock:g}, {converter_clock:g} and {usb_clock:g} MHz")
        try:
            biases_of(chip)
        except ValueError as error:
            self.close()
            raise CameraError(str(error)) from None
        return Facts(
            self._serial or f"TMP{(self.device.bus or 0) * 256 + (self.device.address or 0):05d}",
            board,
            chip,
            *((rows, columns) if swap else (columns, rows)),
            swap,
            (high, wide) if frame_swap else (wide, high),
            orientation,
            inertial,
            flips,
            logic_clock,
            converter_clock,
            usb_clock,
            has,
        )

    def _geometry(self) -> list[tuple[int, int, int]]:
        """Columns, rows and orientation of events and of frames."""
        return [(self.get(module, 0), self.get(module, 1), self.get(module, 2)) for module in (DVS, APS)]

    def _nonsense(self, what: str) -> CameraError:
        self.close()
        return CameraError(f"camera {self._serial} answers nonsense ({what}): plug it in again, or into another port")

    def _refused(self, why: str) -> CameraError:
        self.close()
        return CameraError(f"camera {self._serial} {why}: update it by the vendor's tool (Flashy in DV)")

    def get(self, module: int, parameter: int) -> int:
        """Read a register."""
        with _told():
            answer = self.device.ctrl_transfer(READ, REGISTER, module, parameter, 4, timeout=TIMEOUT)
        if len(answer) != 4:
            raise CameraError(f"the camera answered {len(answer)} bytes for register {module}/{parameter}, not 4")
        return int.from_bytes(bytes(answer), "big")

    def set(self, module: int, parameter: int, value: int) -> None:
        """Write a register."""
        with _told():
            self.device.ctrl_transfer(
                WRITE, REGISTER, module, parameter, int(value).to_bytes(4, "big"), timeout=TIMEOUT
            )

    def set_together(self, *writes: tuple[int, int, int]) -> None:
        """Write several registers, (module, parameter, value), that nothing may come between."""
        data = b"".join(bytes([m, p]) + int(value).to_bytes(4, "big") for m, p, value in writes)
        with _told():
            self.device.ctrl_transfer(WRITE, SEVERAL, len(writes), 0, data, timeout=TIMEOUT)

    def get64(self, module: int, parameter: int) -> int:
        """Read a counter of 64 bits, whose upper half is at `parameter`."""
        while True:
            high, low, again = (self.get(module, parameter + offset) for offset in (0, 1, 0))
            if high == again:
                return high << 32 | low

    def configure(self, settings: Settings) -> None:
        """The vendor's default configuration, then what differs from it.

        ValueError for biases or a region that the camera doesn't have.
        """
        facts, biases = self.facts, biases_of(self.facts.chip)
        for name in settings.biases:
            if name not in biases:
                raise ValueError(f"{facts.name} has no bias {name!r}; it has {', '.join(biases)}")
        values = {name: biases[name].value(*numbers) for name, numbers in settings.biases.items()}
        for name, bias in biases.items():
            self.set(CHIP, bias.parameter, values.get(name, bias.value()))
        for module, parameter, value in self._defaults():
            self.set(module, parameter, value)
        for module, parameter, value in self._changes(settings):
            self.set(module, parameter, value)
        self.settings = settings

    def _defaults(self) -> Iterator[tuple[int, int, int]]:
        """The vendor's default configuration but for biases, in its order."""
        facts = self.facts
        old, small = facts.chip in (0, 1), facts.chip in (0, 1, 2)
        shift = [(p, int(p in (136, 138))) for p in range(128, 139)]
        shift += [(140, 0), (141, 0)]
        shift += [(139, 0)] if old else [] if small else [(143, 1), (144, 0)]
        yield from ((CHIP, parameter, value) for parameter, value in shift)
        yield from ((MUX, 4, 1), (MUX, 5, 1), (DVS, 4, 0), (DVS, 5, 0))
        if "pixel filter" in facts.has:
            for k in range(8):
                yield from ((DVS, 11 + 2 * k, facts.height), (DVS, 12 + 2 * k, facts.width))
        if "activity filter" in facts.has:
            yield from ((DVS, 31, 1), (DVS, 32, 8), (DVS, 33, 0), (DVS, 34, 1))
        if "region filter" in facts.has:
            yield from ((DVS, 41, 0), (DVS, 42, 0), (DVS, 43, facts.width - 1), (DVS, 44, facts.height - 1))
        if "skip filter" in facts.has:
            yield from ((DVS, 51, 0), (DVS, 52, 5))
        if "polarity filter" in facts.has:
            yield from ((DVS, 61, 0), (DVS, 62, 0), (DVS, 63, 0))
        yield APS, 5, 1
        if "global shutter" in facts.has:
            yield from ((CHIP, 142, 1), (APS, 7, 1))
        wide, high = facts.frame_size
        yield from ((APS, 8, 0), (APS, 9, 0), (APS, 10, wide - 1), (APS, 11, high - 1))
        yield from ((APS, 12, _cycles(4_000, facts.converter_clock)), (APS, 13, _cycles(40_000, facts.converter_clock)))
        yield from ((IMU, 5, 0), (IMU, 6, 1), (IMU, 7, 1))
        if facts.inertial == 2:
            yield IMU, 9, 1
        yield IMU, 10, 1
        pulse = _cycles(10, facts.logic_clock)
        yield from ((EXTERNAL, 1, 0), (EXTERNAL, 2, 0), (EXTERNAL, 3, 1), (EXTERNAL, 4, 1), (EXTERNAL, 5, pulse))
        if "generator" in facts.has:
            length = _cycles(5, facts.logic_clock)
            generator = ((11, 0), (12, 1), (13, pulse), (14, length), (15, 0), (16, 0))
            yield from ((EXTERNAL, parameter, value) for parameter, value in generator)
        yield USB, 1, _cycles(1_000, facts.usb_clock)

    def _changes(self, settings: Settings) -> Iterator[tuple[int, int, int]]:
        """What `settings` want in other ways than the defaults."""
        facts, default = self.facts, Settings()
        if settings.region is not None:
            x, y, width, height = settings.region
            if "region filter" not in facts.has:
                raise ValueError(f"this {facts.name} can't send the events of a region alone")
            if x + width > facts.width or y + height > facts.height:
                raise ValueError(f"region {settings.region} is not within {facts.width}x{facts.height}")
            corners = (x, y, x + width - 1, y + height - 1)
            if facts.swap:
                corners = (y, x, y + height - 1, x + width - 1)
            yield from ((DVS, 41 + n, corner) for n, corner in enumerate(corners))
        if "activity filter" in facts.has:
            for first, name in ((31, "activity_filter"), (33, "refractory_filter")):
                period = getattr(settings, name)
                if period != getattr(default, name):
                    yield DVS, first, int(period is not None)
                    if period is not None:
                        yield DVS, first + 1, max(1, round(period / 250))
        for parameter, name in ((12, "exposure"), (13, "frame_interval")):
            if getattr(settings, name) != getattr(default, name):
                yield APS, parameter, _cycles(getattr(settings, name), facts.converter_clock)
        if settings.external != default.external:
            rising, falling = settings.external in ("rising", "both"), settings.external in ("falling", "both")
            yield from ((EXTERNAL, 1, int(rising)), (EXTERNAL, 2, int(falling)), (EXTERNAL, 3, 0))
        if settings.packet_delay != default.packet_delay:
            yield USB, 1, _cycles(settings.packet_delay, facts.usb_clock)

    def start(self) -> None:
        """Let the stream begin; `configure` comes first. The time is reset as the first thing."""
        self._halt()
        time.sleep(0.01)
        with _told():
            self.device.clear_halt(ENDPOINT)
        self._stream = stream(self.device, ENDPOINT)
        self.set(MUX, 3, 1)
        time.sleep(0.2)  # biases settle
        for module, parameter in ((USB, 0), (MUX, 1), (MUX, 0)):
            self.set(module, parameter, 1)
        time.sleep(0.05)
        wanted = [(DVS, 3)]
        wanted += [(APS, 4)] if self.settings.frames else []
        wanted += [(IMU, 2), (IMU, 3), (IMU, 4)] if self.settings.inertial else []
        for module, parameter in (*wanted, (EXTERNAL, 0)):
            self.set(module, parameter, 1)

    def reset_time(self) -> None:
        """Let the camera's time begin anew; a special event marks it."""
        self.set_together((MUX, 2, 1), (MUX, 2, 0))

    def stop(self) -> None:
        """End the stream; what is on its way can still be read. A camera that is gone is stopped."""
        with suppress(Unplugged):
            self._halt()

    def _halt(self) -> None:
        for module, parameter in RUNNING:
            self.set(module, parameter, 0)

    def read(self, timeout: int = 100) -> bytes:
        """What came of the stream within `timeout` ms, maybe nothing; from one thread at a time."""
        if self._stream is None:
            self._stream = stream(self.device, ENDPOINT)
        try:
            return self._stream.read(timeout)
        except Gone as error:
            raise Unplugged(f"the camera stopped sending: {error}") from None

    def end_reading(self) -> None:
        """After the last `read`, by the thread that read: take back the requests that still wait."""
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    def dropped(self) -> int | None:
        """Events that the camera itself has dropped since it has power, None if it doesn't count them."""
        return self.get64(MUX, 83) if "statistics" in self.facts.has else None

    def decoder(self) -> Decoder:
        """A decoder for this camera's stream."""
        facts = self.facts
        return Decoder(
            facts.width,
            facts.height,
            facts.swap,
            facts.frame_size,
            facts.frame_orientation,
            facts.chip,
            facts.inertial,
            facts.inertial_flips,
        )

    def close(self) -> None:
        """Let the camera go."""
        self.end_reading()
        usb.util.dispose_resources(self.device)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _devices(backend: Any) -> list[Any]:
    """The cameras that are connected, opened or not."""
    try:
        options = {} if backend is None else {"backend": backend}
        return [
            device
            for product in BOARDS
            for device in usb.core.find(find_all=True, idVendor=VENDOR, idProduct=product, **options)
        ]
    except usb.core.NoBackendError:
        raise CameraError("libusb isn't installed: install libusb-1.0 (Debian and Ubuntu: libusb-1.0-0)") from None


def _cycles(microseconds: float, clock: float) -> int:
    """So many cycles of a clock (MHz); halves are rounded away from zero."""
    return math.floor(microseconds * clock + 0.5)


@contextmanager
def _told() -> Iterator[None]:
    """USB's errors as what they mean."""
    try:
        yield
    except usb.core.USBError as error:
        if error.errno == errno.EACCES:
            rule = f"put this line into /etc/udev/rules.d/65-davis.rules and plug the camera in again: {UDEV}"
            raise CameraError(f"no permission to use the camera; on Linux, {rule}") from None
        if error.errno == errno.EBUSY:
            raise CameraError("another program uses the camera: close it (DV, jAER, another nvsdata)") from None
        if error.errno in (errno.ENODEV, errno.EIO):
            raise Unplugged("the camera was unplugged") from None
        raise CameraError(f"the camera doesn't do as asked: {error.strerror or error}") from None
