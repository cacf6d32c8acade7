"""Driver of DAVIS240 and DAVIS346 cameras, through pyusb."""

from __future__ import annotations

import errno
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict
from typing import Any, Self

import numpy as np
import usb.core
import usb.util

from nvsdata.recording.camera import CameraError, Unplugged
from nvsdata.recording.davis.configuration import DeviceInfo, changes, defaults
from nvsdata.recording.davis.file import header
from nvsdata.recording.davis.registers import (
    APS,
    CHIP,
    DVS,
    EXTERNAL,
    IMU,
    MUX,
    RUNNING,
    SYSTEM,
    USB,
    CameraSettings,
    biases_of,
)
from nvsdata.recording.davis.stream import DavisDecoder
from nvsdata.recording.usb.process_reader import SubprocessStream, can_read_in_subprocess
from nvsdata.recording.usb.transfers import INTERRUPT, AsyncStream, Disconnected, SyncStream, UsbStream, queued

VENDOR = 0x152A
# by product ID: the board, and the oldest supported firmware
BOARDS = {0x841B: ("FX2", 4), 0x841A: ("FX3", 6)}
LOGIC, PATCH = 18, 1
ENDPOINT = 0x82
DEBUG = 0x81  # endpoint of the FX3 for messages of its firmware, which waits if they aren't read
MESSAGES = 4, 64, INTERRUPT  # requests for messages, bytes of each, and kind of endpoint
READ, WRITE = 0xC0, 0x40
REGISTER, SEVERAL = 0xBF, 0xC2
TIMEOUT = 1_000  # ms
MAX_ANSWER = 4_096  # pixels per side, or MHz; higher answers are implausible
UDEV = 'SUBSYSTEM=="usb", ATTR{idVendor}=="152a", ATTR{idProduct}=="84[0-1]?", MODE="0666", TAG+="uaccess"'


class Davis:
    """DAVIS camera that is open. `find` opens one; use it in a `with` block, or `close` it.

    Call `configure`, then `start` and `stop` any number of times. Between them, `read` returns the bytes of the stream,
    which a `decoder()` decodes. Methods raise `CameraError`, or `Unplugged` if the camera was disconnected.
    """

    unit = 2
    silence: float | None = 5.0  # the camera sends the wraps of its clock, 30 times per second

    def __init__(self, device: Any) -> None:
        self.device = device
        self.settings = CameraSettings()
        self.note: str | None = None  # stored with each recording
        self._stream: UsbStream | None = None
        self._debug: AsyncStream | None = None
        self.messages: list[str] = []  # messages of the camera's firmware
        self.faults = 0  # USB requests that failed since the last start
        with _translated_errors():
            self._claim()
            self.facts = self._facts()

    @classmethod
    def find(cls, serial: str | None = None, *, backend: Any = None) -> Self:
        """Open the camera with that serial number, or the only one that is connected.

        Args:
            serial: Serial number; None if only one camera is connected.
            backend: Backend of pyusb (default: the one that pyusb finds).

        Raises:
            CameraError: There is no such camera, or it can't be used, or there are several and `serial` is None.
        """
        found = []
        refused: list[Exception] = []
        for device in devices(backend):
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
        # the serial number is read last, because pyusb doesn't distinguish the errors of that
        if not self._configured():
            self.device.set_configuration(1)
        usb.util.claim_interface(self.device, 0)
        try:
            self._serial = (self.device.serial_number or "")[:8]
        except ValueError:
            # pyusb raises ValueError for unreadable strings, such as those of a camera that was just plugged in again
            raise CameraError("the serial number of the camera can't be read: plug it in again") from None

    def _configured(self) -> bool:
        """Return True if the device is configured; if it isn't, pyusb raises an error without a number."""
        try:
            return bool(self.device.get_active_configuration().bConfigurationValue == 1)
        except usb.core.USBError as error:
            if error.errno is not None:
                raise
            return False

    def _facts(self) -> DeviceInfo:
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
        options = (
            ("pixel filter", DVS, 10),
            ("activity filter", DVS, 30),
            ("region filter", DVS, 40),
            ("skip filter", DVS, 50),
            ("polarity filter", DVS, 60),
            ("event statistics", DVS, 80),
            ("color", APS, 3),
            ("global shutter", APS, 6),
            ("generator", EXTERNAL, 10),
            ("statistics", MUX, 80),
        )
        has = frozenset(name for name, module, parameter in options if self.get(module, parameter))
        inertial = self.get(IMU, 0)
        clocks = [self.get(SYSTEM, parameter) for parameter in (3, 4, 5)]
        deviation = self.get(SYSTEM, 6)
        logic_clock, converter_clock, usb_clock = (float(np.float32(clock * deviation / 1000)) for clock in clocks)
        (columns, rows, turned), (wide, high, orientation) = self._geometry()
        flips = self.get(IMU, 1)
        swap, frame_swap = bool(turned & 4), bool(orientation & 4)
        if not all(0 < side <= MAX_ANSWER for side in (columns, rows, wide, high)):
            raise self._implausible(f"{columns}x{rows} pixels, frames of {wide}x{high}")
        if not all(0 < clock <= MAX_ANSWER for clock in (logic_clock, converter_clock, usb_clock)):
            raise self._implausible(f"clocks of {logic_clock:g}, {converter_clock:g} and {usb_clock:g} MHz")
        try:
            biases_of(chip)
        except ValueError as error:
            self.close()
            raise CameraError(str(error)) from None
        return DeviceInfo(
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
        """Return the numbers of columns and rows, and the orientation, of events and of frames."""
        return [(self.get(module, 0), self.get(module, 1), self.get(module, 2)) for module in (DVS, APS)]

    def _implausible(self, what: str) -> CameraError:
        self.close()
        return CameraError(
            f"camera {self._serial} returns implausible answers ({what}): plug it in again, or into another port"
        )

    def _refused(self, why: str) -> CameraError:
        self.close()
        return CameraError(f"camera {self._serial} {why}: update it with the vendor's tool (Flashy in DV)")

    def get(self, module: int, parameter: int) -> int:
        """Read a register."""
        answer = self._control(READ, REGISTER, module, parameter, 4)
        if len(answer) != 4:
            raise CameraError(f"the camera answered {len(answer)} bytes for register {module}/{parameter}, not 4")
        return int.from_bytes(bytes(answer), "big")

    def set(self, module: int, parameter: int, value: int) -> None:
        """Write a register."""
        self._control(WRITE, REGISTER, module, parameter, int(value).to_bytes(4, "big"))

    def _control(self, kind: int, request: int, value: int, index: int, data: Any) -> Any:
        """Do a control transfer; repeat it once after a timeout."""
        with _translated_errors():
            try:
                return self.device.ctrl_transfer(kind, request, value, index, data, timeout=TIMEOUT)
            except usb.core.USBTimeoutError:
                return self.device.ctrl_transfer(kind, request, value, index, data, timeout=TIMEOUT)

    def set_together(self, *writes: tuple[int, int, int]) -> None:
        """Write several registers, each (module, parameter, value), in one transfer."""
        data = b"".join(bytes([m, p]) + int(value).to_bytes(4, "big") for m, p, value in writes)
        self._control(WRITE, SEVERAL, len(writes), 0, data)

    def get64(self, module: int, parameter: int) -> int:
        """Read a 64-bit counter whose upper half is at `parameter`."""
        while True:
            high, low, again = (self.get(module, parameter + offset) for offset in (0, 1, 0))
            if high == again:
                return high << 32 | low

    def configure(self, settings: CameraSettings | None = None) -> None:
        """Write the vendor's default configuration, then the settings that differ from it.

        Raises:
            ValueError: The camera doesn't have these biases, or doesn't support these settings.
        """
        settings = settings or CameraSettings()
        facts, biases = self.facts, biases_of(self.facts.chip)
        for name in settings.biases:
            if name not in biases:
                raise ValueError(f"{facts.name} has no bias {name!r}; it has {', '.join(biases)}")
        values = {name: biases[name].value(*numbers) for name, numbers in settings.biases.items()}
        for name, bias in biases.items():
            self.set(CHIP, bias.parameter, values.get(name, bias.value()))
        for write in (*defaults(facts), *changes(facts, settings)):
            self.set(*write)
        self.settings = settings

    def start(self) -> None:
        """Start the stream, after `configure`; the camera's time is reset first."""
        self._halt()
        time.sleep(0.01)
        with _translated_errors():
            self.device.clear_halt(ENDPOINT)
        # this closes streams of an earlier, incomplete start
        self.end_reading()
        self._stream, self.faults = _stream(self.device), 0
        if self.facts.board == "FX3":
            self._debug = queued(self.device, DEBUG, *MESSAGES)
        self.set(MUX, 3, 1)
        time.sleep(0.2)  # until the biases have settled
        for module, parameter in ((USB, 0), (MUX, 1), (MUX, 0)):
            self.set(module, parameter, 1)
        time.sleep(0.05)
        wanted = [(DVS, 3)]
        wanted += [(APS, 4)] if self.settings.frames else []
        wanted += [(IMU, 2), (IMU, 3), (IMU, 4)] if self.settings.inertial else []
        for module, parameter in (*wanted, (EXTERNAL, 0)):
            self.set(module, parameter, 1)

    def reset_time(self) -> None:
        """Restart the camera's time at 0; a special event in the stream marks this reset."""
        self.set_together((MUX, 2, 1), (MUX, 2, 0))

    def stop(self) -> None:
        """End the stream; bytes in transit can still be read. A disconnected camera counts as stopped."""
        with suppress(Unplugged):
            self._halt()

    def _halt(self) -> None:
        for module, parameter in RUNNING:
            self.set(module, parameter, 0)

    def read(self, timeout: int = 100) -> bytes:
        """Return the bytes that arrive within `timeout` ms, maybe none; only one thread may read at a time."""
        if self._stream is None:
            self._stream = _stream(self.device)
        try:
            return self._stream.read(timeout)
        except Disconnected as error:
            raise Unplugged(f"the camera stopped sending: {error}") from None
        finally:
            self.faults = self._stream.faults
            # byte 0 marks a message, and its text begins at byte 6
            said = [] if self._debug is None else self._debug.arrived()
            self.messages += [m[6:].decode("ascii", "replace").rstrip("\0 \n") for m in said if m[:1] == b"\0"]

    def end_reading(self) -> None:
        """Cancel the requests that still wait; called after the last `read`, by the thread that read."""
        for stream in (self._debug, self._stream):
            if stream is not None:
                stream.close()
        self._debug = self._stream = None

    def dropped(self) -> int | None:
        """Return the number of events that the camera dropped since power-on; None if it doesn't count them."""
        return self.get64(MUX, 83) if "statistics" in self.facts.has else None

    def decoder(self) -> DavisDecoder:
        """Return a decoder for this camera's stream, whose times never decrease."""
        facts = self.facts
        return DavisDecoder(
            facts.width,
            facts.height,
            facts.swap,
            facts.frame_size,
            facts.frame_orientation,
            facts.chip,
            facts.inertial,
            facts.inertial_flips,
            steady=True,
        )

    def about(self) -> dict[str, Any]:
        """Return the camera's metadata for its recordings: name, serial, biases, settings, note."""
        numbers = {name: [bias.first, bias.second] for name, bias in biases_of(self.facts.chip).items()}
        numbers |= {name: list(pair) for name, pair in self.settings.biases.items()}
        facts = {"camera": self.facts.name, "serial": self.facts.serial, "biases": numbers}
        facts["settings"] = {name: value for name, value in asdict(self.settings).items() if name != "biases"}
        return facts | ({"note": self.note} if self.note else {})

    def journal_head(self, decoder: DavisDecoder, last: int | None, about: Mapping[str, Any]) -> bytes:
        """Return the first bytes of a file of the format `davis`; see `Camera`."""
        return header(decoder, last, about)

    def close(self) -> None:
        """Release the camera."""
        self.end_reading()
        usb.util.dispose_resources(self.device)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def devices(backend: Any) -> list[Any]:
    """Return the connected cameras, including those that other programs use."""
    try:
        options = {} if backend is None else {"backend": backend}
        return [
            device
            for product in BOARDS
            for device in usb.core.find(find_all=True, idVendor=VENDOR, idProduct=product, **options)
        ]
    except usb.core.NoBackendError:
        raise CameraError("libusb isn't installed: install libusb-1.0 (Debian and Ubuntu: libusb-1.0-0)") from None


def _stream(device: Any) -> UsbStream:
    """Return the fastest kind of stream that the backend of the device supports."""
    found = queued(device, ENDPOINT)
    if found is not None:
        return found
    try:
        return SubprocessStream.of(device, ENDPOINT) if can_read_in_subprocess(device) else SyncStream(device, ENDPOINT)
    except Disconnected as error:
        raise CameraError(str(error)) from None


@contextmanager
def _translated_errors() -> Iterator[None]:
    """Convert USB errors in the block to CameraErrors that state the cause and a remedy."""
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
        raise CameraError(f"the camera refused a request: {error.strerror or error}") from None
