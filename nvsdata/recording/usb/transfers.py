"""Reading of a camera's stream, by requests that are queued in libusb, or by one request at a time."""

from __future__ import annotations

import array
import ctypes
import time
from collections import deque
from typing import Any, Protocol

import usb.core

COUNT, SIZE = 32, 1 << 16  # requests, and bytes of each
COMPLETED, FAILED, TIMED_OUT, CANCELLED, NO_DEVICE = 0, 1, 2, 3, 5
BULK, INTERRUPT = 2, 3
MOST_FAULTS = 4 * COUNT  # failed requests after which the device counts as disconnected
PATIENCE = 1.0  # s that the end of canceled requests may take
# streams whose requests libusb hasn't returned: their buffers must not be freed while the process runs
_UNENDED: list[AsyncStream] = []


class Disconnected(Exception):
    """The device no longer answers."""


class UsbStream(Protocol):
    """Protocol of a camera's stream; `faults` counts requests that failed, whose bytes may be lost."""

    faults: int

    def read(self, timeout: int) -> bytes:
        """Return the bytes that arrive within `timeout` ms, maybe none; raise `Disconnected` if the device is gone."""

    def close(self) -> None:
        """Stop reading."""


class SyncStream:
    """Stream read by one request at a time, through any backend of pyusb.

    Between two requests, the camera can't send, and its memory of 3 kB may overflow.
    """

    def __init__(self, device: Any, endpoint: int) -> None:
        self.device, self.endpoint, self.faults = device, endpoint, 0
        self._buffer = array.array("B", bytes(SIZE))

    def read(self, timeout: int) -> bytes:
        try:
            count = self.device.read(self.endpoint, self._buffer, timeout)
        except usb.core.USBTimeoutError:
            return b""
        except usb.core.USBError as error:
            raise Disconnected(error.strerror or str(error)) from None
        return bytes(memoryview(self._buffer)[:count])

    def close(self) -> None:
        pass


class _Timeval(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("microseconds", ctypes.c_long))


class AsyncStream:
    """Stream read by several requests that are queued in libusb, so that the camera can always send.

    Args:
        lib: The libusb library that pyusb has loaded.
        context: Context of libusb.
        handle: Handle of a device whose interface has been claimed.
        endpoint: Endpoint to read from.
        count: Number of requests (default 32).
        size: Bytes of each request (default 65,536).
        kind: Kind of the endpoint, `BULK` or `INTERRUPT` (default `BULK`).
    """

    def __init__(
        self, lib: Any, context: Any, handle: Any, endpoint: int, count: int = COUNT, size: int = SIZE, kind: int = BULK
    ) -> None:
        from usb.backend import libusb1

        self._lib, self._context = lib, context
        self._done: deque[bytes] = deque()
        self._ending = False
        self.faults = 0
        # requests that libusb refused, or that failed; they are submitted again
        self._idle: list[Any] = []
        self._gone = False
        self._waiting: dict[int, Any] = {}
        # kept alive here, because libusb knows only their addresses
        self._callback = libusb1._libusb_transfer_cb_fn_p(self._complete)
        self._buffers = [ctypes.create_string_buffer(size) for _ in range(count)]
        self._transfers = []
        for buffer in self._buffers:
            transfer = lib.libusb_alloc_transfer(0)
            request = transfer.contents
            request.dev_handle, request.endpoint, request.type = handle, endpoint, kind
            request.timeout, request.length = 0, size
            request.buffer = ctypes.cast(buffer, ctypes.c_void_p)
            request.callback = self._callback
            self._transfers.append(transfer)
            self._submit(transfer)

    def _submit(self, transfer: Any) -> None:
        if self._lib.libusb_submit_transfer(transfer) == 0:
            self._waiting[ctypes.addressof(transfer.contents)] = transfer
        else:
            self.faults += 1
            self._idle.append(transfer)

    def _complete(self, transfer: Any) -> None:
        """Keep the bytes of a completed request, and submit it again; libusb calls this."""
        request = transfer.contents
        self._waiting.pop(ctypes.addressof(request), None)
        if request.actual_length:
            # a failed request may have received bytes, too
            self._done.append(ctypes.string_at(request.buffer, request.actual_length))
        if request.status in (COMPLETED, TIMED_OUT):
            if not self._ending:
                self._submit(transfer)
        elif request.status != CANCELLED:
            self.faults += 1
            self._gone |= request.status == NO_DEVICE
            self._idle.append(transfer)

    def read(self, timeout: int) -> bytes:
        if not self._done:
            self._try_again()
            if not self._waiting:
                raise Disconnected("no request is answered any more")
            self._handle(timeout)
        taken = []
        while self._done:
            taken.append(self._done.popleft())
        return b"".join(taken)

    def _try_again(self) -> None:
        """Submit failed requests again, unless the device is gone."""
        idle, self._idle = self._idle, []
        for transfer in idle if not self._gone and self.faults < MOST_FAULTS else ():
            self._submit(transfer)

    def arrived(self) -> list[bytes]:
        """Return the blocks that arrived while another stream of the same device was read."""
        taken = list(self._done)
        self._done.clear()
        return taken

    def _handle(self, timeout: int) -> None:
        span = _Timeval(timeout // 1000, timeout % 1000 * 1000)
        self._lib.libusb_handle_events_timeout(self._context, ctypes.byref(span))

    def close(self) -> None:
        self._ending = True
        for transfer in list(self._waiting.values()):
            self._lib.libusb_cancel_transfer(transfer)
        deadline = time.monotonic() + PATIENCE
        while self._waiting and time.monotonic() < deadline:
            self._handle(20)
        if not self._waiting:
            # a request that libusb hasn't returned must not be freed
            for transfer in self._transfers:
                self._lib.libusb_free_transfer(transfer)
            self._transfers = []
        else:
            _UNENDED.append(self)


def queued(device: Any, endpoint: int, *how: int) -> AsyncStream | None:
    """Return an `AsyncStream` of the device, or None if pyusb uses another backend than libusb 1.0."""
    parts = _libusb(device)
    return None if parts is None else AsyncStream(*parts, endpoint, *how)


def _libusb(device: Any) -> tuple[Any, Any, Any] | None:
    """Return the library, context and handle of libusb for an open device, or None if pyusb uses another backend."""
    try:
        from usb.backend import libusb1

        backend = device.backend
        if not isinstance(backend, libusb1._LibUSB):
            return None
        lib, handle = backend.lib, device._ctx.handle.handle
        pointer = libusb1._libusb_transfer_p
        lib.libusb_cancel_transfer.argtypes = lib.libusb_free_transfer.argtypes = [pointer]
        lib.libusb_handle_events_timeout.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
        return lib, backend.ctx, handle
    except (AttributeError, ImportError):
        # these names are private to pyusb, and another version may not have them
        return None
